"""Which planned downtimes hold now: of fleet.yml, and those that a person planned."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from math import inf
from typing import NamedTuple

from ros_diagnostics_exporter import weekly
from ros_diagnostics_exporter.config.fleet import Fleet, Maintenance
from ros_diagnostics_exporter.model import Downtime

_MOST_WINDOWS = 100  # that are looked at, one after the other


class PlannedBy(NamedTuple):
    """A planned downtime: its name in fleet.yml, or the comment and author of those of a person.

    ``end`` is when it ends, Unix seconds; infinite for one without an end.
    """

    name: str
    author: str
    end: float


def lasting(
    fleet: Fleet, labels: Mapping[str, str], wall: float, downtimes: Iterable[Downtime] = ()
) -> frozenset[PlannedBy]:
    """The planned downtimes of a whole robot that hold.

    Args:
        fleet: The config.
        labels: The robot's labels, `robot` and `fleet` among them.
        wall: The time that is asked about, Unix seconds.
        downtimes: Those of this robot that people planned.
    """
    of_fleet = (each for each in fleet.maintenance if holds(each, wall))
    of_people = (each for each in downtimes if each.holds(wall) and not each.component)
    return frozenset(
        [
            *(
                PlannedBy(each.name, "", _end(each, wall))
                for each in of_fleet
                if selects(each, labels)
            ),
            *(PlannedBy(each.comment, each.author, each.end) for each in of_people),
        ]
    )


def components_in_maintenance(downtimes: Iterable[Downtime], wall: float) -> frozenset[str]:
    """The names of a robot's components that are in a downtime of their own."""
    return frozenset(each.component for each in downtimes if each.component and each.holds(wall))


def selects(maintenance: Maintenance, labels: Mapping[str, str]) -> bool:
    """Whether it is a downtime of a robot with these labels, `robot` and `fleet` among them."""
    return all(
        any(pattern.fullmatch(labels.get(label, "")) for pattern in patterns)
        for label, patterns in maintenance.selector.items()
    )


def maintenance_until(
    fleet: Fleet, labels: Mapping[str, str], wall: float, downtimes: Iterable[Downtime] = ()
) -> float | None:
    """When the planned downtimes that hold, and those that follow without a gap, are over.

    Args:
        fleet: The config.
        labels: The robot's labels, `robot` and `fleet` among them.
        wall: The time that is asked about, Unix seconds.
        downtimes: Those of this robot that people planned.

    Returns:
        Unix seconds: `wall` if none holds; None where no end is in sight.
    """
    selecting = [each for each in fleet.maintenance if selects(each, labels)]
    of_robot = [each for each in downtimes if not each.component]
    for _ in range(_MOST_WINDOWS):
        ends = [_end(each, wall) for each in selecting if holds(each, wall)]
        ends += [each.end for each in of_robot if each.holds(wall)]
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
