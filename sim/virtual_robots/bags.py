"""Recordings of diagnostics: rosbag2 (sqlite3, mcap) in and out, and a JSON form in.

Knows files and serialized messages; it knows no ROS and no clock.
"""

from __future__ import annotations

import heapq
import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader, ReaderError, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from virtual_robots.cdr import encode_array, encode_status
from virtual_robots.diagnostics import Status
from virtual_robots.documents import DocumentError

ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
STATUS = "diagnostic_msgs/msg/DiagnosticStatus"
TYPES = (ARRAY, STATUS)
STORAGES = {"sqlite3": StoragePlugin.SQLITE3, "mcap": StoragePlugin.MCAP}


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
        topics |= found
    return topics


def read_recordings(paths: Sequence[Path]) -> Iterator[Recorded]:
    """The diagnostics in all the files, in order of time; messages of other types are left out.

    A path is a bag's folder, a .db3 or .mcap file, or a .json file (see docs/virtual-robots.md).
    Raises DocumentError for one that cannot be read.
    """
    streams = (_read_json(path) if path.suffix == ".json" else _read_bag(path) for path in paths)
    yield from heapq.merge(*streams, key=lambda message: message.at)


class BagWriter:
    """Writes messages into a new bag. Raises DocumentError where ``path`` is there already."""

    def __init__(self, path: Path, storage: str) -> None:
        if path.exists():
            raise DocumentError(f"{path}: is there already; a recording never overwrites one")
        self._writer = Writer(path, version=9, storage_plugin=STORAGES[storage])
        self._writer.open()
        self._types = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Any] = {}

    def write(self, message: Recorded) -> None:
        """Add a message."""
        if message.topic not in self._connections:
            self._connections[message.topic] = self._writer.add_connection(
                message.topic, message.type, typestore=self._types
            )
        self._writer.write(self._connections[message.topic], message.at, message.data)

    def close(self) -> None:
        """Finish the bag; it cannot be read before."""
        self._writer.close()


@contextmanager
def _opened(path: Path) -> Iterator[Reader]:
    try:
        reader = Reader(path)
        reader.open()
    except (OSError, ReaderError) as error:
        raise DocumentError(f"{path}: cannot be read as a bag: {error}") from error
    try:
        yield reader
    finally:
        reader.close()


def _diagnostics(reader: Reader) -> list[Connection]:
    return [connection for connection in reader.connections if connection.msgtype in TYPES]


def _read_bag(path: Path) -> Iterator[Recorded]:
    with _opened(path) as reader:
        for connection, at, data in reader.messages(_diagnostics(reader)):
            yield Recorded(at, connection.topic, connection.msgtype, bytes(data))


def _read_json(path: Path) -> Iterator[Recorded]:
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
        topic, zero = document["topic"], document["t0_unix"]
        for raw in document["messages"]:
            if "status" in raw:  # others are events of the recording
                yield _from_json(raw, topic, zero)
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read: {error.strerror}") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise DocumentError(f"{path}: is not JSON: {error}") from error
    except (KeyError, TypeError, AttributeError) as error:
        raise DocumentError(f"{path}: is not a recording of diagnostics: {error!r}") from error


def _from_json(raw: Mapping[str, Any], topic: str, zero: float) -> Recorded:
    at = round((zero + raw["t"]) * 1e9)
    if isinstance(raw["status"], dict):
        return Recorded(at, topic, STATUS, encode_status(_status(raw["status"])))
    header = raw["header"]
    stamp = header["stamp"]["sec"] + header["stamp"]["nanosec"] / 1e9
    statuses = [_status(status) for status in raw["status"]]
    return Recorded(at, topic, ARRAY, encode_array(statuses, stamp, header["frame_id"]))


def _status(raw: Mapping[str, Any]) -> Status:
    values = tuple((pair["key"], pair["value"]) for pair in raw["values"])
    return Status(raw["level"], raw["name"], raw["message"], raw["hardware_id"], values)
