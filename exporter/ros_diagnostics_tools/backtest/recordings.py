"""Recorded diagnostics in order of time: rosbag2 (sqlite3, mcap), the JSON form, event logs.

Reads no clock and imports no ROS. Bags are read by the library `rosbags`, the extra `[backtest]`.
"""

from __future__ import annotations

import heapq
import json
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any, NamedTuple

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.decode import cdr
from ros_diagnostics_exporter.model import Array, Domain, Status, Topic
from ros_diagnostics_tools.backtest.event_log import EventLog, EventLogError, is_event_log

TYPE = "diagnostic_msgs/msg/DiagnosticArray"
SHOWN = 300  # characters of a library's error about a damaged file
PAUSE = 1.0  # seconds between two recordings from which on nobody was recording


class RecordingError(Exception):
    """A file cannot be read as a recording; the text names it."""


class Message(NamedTuple):
    """A recorded DiagnosticArray, received ``at`` Unix time; its bytes, or itself decoded."""

    at: float
    topic: Topic
    content: bytes | Array

    def decode(self) -> Array:
        """The array. Raises ValueError where the bytes are none."""
        return cdr.decode(self.content) if isinstance(self.content, bytes) else self.content


@dataclass(frozen=True)
class RecordingSource:
    """A file or folder to read, and how its topics are understood.

    ``namespace`` ("/robot_1" or "") is put before every topic; ``domain_id`` is the DDS domain that
    it was recorded in. An exporter's event log needs the ``fleet`` that it was made with, and has
    its robots' topics and domains from there.
    """

    path: Path
    domain_id: Domain = 0
    namespace: str = ""
    fleet: Fleet | None = None


class Recording:
    """One opened source: when it begins and ends (Unix time), its topics, how many messages.

    Raises RecordingError where it cannot be read.
    """

    def __init__(self, source: RecordingSource) -> None:
        self.source = source
        opened = _open(source)
        self._opened: _Json | _Bag | EventLog = opened
        self.is_event_log = isinstance(opened, EventLog)
        self.topics = sorted(opened.topics)
        self._places = opened.places if isinstance(opened, EventLog) else {}
        self.unknown = opened.unknown if isinstance(opened, EventLog) else []
        if not self.topics and not self.is_event_log:
            opened.close()
            raise RecordingError(f"{source.path}: holds no {TYPE}; record /diagnostics_agg")
        self.count, self.begin, self.end = opened.count, opened.begin, opened.end

    def close(self) -> None:
        """Close the file."""
        self._opened.close()

    def topic(self, name: str) -> Topic:
        """The topic that a recorded one stands for; in an event log, a robot's name does."""
        return self._places.get(name) or Topic(self.source.domain_id, self.source.namespace + name)

    def messages(self) -> Iterator[Message]:
        """All of it in order of time. Raises RecordingError where it is damaged."""
        topics = {name: self.topic(name) for name in self.topics}
        for at, name, content in self._opened.messages():
            yield Message(at, topics[name], content)


class Period(NamedTuple):
    """A time, Unix seconds, in which something was recorded without a pause."""

    begin: float
    end: float


class Recordings:
    """Several of them, merged; to be closed. Raises RecordingError as `Recording` does."""

    def __init__(self, sources: Iterable[RecordingSource]) -> None:
        with ExitStack() as stack:
            self.all = [stack.enter_context(closing(Recording(source))) for source in sources]
            self._stack = stack.pop_all()
        self.count = sum(each.count for each in self.all)
        self.topics = {each.topic(name) for each in self.all for name in each.topics}
        self.unknown = sorted({name for each in self.all for name in each.unknown})
        self.has_event_log = any(each.is_event_log for each in self.all)

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    @property
    def periods(self) -> list[Period]:
        """When there was a recorder; between two of them nothing is known."""
        found: list[Period] = []
        for begin, end in sorted((each.begin, each.end) for each in self.all):
            if found and begin <= found[-1].end + PAUSE:
                found[-1] = Period(found[-1].begin, max(end, found[-1].end))
            else:
                found.append(Period(begin, end))
        return found

    def messages(self) -> Iterator[Message]:
        """All messages in order of time. Raises RecordingError where a file is damaged."""
        yield from heapq.merge(*(each.messages() for each in self.all), key=attrgetter("at"))


def _open(source: RecordingSource) -> _Json | _Bag | EventLog:
    if source.path.suffix == ".json":
        return _Json(source.path)
    if source.fleet is None or not is_event_log(source.path):
        return _Bag(source.path)
    try:
        return EventLog(source.path, source.fleet)
    except EventLogError as error:
        raise RecordingError(f"{source.path}: {error}") from error


_Row = tuple[float, str, "bytes | Array"]


class _Bag:
    """A bag's folder, or a .db3 or .mcap file."""

    def __init__(self, path: Path) -> None:
        try:
            from rosbags.rosbag2 import Reader  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise RecordingError(
                f"{path}: reading bags needs the extra [backtest] ({error}): "
                "pip install 'ros-diagnostics-exporter[backtest]'"
            ) from error
        if not path.exists():
            raise RecordingError(f"{path}: there is no such file or folder")
        self._path = path
        try:
            self._reader = Reader(path)
            self._reader.open()
        except Exception as error:  # a damaged file makes the library raise anything
            raise RecordingError(f"{path}: cannot be read as a bag: {_text(error)}") from error
        self._wanted = [each for each in self._reader.connections if each.msgtype == TYPE]
        self.topics = {each.topic for each in self._wanted}
        self.count = sum(each.msgcount for each in self._wanted)
        self.begin, self.end = self._reader.start_time / 1e9, self._reader.end_time / 1e9

    def messages(self) -> Iterator[_Row]:
        count = 0
        try:
            for connection, at, data in self._reader.messages(self._wanted):
                yield at / 1e9, connection.topic, bytes(data)
                count += 1
        except Exception as error:  # as above
            raise RecordingError(
                f"{self._path}: is damaged after {count} messages: {_text(error)}"
            ) from error

    def close(self) -> None:
        self._reader.close()


class _Json:
    """A .json file of this project's recordings: docs/virtual-robots.md describes it."""

    def __init__(self, path: Path) -> None:
        try:
            document = json.loads(path.read_text(encoding="utf-8"))
            self._rows = list(_rows(document))
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
        except (KeyError, TypeError, AttributeError) as error:
            raise RecordingError(f"{path}: is no recording of diagnostics: {error!r}") from error
        except (ValueError, RecursionError) as error:
            raise RecordingError(f"{path}: is not JSON: {_text(error)}") from error
        self._rows.sort(key=lambda row: row[0])
        self.topics = {topic for _at, topic, _array in self._rows}
        self.count = len(self._rows)
        times = [at for at, _topic, _array in self._rows] or [0.0]
        self.begin, self.end = times[0], times[-1]

    def messages(self) -> Iterator[_Row]:
        return iter(self._rows)

    def close(self) -> None:
        self._rows.clear()


def _rows(document: dict[str, Any]) -> Iterator[_Row]:
    begin, topic = float(document["t0_unix"]), str(document["topic"])
    for raw in document["messages"]:
        if isinstance(raw.get("status"), list):  # others are events, or a status alone
            stamp = raw["header"]["stamp"]
            statuses = tuple(map(_status, raw["status"]))
            array = Array(stamp["sec"] + stamp["nanosec"] * 1e-9, statuses)
            yield begin + float(raw["t"]), topic, array


def _status(raw: dict[str, Any]) -> Status:
    values = tuple((str(pair["key"]), str(pair["value"])) for pair in raw["values"])
    texts = str(raw["name"]), str(raw["message"]), str(raw["hardware_id"])
    return Status(int(raw["level"]), *texts, values)


def _text(error: Exception) -> str:
    return (str(error) or type(error).__name__)[:SHOWN]
