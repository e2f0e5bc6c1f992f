"""How urgent a robot and its checks are, as numbers: the ranks of `severity.SEVERITIES`."""

from __future__ import annotations

from collections.abc import Sequence

from ros_diagnostics_exporter.model import Level
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.severity import SEVERITIES, STATE_OF_LEVEL, silent_state

_OF_LEVEL = tuple(SEVERITIES[STATE_OF_LEVEL[level.name]] for level in Level)
_CRITICAL = SEVERITIES["CRITICAL"]


def robot_state(robot: RobotState) -> float:
    """Why it is not received, or the worst of its components; confirmed or not."""
    if not robot.up:
        return SEVERITIES[silent_state(robot.silent_reason)]
    stale = _of_stale(robot)
    bad = [each for each in robot.components if each.level > Level.OK]
    return max([_of_component(each, stale) for each in bad]) if bad else 0


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
    if component.suppressed_because:
        return 0
    if component.level != Level.STALE:
        return _OF_LEVEL[component.level]
    if component.rule is not None and component.rule.planned_stale:
        return 0
    return _CRITICAL if component.before_stale == Level.ERROR else stale
