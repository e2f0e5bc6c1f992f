"""Recordings of diagnostics: rosbag2 (sqlite3, mcap) in and out, and a JSON form in.

It does not import ROS and reads no clock.
"""

from __future__ import annotations

import heapq
import json
import re
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from pydantic import BaseModel, ConfigDict, Field
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from virtual_robots.model import Status
from virtual_robots.recording.cdr import encode_array, encode_status
from virtual_robots.schema.documents import DocumentError, ModelT, parse

ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
STATUS = "diagnostic_msgs/msg/DiagnosticStatus"
TYPES = (ARRAY, STATUS)
STORAGES = {"sqlite3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}
TOPIC = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+", re.ASCII)
SHOWN = 300  # characters of a library's error about a damaged file


class Recorded(NamedTuple):
    """A recorded message: when it was received (ns since the epoch), and its serialized bytes."""

    at: int
    topic: str
    type: str
    data: bytes


def recorded_topics(paths: Sequence[Path]) -> dict[str, str]:
    """Topic -> type of all diagnostics in the files. Raises DocumentError as read_recordings."""
    topics: dict[str, str] = {}
    for path in paths:
        if path.suffix == ".json":
            found = {message.topic: message.type for message in _read_json(path)}
        else:
            with _opened(path) as reader:
                found = {c.topic: c.msgtype for c in _diagnostics(reader)}
        if not found:
            raise DocumentError(f"{path}: holds no message of {' or '.join(TYPES)}")
        if wrong := [topic for topic in found if not TOPIC.fullmatch(topic)]:
            raise DocumentError(f"{path}: topic {wrong[0][:SHOWN]!r} is not a full name of ROS")
        topics |= found
    return topics


def read_recordings(paths: Sequence[Path]) -> Iterator[Recorded]:
    """The diagnostics in all the files, in order of time; messages of other types are left out.

    A path is a bag's folder, a .db3 or .mcap file, or a .json file (see docs/virtual-robots.md).
    Raises DocumentError for a file that cannot be read, or where a file is damaged.
    """
    streams = (_read_json(path) if path.suffix == ".json" else _read_bag(path) for path in paths)
    yield from heapq.merge(*streams, key=lambda message: message.at)


class BagWriter:
    """Writes messages into a new bag.

    Raises DocumentError where ``path`` is there already, or where it cannot be written.
    """

    def __init__(self, path: Path, storage: str) -> None:
        if path.exists():
            raise DocumentError(f"{path}: is there already; a recording never overwrites one")
        self._path = path
        self._writer = Writer(path, version=9, storage_plugin=STORAGES[storage])
        with self._writing():
            self._writer.open()
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Any] = {}

    def write(self, message: Recorded) -> None:
        """Add a message. Raises DocumentError where that fails."""
        with self._writing():
            if message.topic not in self._connections:
                self._connections[message.topic] = self._writer.add_connection(
                    message.topic, message.type, typestore=self._types
                )
            self._writer.write(self._connections[message.topic], message.at, message.data)

    def close(self) -> None:
        """Finish the bag; it cannot be read before. Raises DocumentError where that fails."""
        with self._writing():
            self._writer.close()

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except (OSError, sqlite3.Error) as error:
            raise DocumentError(f"{self._path}: cannot be written: {_text(error)}") from error


@contextmanager
def _opened(path: Path) -> Iterator[Reader]:
    try:
        reader = Reader(path)
        reader.open()
    except Exception as error:  # a damaged file makes the library raise anything
        raise DocumentError(f"{path}: cannot be read as a bag: {_text(error)}") from error
    try:
        yield reader
    finally:
        reader.close()


def _text(error: Exception) -> str:
    return (str(error) or type(error).__name__)[:SHOWN]


def _diagnostics(reader: Reader) -> list[Connection]:
    return [connection for connection in reader.connections if connection.msgtype in TYPES]


def _read_bag(path: Path) -> Iterator[Recorded]:
    with _opened(path) as reader:
        count = 0
        try:
            for connection, at, data in reader.messages(_diagnostics(reader)):
                yield Recorded(at, connection.topic, connection.msgtype, bytes(data))
                count += 1
        except Exception as error:  # as above
            raise DocumentError(
                f"{path}: is damaged; {count} messages could be read, then: {_text(error)}"
            ) from error


class _Part(BaseModel):
    """An object of the JSON form; unknown keys are ignored."""

    model_config = ConfigDict(frozen=True)


class _Pair(_Part):
    key: str
    value: str


class _Status(_Part):
    level: int = Field(ge=0, le=255)
    name: str
    message: str
    hardware_id: str
    values: tuple[_Pair, ...]

    def status(self) -> Status:
        values = tuple((pair.key, pair.value) for pair in self.values)
        return Status(self.level, self.name, self.message, self.hardware_id, values)


class _Stamp(_Part):
    sec: int = Field(ge=-(2**31), lt=2**31)
    nanosec: int = Field(ge=0, lt=10**9)


class _Header(_Part):
    stamp: _Stamp
    frame_id: str


class _Message(_Part):
    t: float = Field(ge=-1e9, le=1e9)


class _StatusMessage(_Message):
    status: _Status


class _ArrayMessage(_Message):
    header: _Header
    status: tuple[_Status, ...]


class _Recording(_Part):
    topic: str
    t0_unix: float = Field(ge=0, le=4e9)
    messages: tuple[dict[str, Any], ...]


def _read_json(path: Path) -> Iterator[Recorded]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read: {error.strerror}") from error
    except (ValueError, RecursionError) as error:
        raise DocumentError(f"{path}: is not JSON: {_text(error)}") from error
    if not isinstance(document, dict):
        raise DocumentError(f"{path}: is not a recording of diagnostics: must be an object")
    recording = _parsed(_Recording, document, str(path))
    for number, raw in enumerate(recording.messages):
        if "status" in raw:  # others are events of the recording
            yield _from_json(raw, recording, f"{path}: messages.{number}")


def _from_json(raw: Mapping[str, Any], recording: _Recording, where: str) -> Recorded:
    if isinstance(raw["status"], dict):
        single = _parsed(_StatusMessage, raw, where)
        at = round((recording.t0_unix + single.t) * 1e9)
        return Recorded(at, recording.topic, STATUS, encode_status(single.status.status()))
    array = _parsed(_ArrayMessage, raw, where)
    at = round((recording.t0_unix + array.t) * 1e9)
    stamp = array.header.stamp.sec + array.header.stamp.nanosec / 1e9
    data = encode_array([each.status() for each in array.status], stamp, array.header.frame_id)
    return Recorded(at, recording.topic, ARRAY, data)


def _parsed(model: type[ModelT], raw: Mapping[str, Any], where: str) -> ModelT:
    """The model; raises DocumentError with the first thing that is wrong: there may be millions."""
    try:
        return parse(model, raw, where)
    except DocumentError as error:
        raise DocumentError(str(error).splitlines()[0][: len(where) + SHOWN]) from error
