"""What the event log says of a week: times to acknowledge and to recover, worst parts, nights.

Pure functions. Faults are given as `ros_diagnostics_exporter.api.story` returns them. The
exporter's families of the week and `ros-diagnostics report --week` have these numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from datetime import datetime, timedelta, timezone, tzinfo
from statistics import median
from typing import Any

from ros_diagnostics_exporter.api.story import KINDS, LABELS, WEEK, occurrences, spells
from ros_diagnostics_exporter.metrics.week import FaultyPart, Lengths, Week
from ros_diagnostics_exporter.severity import subject

BEFORE = 2 * WEEK  # that are asked for before it, where faults of it may have begun
MOST = 20_000  # events of each kind above which the week is not counted
MOST_PARTS = 10
EVENING, MORNING = 22, 6  # o'clock: what is between them is the night


def week(faults: Iterable[dict[str, Any]], end: float, zone: tzinfo) -> Week:
    """The numbers of the seven days until ``end`` (Unix time); ``zone`` is that of its nights."""
    found, begin = list(faults), end - WEEK
    sent = notified(found, begin, end)
    return Week(
        len(begun(found, begin, end)),
        to_acknowledge(found, begin, end),
        to_recover(found, begin, end),
        len(sent),
        worst_parts(found, begin, end),
        by_night(sent, begin, end, zone),
    )


def counted(
    find: Callable[..., list[dict[str, Any]]], lasting: Iterable[dict[str, Any]], wall: float
) -> Week | None:
    """The numbers of the seven days until now, by the host's clock; None of too many events.

    Args:
        find: The events that match, newest first; its arguments are those of `Wanted`.
        lasting: The faults of /api/v1/faults.
        wall: The present, Unix time.
    """
    events: list[dict[str, Any]] = []
    for kind in KINDS:
        found = find(kind=kind, since=wall - WEEK - BEFORE, limit=MOST)
        if len(found) == MOST:
            return None
        events += found
    zone = datetime.fromtimestamp(wall, timezone.utc).astimezone().tzinfo
    return week(known(events, lasting), wall, zone or timezone.utc)


def known(
    events: Iterable[dict[str, Any]], lasting: Iterable[dict[str, Any]]
) -> list[dict[str, Any]]:
    """The faults of these events; of those without an end only the ones that last now.

    Args:
        events: As /api/v1/events has them.
        lasting: The faults of /api/v1/faults; one whose events are gone counts as well.
    """
    last = {_key(each): each for each in lasting}
    found = []
    for fault in occurrences(events):
        is_lasting = last.pop(_key(fault), None) is not None
        if fault["until"] is not None or is_lasting:
            found.append(fault)
    gone: dict[str, Any] = {"until": None, "reason": None, "acknowledged": [], "notified": []}
    return found + [{**each, **gone} for each in last.values()]


def _key(fault: dict[str, Any]) -> tuple[Any, ...]:
    return tuple(fault[name] for name in (*LABELS, "since"))


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


def by_night(sent: Iterable[float], begin: float, end: float, zone: tzinfo) -> dict[str, int]:
    """How many of these were sent in each night; a night has the date of its evening."""
    first, last = (datetime.fromtimestamp(each, zone).date() for each in (begin, end - 1))
    found = {str(first + timedelta(days=n)): 0 for n in range((last - first).days + 1)}
    for at in sent:
        then = datetime.fromtimestamp(at, zone)
        evening = then.date() if then.hour >= EVENING else then.date() - timedelta(days=1)
        if then.hour >= EVENING or then.hour < MORNING:
            found[str(evening)] = found.get(str(evening), 0) + 1
    return dict(sorted(found.items()))


def _is_in(at: float | None, begin: float, end: float) -> bool:
    return at is not None and begin <= at < end


def _times(seconds: Iterable[float]) -> Lengths:
    found = list(seconds)
    return Lengths(len(found), median(found) if found else None, max(found, default=None))
