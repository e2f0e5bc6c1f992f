"""Whether a planned downtime holds now, for a robot with these labels."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, time, timedelta
from functools import lru_cache
from zoneinfo import ZoneInfo

from ros_diagnostics_exporter.config.fleet import Fleet, Maintenance


def in_maintenance(fleet: Fleet, labels: Mapping[str, str], wall: float) -> bool:
    """Whether any planned downtime of `fleet` holds.

    Args:
        fleet: The config.
        labels: The robot's labels, `robot` and `fleet` among them.
        wall: The time that is asked about, Unix seconds.
    """
    return any(holds(each, wall) and _selects(each, labels) for each in fleet.maintenance)


def _selects(maintenance: Maintenance, labels: Mapping[str, str]) -> bool:
    return all(
        any(pattern.fullmatch(labels.get(label, "")) for pattern in patterns)
        for label, patterns in maintenance.selector.items()
    )


def holds(maintenance: Maintenance, wall: float) -> bool:
    """Whether the downtime holds at a Unix time, whichever the robot; the end is exclusive."""
    if maintenance.start is not None and wall < maintenance.start:
        return False
    if maintenance.end is not None and wall >= maintenance.end:
        return False
    week, zone = maintenance.weekly, maintenance.time_zone
    return not week or _in_week(week, zone, int(wall // 60))


@lru_cache(maxsize=256)  # asked for every robot, every second
def _in_week(weekly: tuple[tuple[int, int, int], ...], time_zone: str, minute: int) -> bool:
    """Whether a weekly window that began today or yesterday is open in a minute of Unix time.

    Begin and end are readings of the local clock, made absolute: a window across a change of
    the clock is an hour shorter or longer, as a shift is. A reading that happens twice means the
    first time, one that is skipped means as long after the change as it would have been after.
    """
    zone = ZoneInfo(time_zone)
    today = datetime.fromtimestamp(minute * 60, zone).date()
    for day in (today, today - timedelta(days=1)):
        midnight = datetime.combine(day, time())
        for weekday, first, last in weekly:
            if weekday == day.weekday():
                begin = (midnight + timedelta(minutes=first)).replace(tzinfo=zone)
                end = (midnight + timedelta(minutes=last)).replace(tzinfo=zone)
                if begin.timestamp() <= minute * 60 < end.timestamp():
                    return True
    return False
