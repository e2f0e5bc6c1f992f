"""The states of a robot, its components and checks, as numbers: the ranks of `SEVERITIES`."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import NamedTuple

from ros_diagnostics_exporter.faults.model import (
    ComponentName,
    Identity,
    Scope,
    State,
    severity_of,
)
from ros_diagnostics_exporter.model import Level
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.severity import SEVERITIES, STATE_OF_LEVEL, silent_state

_OF_LEVEL = tuple(SEVERITIES[STATE_OF_LEVEL[level.name]] for level in Level)
_CRITICAL, _SILENT, _PENDING = (SEVERITIES[each] for each in ("CRITICAL", "SILENT", "PENDING"))
_FLAPPING = SEVERITIES["FLAPPING"]
_OF_FAULT = {State.FLAPPING: _FLAPPING, State.STALE: SEVERITIES["STALE"]}  # others: by severity
_NO_MESSAGE = (State.SILENT, State.PENDING)
_OF_COMPONENT = (Scope.COMPONENT, Scope.FLAPPING)
_FLAPS = (Scope.FLAPPING, State.FLAPPING)


class States(NamedTuple):
    """How urgent a robot is, and each component that is not OK.

    ``part`` is to which part of its time availability counts a robot that is FLAPPING; else "".
    """

    robot: float
    part: str
    components: dict[ComponentName, float]


def states(robot: RobotState, faults: Collection[Identity]) -> States:
    """Those by what is received, confirmed or not, and by the faults of the robot and its parts.

    What is FLAPPING is so in each of its levels. A STALE that is planned counts for no robot.
    """
    counted, planned = _by_level(robot)
    kinds = {(each.scope, each.state, each.group, each.component) for each in faults}
    if not robot.up:
        silent: float = SEVERITIES[silent_state(robot.silent_reason)]
        if silent == _SILENT and (Scope.ROBOT, State.FLAPPING, "", "") in kinds:
            return States(_FLAPPING, "silent", counted | planned)
        if silent == _PENDING and (Scope.ROBOT, State.SILENT, "", "") in kinds:
            silent = _SILENT
        return States(silent, "", counted | planned)
    shown = counted | planned
    for name in shown.keys() & {kind[2:] for kind in kinds if kind[:2] == _FLAPS}:
        del shown[name]
    ranks = [rank for name, rank in counted.items() if name in shown]
    for fault in faults:
        if fault.state not in _NO_MESSAGE:
            rank = _OF_FAULT.get(fault.state) or SEVERITIES[severity_of(fault).upper()]
            ranks.append(rank)
            if fault.scope in _OF_COMPONENT:
                name = ComponentName(fault.group, fault.component)
                shown[name] = max(rank, shown.get(name, 0))
    worst = max(ranks, default=0)
    of_level = "critical" if _CRITICAL in counted.values() else "warning"
    return States(worst, of_level if worst == _FLAPPING else "", shown)


def _by_level(robot: RobotState) -> tuple[dict[ComponentName, float], dict[ComponentName, float]]:
    """The ranks of the components that are not OK, and of those that are STALE as planned."""
    counted: dict[ComponentName, float] = {}
    planned: dict[ComponentName, float] = {}
    stale = _of_stale(robot)
    for each in robot.components:
        if each.level > Level.OK and not each.suppressed_because:
            name = ComponentName(each.group, each.label)
            if each.level == Level.STALE and each.plans_stale:
                planned[name] = _OF_LEVEL[Level.STALE]
            else:
                counted[name] = _of_component(each, stale)
    return counted, planned


def check_state(robot: RobotState, counts: Sequence[int], expected: int | None) -> float:
    """That of a check which finds so many components at each level."""
    if expected is not None and sum(counts) < expected:
        return _CRITICAL
    of_level = (*_OF_LEVEL[:-1], _of_stale(robot))
    return max([rank for rank, count in zip(of_level, counts, strict=True) if count], default=0)


def _of_stale(robot: RobotState) -> float:
    return _CRITICAL if robot.settings.profile.stale_is_critical else _OF_LEVEL[Level.STALE]


def _of_component(component: Component, stale: float) -> float:
    """That of one that is not OK, of which STALE counts as ``stale``."""
    if component.level != Level.STALE:
        return _OF_LEVEL[component.level]
    return _CRITICAL if component.before_stale == Level.ERROR else stale
