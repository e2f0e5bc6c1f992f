"""How well robots did their work in a week: what Prometheus recorded, and because of what not."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ros_diagnostics_exporter.mission_numbers import Work, together
from ros_diagnostics_exporter.texts import natural
from ros_diagnostics_tools.aborted import aborted_texts
from ros_diagnostics_tools.report.availability import Recorded

MOST = 10  # actions of which it is said what was wrong
_GOALS = "action:ros_diagnostics_goals:increase5m"
_INTERVENTIONS = "robot:ros_diagnostics_interventions:increase5m"
_AUTONOMOUS = "robot:ros_diagnostics_autonomous_seconds:increase5m"

Works = dict[str, Work]


def works(recorded: Recorded, end: float, days: int) -> Works:
    """The work of each robot in the ``days`` until ``end`` (Unix time), by its name."""
    goals: dict[str, dict[str, float]] = {}
    for (robot, result), number in recorded.sums(_GOALS, ("robot", "result"), end, days).items():
        goals.setdefault(robot, {})[result] = number
    helped, autonomous = (
        {robot: number for (robot,), number in recorded.sums(each, ("robot",), end, days).items()}
        for each in (_INTERVENTIONS, _AUTONOMOUS)
    )
    return {
        robot: Work(goals.get(robot, {}), helped.get(robot), autonomous.get(robot))
        for robot in goals.keys() | helped.keys() | autonomous.keys()
    }


def of_fleet(found: Works) -> dict[str, Any] | None:
    """The work of all robots together; None where no robot has goals or modes."""
    return _json(together(found.values())) if found else None


def of_robots(found: Works) -> list[dict[str, Any]]:
    """The work of each robot, the one that reached the smallest share of its goals first."""
    return [
        {"robot": robot, **_json(work)} for robot, work in sorted(found.items(), key=_worst_first)
    ]


def because(events: Iterable[dict[str, Any]], begin: float, end: float) -> list[str]:
    """What was wrong when goals were aborted and somebody had to help, in sentences.

    Args:
        events: Those of aborted goals and of interventions.
        begin: From this time on (Unix time).
        end: Until this time.
    """
    within = [each for each in events if begin <= each["time"] < end]
    return [text for _action, text in aborted_texts(within, "this week")][:MOST]


def work_of(found: dict[str, Any]) -> Work:
    """The work of which the report has the numbers."""
    return Work(found["results"], found["interventions"], found["autonomous_seconds"])


def _json(work: Work) -> dict[str, Any]:
    return {
        "results": dict(work.results),
        "interventions": work.interventions,
        "autonomous_seconds": work.autonomous,
        **work.as_json(),
    }


def _worst_first(robot_work: tuple[str, Work]) -> tuple[Any, ...]:
    robot, work = robot_work
    success = 2.0 if work.success is None else work.success
    return success, -(work.per_hour or 0.0), natural(robot)
