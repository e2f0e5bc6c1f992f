"""Recorded diagnostics in order of time: bags of ROS 2 and ROS 1, JSON, event logs.

Reads no clock and imports no ROS.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, closing
from dataclasses import dataclass
from operator import attrgetter, itemgetter
from pathlib import Path
from typing import NamedTuple

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.decode import cdr
from ros_diagnostics_exporter.model import Array, Domain, Topic
from ros_diagnostics_exporter.sources.topic_entries import ends_of
from ros_diagnostics_exporter.texts import one_line
from ros_diagnostics_tools.backtest import ros1
from ros_diagnostics_tools.backtest.event_log import EventLog, EventLogError, is_event_log
from ros_diagnostics_tools.backtest.files import open_files
from ros_diagnostics_tools.backtest.formats import (
    TYPE,
    Content,
    Fields,
    Format,
    RecordingError,
    Ros1,
    Undecodable,
)

OTHERS = 5  # topics of other types that are named
PAUSE = 1.0  # seconds between two recordings from which on nobody was recording


class Message(NamedTuple):
    """A recorded message, received ``at`` Unix time; its bytes, or itself decoded."""

    at: float
    topic: Topic
    content: Content

    def decode(self) -> Array:
        """The array. Raises ValueError where the content is none."""
        if isinstance(self.content, Undecodable | Fields):
            raise ValueError(str(self.content))  # noqa: TRY004 - as of the others
        if isinstance(self.content, Array):
            return self.content
        if isinstance(self.content, Ros1):
            return ros1.decode(self.content)
        return cdr.decode(self.content)


@dataclass(frozen=True)
class RecordingSource:
    """A file or folder to read, and how its topics are understood.

    ``namespace`` ("/robot_1" or "") is put before every topic; ``domain_id`` is the DDS domain that
    it was recorded in. An exporter's event log needs the ``fleet`` that it was made with, and has
    its robots' topics and domains from there. ``asked`` are small topics as `topics` name them.
    """

    path: Path
    domain_id: Domain = 0
    namespace: str = ""
    fleet: Fleet | None = None
    asked: frozenset[str] = frozenset()


class Recording:
    """One opened source: when it begins and ends (Unix time), its topics, how many messages.

    Raises RecordingError where it cannot be read.
    """

    def __init__(self, source: RecordingSource) -> None:
        self.source = source
        self._places: dict[str, Topic] = {}
        self.unknown: list[str] = []
        self.is_event_log = source.fleet is not None and is_event_log(source.path)
        self._files: list[Format]
        with ExitStack() as stack:
            if source.fleet is not None and self.is_event_log:
                self._files = [stack.enter_context(closing(self._event_log(source.fleet)))]
            else:
                self._files = open_files(source.path, stack, self._is_asked)
                self._check()
            self._stack = stack.pop_all()
        self.topics = sorted({topic for each in self._files for topic in each.topics})
        self.count = sum(each.count for each in self._files)
        own = [each for each in self._files if each.topics] or self._files
        self.begin = min(each.begin for each in own)
        self.end = max(each.end for each in own)

    def _is_asked(self, topic: str) -> bool:
        return topic.endswith(ends_of(self.source.asked))

    def _event_log(self, fleet: Fleet) -> EventLog:
        try:
            log = EventLog(self.source.path, fleet)
        except EventLogError as error:
            raise RecordingError(f"{self.source.path}: {error}") from error
        self._places, self.unknown = log.places, log.unknown
        return log

    def _check(self) -> None:
        """Raise RecordingError where nothing of it is diagnostics."""
        if any(each.topics for each in self._files):
            return
        others = sorted({pair for each in self._files for pair in each.others.items()})
        named = ", ".join(one_line(f"{topic} ({kind})") for topic, kind in others[:OTHERS])
        parts = [
            f"{self.source.path}: holds no {TYPE}; record /diagnostics_agg",
            f"it has {len(others)} topics: {named}" if others else "",
            *(warning for each in self._files for warning in each.warnings),
        ]
        raise RecordingError("; ".join(filter(None, parts)))

    @property
    def warnings(self) -> list[str]:
        """What could not be read of it."""
        return [warning for each in self._files for warning in each.warnings]

    def close(self) -> None:
        """Close the files."""
        self._stack.close()

    def topic(self, name: str) -> Topic:
        """The topic that a recorded one stands for; in an event log, a robot's name does."""
        name_here = name if name.startswith("/") else f"/{name}"  # ROS 1 records some without
        known = self._places.get(name)
        return known or Topic(self.source.domain_id, self.source.namespace + name_here)

    def messages(self) -> Iterator[Message]:
        """All of it in order of time, up to where a file is damaged."""
        topics = {name: self.topic(name) for name in self.topics}
        files = (each.messages() for each in self._files)
        for at, name, content in heapq.merge(*files, key=itemgetter(0)):
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

    @property
    def warnings(self) -> list[str]:
        """What could not be read of them; of damage, once all messages were taken."""
        return [warning for each in self.all for warning in each.warnings]

    def messages(self) -> Iterator[Message]:
        """All messages in order of time."""
        yield from heapq.merge(*(each.messages() for each in self.all), key=attrgetter("at"))
