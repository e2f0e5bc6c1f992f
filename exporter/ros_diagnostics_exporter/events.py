"""Events: levels changed, robots became silent, the config was read.

The last ones are kept in memory for /api/v1/events; a log file of JSON lines is optional.
"""

from __future__ import annotations

import logging
import logging.handlers
import queue
import sys
import threading
from collections import deque
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

from ros_diagnostics_exporter.texts import to_json

KINDS = ("level", "robot", "config")
MAX_EVENTS = 10_000  # events in memory; some 5 MB
BYTES = 32 * 1024 * 1024  # of their texts, where messages are long
MESSAGE = 4_096  # characters of a message in memory
MAX_QUEUED = 10_000  # lines that are not written yet

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Event:
    """One thing that happened, at Unix time ``time``.

    ``kind`` is ``level`` (a component changed), ``robot`` (known, forgotten, silent or back) or
    ``config`` (read or rejected). ``before`` and ``after`` are the words of levels, OK,
    WARN, ERROR, STALE; ``after`` may also be heard, silent, known, forgotten, read or refused. A
    field that does not apply is "".
    """

    time: float
    kind: str
    robot: str = ""
    group: str = ""
    component: str = ""
    before: str = ""
    after: str = ""
    message: str = ""


@dataclass(frozen=True)
class Wanted:
    """Which events a reader asks for; None asks for all. ``since`` <= time < ``until``."""

    kind: str | None = None
    robot: str | None = None
    component: str | None = None
    level: str | None = None  # after the change
    since: float | None = None
    until: float | None = None
    before: int | None = None  # the id of an event: only older ones
    limit: int = 100

    def matches(self, event: Event) -> bool:
        """Whether ``event`` is one of those asked for, id and limit apart."""
        pairs = (
            (self.kind, event.kind),
            (self.robot, event.robot),
            (self.component, event.component),
            (self.level, event.after),
        )
        return (
            all(want is None or want == have for want, have in pairs)
            and (self.since is None or event.time >= self.since)
            and (self.until is None or event.time < self.until)
        )


class EventLogError(Exception):
    """The event log cannot be opened; the text names the file."""


class EventLog:
    """The last events, newest first, and their log on disk if there is one. Safe from any thread.

    Args:
        path: The file to append JSON lines to, one event each; None keeps no log.
        max_bytes: Size at which the file is renamed to ``<path>.1`` and a new one begun.
        backups: How many of the renamed files stay.

    Raises:
        EventLogError: The file cannot be opened for appending.
    """

    def __init__(
        self, path: Path | None = None, max_bytes: int = 10_000_000, backups: int = 5
    ) -> None:
        self._lock = threading.Lock()
        self._events: deque[Event] = deque()
        self._bytes = 0
        self._recorded = 0
        self._file = None if path is None else _Writer(path, max_bytes, backups)

    def record(self, event: Event) -> None:
        """Record the event; a failed write to the log file is logged and costs no more."""
        short = event
        if len(event.message) > MESSAGE:  # a config may have any number of errors
            short = replace(event, message=event.message[:MESSAGE] + "…")
        with self._lock:
            self._events.append(short)
            self._recorded += 1
            self._bytes += _size(short)
            while len(self._events) > MAX_EVENTS or self._bytes > BYTES:
                self._bytes -= _size(self._events.popleft())
        if self._file is not None:
            self._file.write(to_json(_filled(event)))

    def find(self, wanted: Wanted) -> Iterator[dict[str, Any]]:
        """The events asked for as JSON objects, newest first, fields that do not apply left out.

        Each has an ``id``, its number since the start.
        """
        with self._lock:
            events, last = list(self._events), self._recorded
        return islice(_newest(events, last, wanted), wanted.limit)

    def close(self) -> None:
        """Write the queue and close the log file."""
        if self._file is not None:
            self._file.close()


def _size(event: Event) -> int:
    """Bytes of its texts in memory."""
    texts = (event.robot, event.group, event.component, event.message)
    return sum(map(sys.getsizeof, texts))


def _newest(events: list[Event], last: int, wanted: Wanted) -> Iterator[dict[str, Any]]:
    for number, event in enumerate(reversed(events)):
        if (wanted.before is None or last - number < wanted.before) and wanted.matches(event):
            yield {"id": last - number, **_filled(event)}


def _filled(event: Event) -> dict[str, Any]:
    return {key: value for key, value in asdict(event).items() if value != ""}


class _Writer:
    """Writes lines in its own thread, so that a slow disk delays no caller of record."""

    def __init__(self, path: Path, max_bytes: int, backups: int) -> None:
        try:
            self._file = _Lines(path, max_bytes, backups)
        except OSError as error:
            raise EventLogError(f"{path}: {error.strerror}") from error
        self._queue: queue.Queue[str | None] = queue.Queue(MAX_QUEUED)
        self._dropped = 0
        self._thread = threading.Thread(target=self._run, name="event-log")
        self._thread.start()

    def write(self, line: str) -> None:
        try:
            self._queue.put_nowait(line)
        except queue.Full:
            self._dropped += 1

    def close(self) -> None:
        self._queue.put(None)
        self._thread.join()
        self._file.close()

    def _run(self) -> None:
        logged = 0
        while (line := self._queue.get()) is not None:
            self._file.write(line)
            if self._dropped > logged and self._queue.empty():
                logged = self._dropped
                _log.error("the event log's disk is too slow; %d lines are lost so far", logged)


class _Lines(logging.handlers.RotatingFileHandler):
    """A rotated file of lines: the standard library's handler, which knows how to rotate."""

    def __init__(self, path: Path, max_bytes: int, backups: int) -> None:
        super().__init__(
            path, maxBytes=max_bytes, backupCount=backups, encoding="utf-8", errors="replace"
        )
        self._failed = False
        self._failing = False  # logged once, until a write succeeds again

    def write(self, line: str) -> None:
        self.handle(logging.LogRecord(__name__, logging.INFO, __file__, 0, line, None, None))

    def emit(self, record: logging.LogRecord) -> None:
        self._failed = False
        super().emit(record)
        self._failing = self._failed

    def close(self) -> None:
        try:
            super().close()
        except OSError as error:  # what could not be written before cannot be written now
            _log.error("the event log %s cannot be closed: %s", self.baseFilename, error)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: ARG002, N802 - as the base
        self._failed = True
        if not self._failing:
            _log.exception("the event log %s cannot be written; events go on", self.baseFilename)
