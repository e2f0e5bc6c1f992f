"""State -> the JSON of /api/v1/missions: goals, interventions and autonomy of each robot."""

from __future__ import annotations

from typing import Any

from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.mission_numbers import work_of
from ros_diagnostics_exporter.model import Instant, Level
from ros_diagnostics_exporter.robots.missions import Action
from ros_diagnostics_exporter.robots.robot import RobotState


def missions(state: FleetState, robot: str | None, now: Instant) -> dict[str, Any]:
    """The missions of one robot, or (None) of all robots that have an action or a mode.

    Raises:
        LookupError: there is no such robot.
    """
    if robot is not None and robot not in state.robots:
        raise LookupError(f"no robot {robot!r}")
    found = state.visit(lambda each: _missions(each, now) if _is_asked(each, robot) else None)
    robots = [each for each in found if each is not None]
    return {"fleet": state.fleet.name, "time": now.wall, "robots": robots}


def _is_asked(each: RobotState, robot: str | None) -> bool:
    return robot in (None, each.settings.name)


def _missions(robot: RobotState, now: Instant) -> dict[str, Any] | None:
    known = robot.missions
    if known is None:
        return None
    autonomy: dict[str, Any] = {}
    if known.autonomy is not None:
        autonomy = {
            "autonomous": known.mode[0],
            "autonomous_seconds": round(known.autonomy.read(now.mono), 3),
            "interventions": known.autonomy.interventions,
        }
    actions = [_action(each, now) for _name, each in sorted(known.actions.items())]
    counted = {"since": known.since or None, "actions": actions, **autonomy}
    return {
        "robot": robot.settings.name,
        **counted,
        "numbers": work_of(counted).as_json(),
    }


def _action(action: Action, now: Instant) -> dict[str, Any]:
    goals, status = action.goals, action.status
    level = {} if status is None else {"level": Level(status.level).name, "message": status.message}
    return {
        "action": action.name,
        "mission": action.is_mission,
        "reached": not goals.is_away,
        **level,
        "running": goals.running,
        "longest": round(goals.longest(now.mono), 3),
        "results": dict(goals.counts.results),
    }
