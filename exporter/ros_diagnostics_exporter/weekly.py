"""Times of each week by a local clock: whether they hold, and when that changes."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import date, datetime, time, timedelta
from functools import lru_cache
from math import inf
from zoneinfo import ZoneInfo

# (weekday 0 = Monday, from, to) in minutes of that day's clock, above 1440 on the day after
Weekly = tuple[tuple[int, int, int], ...]


@lru_cache(maxsize=256)  # asked for every robot, every second
def holds(weekly: Weekly, time_zone: str, minute: int) -> bool:
    """Whether one of the times that began today or yesterday holds in a minute of Unix time.

    Begin and end are readings of the local clock, made absolute: a window across a change of
    the clock is an hour shorter or longer, as a shift is. A reading that happens twice means the
    first time, one that is skipped means as long after the change as it would have been after.
    """
    zone = ZoneInfo(time_zone)
    today = datetime.fromtimestamp(minute * 60, zone).date()
    return any(
        begin <= minute * 60 < end
        for day in (today, today - timedelta(days=1))
        for begin, end in _on(weekly, zone, day)
    )


def next_change(weekly: Weekly, time_zone: str, wall: float) -> float:
    """When, in Unix time after ``wall``, they begin or end to hold; infinite if never."""
    zone = ZoneInfo(time_zone)
    today = datetime.fromtimestamp(wall, zone).date()
    days = [today + timedelta(days=days) for days in range(-1, 9)]
    edges = {edge for day in days for window in _on(weekly, zone, day) for edge in window}
    now = holds(weekly, time_zone, int(wall // 60))
    changes = (
        edge
        for edge in sorted(edges)
        if edge > wall and holds(weekly, time_zone, int(edge // 60)) != now
    )
    return next(changes, inf)


def _on(weekly: Weekly, zone: ZoneInfo, day: date) -> Iterator[tuple[float, float]]:
    """Begin and end, in Unix time, of the times that begin on a day."""
    midnight = datetime.combine(day, time())
    for weekday, first, last in weekly:
        if weekday == day.weekday():
            begin = (midnight + timedelta(minutes=first)).replace(tzinfo=zone)
            end = (midnight + timedelta(minutes=last)).replace(tzinfo=zone)
            yield begin.timestamp(), end.timestamp()
