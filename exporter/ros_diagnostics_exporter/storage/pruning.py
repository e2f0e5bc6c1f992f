"""Which events go because they are too old, or because the database is too large.

Beyond the size the robot with the most events loses its oldest ones, so that no robot takes what
belongs to another. Events of faults, of notifications and of what people did go only where there
are no others: a component that changes ten times a second is no reason to lose a fault.
"""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from ros_diagnostics_exporter.events import OF_FAULTS, Event
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.storage.retention import LEAST
from ros_diagnostics_exporter.storage.schema import OF_NO_FAULT

BLOCK = 200  # events of one robot that go at a time


class Bounds(NamedTuple):
    """``oldest``, ``newest``: Unix times before and until which events may be too old.

    A later event than ``newest``, which is now, is of a clock that was wrong, and keeps none.
    ``size`` is in bytes of the database.
    """

    oldest: float
    newest: float
    size: int


class Pruned(NamedTuple):
    """Whether there is room for more than `LEAST` events, and whose went for their number."""

    has_room: bool
    early: Counter[str]


class Early:
    """Whose events went before they were too old; ``counts`` are those of the robots with most."""

    RECENT = 600.0  # seconds for which it is a fault
    MOST = 1_000  # robots
    NAMED = 3

    def __init__(self) -> None:
        self.counts = Counter[str]()
        self._at = float("-inf")
        self._last = Counter[str]()

    def note(self, early: Counter[str], now: Instant) -> None:
        """Note what one transaction deleted."""
        if not early:
            return
        self._last = early + (self._last if self._is_recent(now) else Counter())
        self._at = now.mono
        self.counts = Counter(dict((self.counts + early).most_common(self.MOST)))

    def reason(self, now: Instant) -> str:
        """What is wrong; "" where nothing went of late."""
        if not self._is_recent(now):
            return ""
        named = [
            f"{robot or 'of no robot'}: {n:,}" for robot, n in self._last.most_common(self.NAMED)
        ]
        more = len(self._last) - len(named)
        named += [f"and of {more} more robots"] if more > 0 else []
        return (
            "--storage.retention.size is too small: events are deleted that are not older than"
            f" --storage.retention.time ({', '.join(named)})"
        )

    def _is_recent(self, now: Instant) -> bool:
        return now.mono - self._at < self.RECENT


class Pruner:
    """Deletes events of one open database; to be used in a transaction."""

    def __init__(self, connection: sqlite3.Connection) -> None:
        self._connection = connection
        self._counts: dict[bool, Counter[str]] | None = None  # of faults or not: by robot

    def note(self, events: Iterable[tuple[int, Event]]) -> Iterator[tuple[int, Event]]:
        """Count events that are being written."""
        for number, event in events:
            if self._counts is not None:
                self._counts[event.kind in OF_FAULTS][event.robot] += 1
            yield number, event

    def prune(self, count: int, bounds: Bounds) -> Pruned:
        """Delete up to ``count`` events that are too old, and up to ``count`` that are too many."""
        if last := self._last_old(count, bounds):
            self._connection.execute("DELETE FROM events WHERE id <= ?", (last,))
            self._counts = None
        early = Counter[str]()
        if self.used <= bounds.size:
            return Pruned(True, early)
        counts = self._counts = self._counts or self._counted()
        most = sum(map(Counter.total, counts.values())) - LEAST
        left = min(count, most)
        while left > 0 and self.used > bounds.size:
            robot, deleted = self._delete_of_largest(counts, min(left, BLOCK))
            early[robot] += deleted
            left -= deleted
        return Pruned(most > count or self.used <= bounds.size, +early)

    @property
    def used(self) -> int:
        """Bytes of the pages that are in use."""
        names = "page_count", "freelist_count", "page_size"
        pages, free, size = (
            self._connection.execute(f"PRAGMA {name}").fetchone()[0] for name in names
        )
        return int((pages - free) * size)

    def _delete_of_largest(self, counts: dict[bool, Counter[str]], most: int) -> tuple[str, int]:
        """Delete the oldest events of the robot that has the most; whose, and how many."""
        is_of_faults = not counts[False]
        condition = f"NOT ({OF_NO_FAULT})" if is_of_faults else OF_NO_FAULT
        [(robot, number)] = counts[is_of_faults].most_common(1)
        deleted = self._connection.execute(
            "DELETE FROM events WHERE id IN (SELECT id FROM events"  # noqa: S608 - our own names
            f" WHERE robot = ? AND {condition} ORDER BY id LIMIT ?)",
            (robot, most),
        ).rowcount
        counts[is_of_faults][robot] -= deleted
        if deleted in (0, number):
            del counts[is_of_faults][robot]
        return robot, deleted

    def _counted(self) -> dict[bool, Counter[str]]:
        """How many there are of each robot, by indexes alone."""
        by_robot = "GROUP BY robot"
        all_of, others = (
            Counter(dict(self._connection.execute(f"SELECT robot, count(*) FROM events {rest}")))  # noqa: S608
            for rest in (by_robot, f"WHERE {OF_NO_FAULT} {by_robot}")
        )
        return {False: others, True: all_of - others}

    def _last_old(self, count: int, bounds: Bounds) -> int:
        """The last of the events at the beginning that are too old; 0: none is."""
        last = 0
        for number, time in self._connection.execute(
            "SELECT id, time FROM events WHERE time <= ? ORDER BY id LIMIT ?",
            (bounds.newest, count),
        ):
            if time >= bounds.oldest:
                break
            last = number
        return last
