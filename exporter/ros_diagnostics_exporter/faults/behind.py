"""What a component is behind, by fleet.yml: while that fails, no trouble that follows begins.

A computer that fails takes all with it that runs on it; its own fault is the one that people need.
What is ERROR or flaps explains any trouble behind it; what is STALE only that others are STALE.
"""

from __future__ import annotations

from ros_diagnostics_exporter.faults import causes
from ros_diagnostics_exporter.faults.book import TIME_TO_RETURN, Book
from ros_diagnostics_exporter.faults.model import ComponentName
from ros_diagnostics_exporter.faults.records import (
    ComponentRecord,
    Fails,
    RobotRecord,
)
from ros_diagnostics_exporter.model import Instant


def follow(
    book: Book, component: ComponentRecord, before: tuple[Fails, Instant | None], now: Instant
) -> None:
    """Judge again what is behind a component, if it fails now and did not ``before``, or ended to.

    Once it is well, the others have as long as it had failed to be so, too, and count from then.
    ``before`` is whether it failed, and since when it was not OK.
    """
    failed, since = before
    if component.fails is failed:
        return
    if component.fails is None and since is not None:
        lasted = min(now.mono - since.mono, TIME_TO_RETURN)
        for each in _behind(component.robot, component.name):
            each.explained_until = max(each.explained_until, now.mono + lasted)
            book.write(each)
    judge_others(book, component.robot, component.name)


def judge_others(book: Book, robot: RobotRecord, name: ComponentName) -> None:
    """Judge again what is behind a component."""
    for each in _behind(robot, name):
        causes.count_component(book, each)
        book.touch((*each.problems.values(), *each.values.values()))
    book.touched_causes[robot.many] = None


def _behind(robot: RobotRecord, name: ComponentName) -> list[ComponentRecord]:
    return [each for each in robot.components.values() if name in each.settings.behind]
