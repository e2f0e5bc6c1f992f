"""Whether a planned downtime holds now, for a robot with these labels."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from math import inf

from ros_diagnostics_exporter import weekly
from ros_diagnostics_exporter.config.fleet import Fleet, Maintenance

_MOST_WINDOWS = 100  # that are looked at, one after the other


def in_maintenance(fleet: Fleet, labels: Mapping[str, str], wall: float) -> bool:
    """Whether any planned downtime of `fleet` holds.

    Args:
        fleet: The config.
        labels: The robot's labels, `robot` and `fleet` among them.
        wall: The time that is asked about, Unix seconds.
    """
    return any(holds(each, wall) and selects(each, labels) for each in fleet.maintenance)


def selects(maintenance: Maintenance, labels: Mapping[str, str]) -> bool:
    """Whether it is a downtime of a robot with these labels, `robot` and `fleet` among them."""
    return all(
        any(pattern.fullmatch(labels.get(label, "")) for pattern in patterns)
        for label, patterns in maintenance.selector.items()
    )


def maintenance_until(fleet: Fleet, labels: Mapping[str, str], wall: float) -> float | None:
    """When the planned downtimes that hold, and those that follow without a gap, are over.

    Args:
        fleet: The config.
        labels: The robot's labels, `robot` and `fleet` among them.
        wall: The time that is asked about, Unix seconds.

    Returns:
        Unix seconds: `wall` if none holds; None where no end is in sight.
    """
    selecting = [each for each in fleet.maintenance if selects(each, labels)]
    for _ in range(_MOST_WINDOWS):
        ends = [_end(each, wall) for each in selecting if holds(each, wall)]
        if not ends:
            return wall
        wall = max(ends)
        if wall == inf:
            break
    return None


def holds(maintenance: Maintenance, wall: float) -> bool:
    """Whether the downtime holds at a Unix time, whichever the robot; the end is exclusive."""
    if maintenance.start is not None and wall < maintenance.start:
        return False
    if maintenance.end is not None and wall >= maintenance.end:
        return False
    week, zone = maintenance.weekly, maintenance.time_zone
    return not week or weekly.holds(week, zone, int(wall // 60))


def _end(maintenance: Maintenance, wall: float) -> float:
    """When a downtime that holds ends; infinite for one without an end."""
    end = inf if maintenance.end is None else maintenance.end
    if not maintenance.weekly:
        return end
    return min(end, _end_in_week(maintenance.weekly, maintenance.time_zone, int(wall // 60)))


@lru_cache(maxsize=256)  # asked for every robot that is in maintenance, for every page
def _end_in_week(week: weekly.Weekly, time_zone: str, minute: int) -> float:
    return weekly.next_change(week, time_zone, minute * 60)
