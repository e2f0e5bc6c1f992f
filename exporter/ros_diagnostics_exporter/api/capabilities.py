"""State -> the JSON of /api/v1/capabilities: the expressions of one robot, with their states."""

from __future__ import annotations

from typing import Any

from ros_diagnostics_exporter.faults.model import PartName
from ros_diagnostics_exporter.faults.needs import AtLeast, Missing, Need, NeedView
from ros_diagnostics_exporter.fleet.capabilities import robot_counts
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Instant


def capability_tree(state: FleetState, robot: str | None, now: Instant) -> dict[str, Any]:
    """What a robot, or None the fleet, can do, each after those that it needs, and what for.

    Raises:
        LookupError: there is no such robot.
    """
    views = state.needs(robot)
    return {
        "fleet": state.fleet.name,
        "robot": robot,
        "time": now.wall,
        "capabilities": [
            {
                "capability": name,
                "state": view.state.name.lower(),
                "needed": view.wanted.applies,
                "need": _need(view.wanted.need, view),
            }
            for name, view in views.items()
        ],
    }


def fleet_capabilities(state: FleetState) -> list[dict[str, Any]]:
    """What the fleet can do, with the number of robots by what they can."""
    return [
        {"capability": name, "state": view.state.name.lower(), "robots": robot_counts(view)}
        for name, view in state.needs(None).items()
    ]


def _need(need: Need, view: NeedView) -> dict[str, Any]:
    if isinstance(need, AtLeast):
        of = [_need(each, view) for each in need.of]
        return {"k": need.k, "of": of, "degraded": need.degraded.name.lower()}
    if isinstance(need, PartName):
        return {
            "part": {
                **need._asdict(),
                "state": view.parts[need].name.lower(),
                "maintenance": need in view.maintained,
            }
        }
    if isinstance(need, Missing):
        return {"missing": True}
    return {"capability": need.name}
