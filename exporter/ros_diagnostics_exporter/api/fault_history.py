"""The history of a robot's faults: what happened in order, from leaving OK to notifications.

Events are given as /api/v1/events returns them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

from ros_diagnostics_exporter.event_texts import event_text
from ros_diagnostics_exporter.fleet_texts import downtime_texts
from ros_diagnostics_exporter.model import Level
from ros_diagnostics_exporter.severity import notice, standing, subject
from ros_diagnostics_exporter.texts import one_line

BEFORE = 3_600.0  # seconds that are looked at where there was no fault
LATE = 600.0  # seconds after a fault's end in which its recovery is notified
_OF_MANY = {"site": "site", "common": "component"}  # scope -> what of it names the robots
_TROUBLE = {Level.ERROR.name, Level.STALE.name}
_FAULT = ("scope", "state", "group", "component", "check", "key", "bound", "since")

Event = dict[str, Any]


class Window(NamedTuple):
    """The Unix times between which events belong to the history."""

    since: float
    until: float


def window(began: Iterable[Event], ended: Iterable[Event], at: float) -> Window:
    """The time of the faults that lasted ``at`` a Unix time or had just ended, or else of the last.

    A fault whose recovery may just have been notified counts beside one that goes on.

    Args:
        began: The faults that began before, the newest first.
        ended: Those that ended, whenever.
        at: Of what time the history is to be.
    """
    ends = {_fault(each): each["time"] for each in ended}
    faults = [(each["since"], ends.get(_fault(each), float("inf"))) for each in began]
    if not faults:
        return Window(at - BEFORE, at + LATE)
    recent = [each for each in faults if each[1] >= at - LATE]
    lasting = recent or [max(faults, key=lambda fault: fault[1])]
    # A level's event is as old as the trouble, to the rounding of what is stored.
    return Window(min(each[0] for each in lasting) - 1, max(each[1] for each in lasting) + LATE)


def fault_history(
    find: Callable[..., list[Event]],
    known: dict[str, Any],
    component: str | None,
    at: float,
    now: float,
) -> dict[str, Any]:
    """The history of a robot, or of one component of it, and how its problems stand.

    Args:
        find: The events that match, newest first; its arguments are those of `Wanted`.
        known: The robot as `snapshot.robot_snapshot` has it.
        component: Only this component and the whole robot; None for all.
        at: Of what Unix time the history is to be.
        now: The present.
    """
    robot = known["robot"]
    began = find(kind="fault_began", robot=robot, component=component, until=at, limit=100)
    ended = find(kind="fault_ended", robot=robot, component=component, limit=1_000)
    since, until = window(began, ended, at)
    own = find(robot=robot, since=since, until=until, limit=1_000)
    of_many = find(robot="", since=since, until=until, limit=100)
    problems = [each for each in known["problems"] if component in (None, each["component"])]
    recorded = [each["recording"] for each in problems if each["recording"]]
    return {
        "robot": robot,
        "component": component,
        "time": now,
        "at": at,
        "entries": entries(own, of_many, component, known["labels"].get("site", "")),
        "now": [
            *(standings(problems, now, known) or ["there is no problem"]),
            *(f"recorded around its begin: {each}" for each in recorded),
        ],
    }


def _fault(event: Event) -> tuple[Any, ...]:
    return tuple(event.get(name, "") for name in _FAULT)


def entries(
    of_robot: Iterable[Event], of_many: Iterable[Event], component: str | None, site: str
) -> list[dict[str, Any]]:
    """Time and sentence of each event that is of the robot, in order.

    Args:
        of_robot: The robot's events.
        of_many: Events of no robot: those of its site, and of components on many robots, count.
        component: Only this component's events and those of the whole robot; None for all.
        site: The robot's.
    """
    kept = [
        each for each in of_robot if component is None or each.get("component") in (None, component)
    ]
    # A common fault is also this robot's where its own component was in trouble.
    common = {each.get("component") for each in kept if each.get("after") in _TROUBLE}
    for each in of_many:
        name = each.get(_OF_MANY.get(each.get("scope", ""), ""))
        if name is not None and (name == site if each["scope"] == "site" else name in common):
            kept.append(each)
    kept.sort(key=lambda each: (each["time"], each["id"]))
    return [{"time": each["time"], "text": one_line(event_text(each))} for each in kept]


def standings(problems: Iterable[dict[str, Any]], now: float, robot: dict[str, Any]) -> list[str]:
    """The robot's downtimes; how each problem stands, why it is suppressed, who was notified."""
    return [*map(one_line, downtime_texts(robot, now)), *_standings(problems, now, robot)]


def _standings(problems: Iterable[dict[str, Any]], now: float, robot: dict[str, Any]) -> list[str]:
    return [
        one_line(
            "; ".join(
                filter(
                    None,
                    (
                        f"{each['state']} {subject(each)}: {standing(each, now, robot)}",
                        notice(each, now),
                    ),
                )
            )
        )
        for each in problems
    ]
