"""What the event log says of a week: times to acknowledge and to recover, worst parts, nights.

Faults are given as `ros_diagnostics_exporter.api.occurrences` returns them. The
exporter's families of the week and `ros-diagnostics report --week` have these numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import date, datetime, timedelta, timezone
from itertools import chain, takewhile
from statistics import median
from typing import Any

from ros_diagnostics_exporter.api.occurrences import (
    KINDS,
    WEEK,
    fault_key,
    occurrences,
    spells,
)
from ros_diagnostics_exporter.metrics.week import FaultyPart, Lengths, Week
from ros_diagnostics_exporter.severity import subject

BEFORE = 2 * WEEK  # that are asked for before it, where faults of it may have begun
MOST = 20_000  # events of each kind above which the week is not counted
READ_ANEW = 3_600.0  # seconds: once in each of these all events are read again
MOST_PARTS = 10
EVENING, MORNING = 22, 6  # o'clock: what is between them is the night


def week(faults: Iterable[dict[str, Any]], end: float) -> Week:
    """The numbers of the seven days until ``end`` (Unix time)."""
    found, begin = list(faults), end - WEEK
    sent = notified(found, begin, end)
    return Week(
        len(begun(found, begin, end)),
        to_acknowledge(found, begin, end),
        to_recover(found, begin, end),
        len(sent),
        worst_parts(found, begin, end),
        by_night(sent, begin, end),
    )


class Counting:
    """The numbers of the week, counted again and again: of the events it reads those that are new.

    Args:
        find: The events that match, newest first, read as they are taken; its arguments are those
            of `Wanted`.
    """

    def __init__(self, find: Callable[..., Iterable[dict[str, Any]]]) -> None:
        self._find = find
        self._faults: list[dict[str, Any]] = []  # of all events that were read
        self._read: dict[str, int] = {}  # the id of the last of each kind
        self._hour: float | None = None  # in which all were read

    def count(self, lasting: Iterable[dict[str, Any]], wall: float) -> Week | None:
        """The numbers of the seven days until now; None of too many events.

        Args:
            lasting: The faults of /api/v1/faults.
            wall: The present by the host's clock, Unix time.
        """
        hour, self._hour = self._hour, wall // READ_ANEW
        if hour != self._hour:  # the disk may have kept some back, or the clock been set
            self._faults, self._read = [], dict.fromkeys(KINDS, 0)
        new = {kind: self._new(kind, wall - WEEK - BEFORE) for kind in KINDS}
        self._read |= {kind: each[0]["id"] for kind, each in new.items() if each}
        self._faults = occurrences(chain(*new.values()), self._faults)
        kept = [sum(len(each[of]) for each in self._faults) for of in ("notified", "acknowledged")]
        if max(len(self._faults), *kept, *map(len, new.values())) >= MOST:
            return None
        return week(known(self._faults, lasting), wall)

    def _new(self, kind: str, since: float) -> list[dict[str, Any]]:
        """Without their messages, which take most of the memory."""
        found = self._find(kind=kind, since=since, limit=MOST)
        new = takewhile(lambda each: each["id"] > self._read[kind], found)
        return [{**each, "message": ""} for each in new]


def known(
    faults: Iterable[dict[str, Any]], lasting: Iterable[dict[str, Any]]
) -> list[dict[str, Any]]:
    """Those of the event log; of those without an end only the ones that last now.

    Args:
        faults: As `occurrences` returns them.
        lasting: The faults of /api/v1/faults; one whose events are gone counts as well.
    """
    last = {fault_key(each): each for each in lasting}
    found = []
    for fault in faults:
        is_lasting = last.pop(fault_key(fault), None) is not None
        if fault["until"] is not None or is_lasting:
            found.append(fault)
    gone: dict[str, Any] = {"until": None, "reason": None, "acknowledged": [], "notified": []}
    return found + [{**each, **gone} for each in last.values()]


def begun(faults: Iterable[dict[str, Any]], begin: float, end: float) -> list[dict[str, Any]]:
    """The critical faults that were confirmed in a time."""
    return [
        each
        for each in faults
        if each["severity"] == "critical" and _is_in(each["confirmed"], begin, end)
    ]


def to_acknowledge(faults: Iterable[dict[str, Any]], begin: float, end: float) -> Lengths:
    """From when critical faults of that time were confirmed until somebody acknowledged them."""
    return _times(
        min(taken["at"] for taken in each["acknowledged"]) - each["confirmed"]
        for each in begun(faults, begin, end)
        if each["acknowledged"]
    )


def to_recover(faults: Iterable[dict[str, Any]], begin: float, end: float) -> Lengths:
    """From when the trouble began until the recovery of critical faults that recovered then."""
    return _times(
        each["until"] - each["since"]
        for each in faults
        if each["severity"] == "critical"
        and each["reason"] == "recovered"
        and _is_in(each["until"], begin, end)
    )


def worst_parts(faults: Iterable[dict[str, Any]], begin: float, end: float) -> list[FaultyPart]:
    """The parts that were faulty for longest in that time; faults that overlap count once."""
    known: dict[tuple[str, str], list[dict[str, Any]]] = {}
    for each in faults:
        known.setdefault((each["robot"] or each["site"], subject(each)), []).append(each)
    found = []
    for (robot, part), of_one in known.items():
        within = [
            (max(begin, each.since), end if each.until is None else min(end, each.until))
            for each in spells(of_one)
        ]
        lengths = [last - first for first, last in within if last > first]
        if lengths:
            found.append(FaultyPart(robot, part, len(lengths), sum(lengths)))
    return sorted(found, key=lambda each: (-each.seconds, each))[:MOST_PARTS]


def notified(faults: Iterable[dict[str, Any]], begin: float, end: float) -> list[float]:
    """When notifications that a fault lasts were sent in that time, in order."""
    return sorted(
        sent["at"]
        for each in faults
        for sent in each["notified"]
        if sent["after"] == "firing" and _is_in(sent["at"], begin, end)
    )


def by_night(sent: Iterable[float], begin: float, end: float) -> dict[str, int]:
    """How many of these were sent in each night; a night has the date of its evening."""
    first, last = local(begin).date(), _evening(local(end - 1))
    found = {str(first + timedelta(days=n)): 0 for n in range((last - first).days + 1)}
    for at in sent:
        then = local(at)
        if then.hour >= EVENING or then.hour < MORNING:
            evening = str(_evening(then))
            found[evening] = found.get(evening, 0) + 1
    return dict(sorted(found.items()))


def local(at: float) -> datetime:
    """A Unix time by the clock of the host, which changes twice a year in many places."""
    return datetime.fromtimestamp(at, timezone.utc).astimezone()


def _evening(then: datetime) -> date:
    """The date of the last evening that had begun then."""
    return then.date() if then.hour >= EVENING else then.date() - timedelta(days=1)


def _is_in(at: float | None, begin: float, end: float) -> bool:
    return at is not None and begin <= at < end


def _times(seconds: Iterable[float]) -> Lengths:
    found = list(seconds)
    return Lengths(len(found), median(found) if found else None, max(found, default=None))
