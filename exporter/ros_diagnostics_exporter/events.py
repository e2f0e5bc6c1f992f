"""Events: levels changed, faults began and ended, robots became silent, the config was read.

The last ones are in memory, for /api/v1/events and until the database has them; older ones are in
the database.
"""

from __future__ import annotations

import sys
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass, replace
from itertools import islice
from typing import Any

MOMENTS = ("goal", "intervention")  # in which a robot failed to do its work
KINDS = (
    *("level", "condition", "fault_began", "fault_ended"),
    *("notified", "acknowledged", "action", "robot", "graph", "config", *MOMENTS),
)
# Of faults, and of what people did about them: no other event takes their place.
OF_FAULTS = frozenset(("fault_began", "fault_ended", "notified", "acknowledged", "action"))
MAX_EVENTS = 10_000  # events in memory; some 5 MB
MAX_OF_FAULTS = 2_500  # older ones of faults, which count where there is no database
BYTES = 32 * 1024 * 1024  # of their texts, where messages are long
MESSAGE = 4_096  # characters of a message in memory


@dataclass(frozen=True)
class Event:
    """One thing that happened, at Unix time ``time``.

    ``kind`` is ``level`` (a component changed), ``condition`` (one of fleet.yml began or ceased to
    suppress a problem), ``fault_began`` or ``fault_ended`` (what is confirmed), ``notified``
    (Alertmanager sent it to a receiver), ``acknowledged``, ``action`` (a person acknowledged a
    fault, planned or cancelled a downtime by a form of a page), ``robot`` (known, forgotten,
    silent or back), ``graph`` (``message`` says what the ROS graph shows), ``config`` (read or
    rejected), ``goal`` (one was aborted) or ``intervention`` (a robot no longer works by itself);
    the message of these says what else was wrong with the robot.
    ``before`` and ``after`` are the words of levels, OK, WARN, ERROR, STALE; ``after`` may also be
    received, silent, known, forgotten, read, rejected, firing or resolved, of a condition
    suppressed or judged, of a goal aborted, of an action acknowledged, downtime or cancelled. Of a
    component that is not OK when first received, ``before`` is "". A field that does not apply is
    "", or None.

    Of a fault, ``scope``, ``state``, ``site``, ``robot``, ``group``, ``component``, ``check``,
    ``key``, ``bound`` and ``severity`` are its labels in
    `ros_diagnostics_fault_start_timestamp_seconds`, and ``since`` is that sample's value: all
    events of a fault have the same ones. ``fault`` is its id, which the service adds. ``message``
    is its evidence, or what was received when it ended. ``reason`` says how it ended: ``recovered``
    (a fresh lower level) or ``removed`` (by a person or the config).

    ``details`` is its evidence as fields, of one that began; of a goal and an intervention the
    ``problems`` of the robot at that moment.

    ``receiver`` is Alertmanager's, ``step`` that of an escalation (0 is the daily reminder).
    ``author`` acknowledged it, or did what the action is, with the words in ``message``.
    """

    time: float
    kind: str
    robot: str = ""
    group: str = ""
    component: str = ""
    before: str = ""
    after: str = ""
    message: str = ""
    scope: str = ""
    state: str = ""
    site: str = ""
    check: str = ""
    key: str = ""
    bound: str = ""
    severity: str = ""
    since: float | None = None
    reason: str = ""
    receiver: str = ""
    step: str = ""
    author: str = ""
    details: Any = None  # a mapping to JSON values
    fault: str = ""


@dataclass(frozen=True)
class Wanted:
    """Which events a reader asks for; None asks for all. ``since`` <= time < ``until``."""

    kind: str | None = None
    robot: str | None = None
    component: str | None = None
    level: str | None = None  # after the change
    fault: str | None = None  # its id
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
            (self.fault, event.fault),
        )
        return (
            all(want is None or want == have for want, have in pairs)
            and (self.since is None or event.time >= self.since)
            and (self.until is None or event.time < self.until)
        )


Numbered = tuple[int, Event]  # the id of an event, and the event


class EventLog:
    """The events, newest first. Safe from any thread.

    Args:
        last: The id of the last event of an earlier process; 0 if there is none.
        older: What finds the events that are no longer, or were never, in memory; None: nothing
            does, and of older events those of faults are kept.
    """

    def __init__(
        self, last: int = 0, older: Callable[[Wanted], Iterable[Numbered]] | None = None
    ) -> None:
        self._lock = threading.Lock()
        self._events: deque[Event] = deque()
        self._bytes = 0
        self._last = last
        self._of_faults: deque[Numbered] = deque(maxlen=MAX_OF_FAULTS)
        self._older = older or self._find_of_faults

    def record(self, event: Event) -> None:
        """Record the event; its message is truncated to 4,096 characters."""
        if len(event.message) > MESSAGE:  # a config may have any number of errors
            event = replace(event, message=event.message[:MESSAGE] + "…")
        with self._lock:
            self._events.append(event)
            self._last += 1
            self._bytes += _size(event)
            while len(self._events) > MAX_EVENTS or self._bytes > BYTES:
                self._drop_oldest()

    def _drop_oldest(self) -> None:
        number, dropped = self._last - len(self._events) + 1, self._events.popleft()
        self._bytes -= _size(dropped)
        if dropped.kind in OF_FAULTS:
            self._of_faults.append((number, dropped))

    def _find_of_faults(self, wanted: Wanted) -> Iterator[Numbered]:
        with self._lock:
            kept = list(self._of_faults)
        for number, event in reversed(kept):
            if (wanted.before is None or number < wanted.before) and wanted.matches(event):
                yield number, event

    def after(self, number: int) -> list[Numbered]:
        """The events in memory whose id is above ``number``, oldest first."""
        with self._lock:
            count = min(len(self._events), max(0, self._last - number))
            newest = list(islice(reversed(self._events), count))
            last = self._last
        return [(last - back, event) for back, event in enumerate(newest)][::-1]

    @property
    def last(self) -> int:
        """The id of the last event; 0 before the first."""
        return self._last

    def oldest(self) -> float | None:
        """When the first event in memory was, Unix time; None if there is none."""
        with self._lock:
            return self._events[0].time if self._events else None

    def find(self, wanted: Wanted) -> Iterator[dict[str, Any]]:
        """The events asked for as JSON objects, newest first, fields that do not apply left out.

        Each has an ``id``; those of later events are higher, also after a restart.
        """
        found = ({"id": number, **filled(event)} for number, event in self._find(wanted))
        return islice(found, wanted.limit)

    def _find(self, wanted: Wanted) -> Iterator[Numbered]:
        in_memory, count = self.after(0), 0
        for number, event in reversed(in_memory):
            if (wanted.before is None or number < wanted.before) and wanted.matches(event):
                count += 1
                yield number, event
        first = in_memory[0][0] if in_memory else self._last + 1
        before = first if wanted.before is None else min(first, wanted.before)
        yield from self._older(replace(wanted, before=before, limit=wanted.limit - count))


def _size(event: Event) -> int:
    """Bytes of its texts in memory."""
    texts = (event.robot, event.group, event.component, event.message, event.check, event.key)
    return sum(map(sys.getsizeof, texts)) + 2 * len(repr(event.details))


def filled(event: Event) -> dict[str, Any]:
    """Its fields without those that do not apply."""
    return {key: value for key, value in asdict(event).items() if value not in ("", None)}
