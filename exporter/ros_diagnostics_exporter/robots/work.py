"""What a robot can no longer do, and what it still can, by the components that its tasks need.

A fault keeps it from when it began; notifications begin with it.
"""

from __future__ import annotations

from collections.abc import Iterable

from ros_diagnostics_exporter.model import Level
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.robot import Robot
from ros_diagnostics_exporter.robots.rules import SEARCHED


def work(robot: Robot, also: Component | None = None) -> str:
    """Such as "cannot drive or lift but can still charge"; "" where no tasks are named.

    A task cannot be done while a component that it needs is ERROR or STALE. Nothing is said of a
    robot that is silent.

    Args:
        robot: Which robot.
        also: A component that is taken for broken, whatever its level.
    """
    tasks = robot.settings.profile.tasks
    if not tasks or not robot.up:
        return ""
    broken = [
        each.identity[0][:SEARCHED] for each in robot.components if each is also or _is_broken(each)
    ]
    lost = {
        task
        for task, patterns in tasks.items()
        if any(pattern.search(name) for pattern in patterns for name in broken)
    }
    left = [task for task in tasks if task not in lost]
    return " but ".join(_parts([task for task in tasks if task in lost], left))


def _parts(lost: list[str], left: list[str]) -> Iterable[str]:
    if lost:
        yield f"cannot {' or '.join(lost)}"
    if left:
        yield f"can still {' and '.join(left)}"


def _is_broken(component: Component) -> bool:
    if component.quiet_because:
        return False
    if component.level == Level.STALE:
        return component.rule is None or not component.rule.planned_stale
    return component.level == Level.ERROR
