"""What a person or the config takes out or renames: its faults end as removed."""

from __future__ import annotations

from dataclasses import replace

from ros_diagnostics_exporter.faults import capabilities, causes, components, ends, trends
from ros_diagnostics_exporter.faults.book import TIME_TO_RETURN, Book
from ros_diagnostics_exporter.faults.judge import end_all
from ros_diagnostics_exporter.faults.model import Change, ComponentName, Scope, State
from ros_diagnostics_exporter.faults.records import Cause, ComponentRecord, Problem, RobotRecord
from ros_diagnostics_exporter.model import Instant


def remove_robot(book: Book, robot: RobotRecord, now: Instant) -> list[Change]:
    """Take out a robot with all its parts."""
    changes: list[Change] = []
    for name in sorted(robot.components):
        changes += remove_component(book, robot, name, now)
    changes += end_all(book, robot.all_problems(), now)
    leave_site(book, robot, now)
    book.touched_causes.pop(robot.many, None)
    book.touched_robots.pop(robot, None)
    for capability in robot.capabilities.values():
        book.write(capability)
    for kind in ("returned", "waits", "presence", "trends"):
        book.timers.clear((kind, robot))
    book.write(robot.many)
    book.write(robot)
    del book.robots[robot.name]
    return changes


def remove_component(
    book: Book, robot: RobotRecord, name: ComponentName, now: Instant
) -> list[Change]:
    """Take out a component, if it has a record."""
    trends.drop(robot, name)
    changes = end_all(book, capabilities.follow_component(book, robot, name, None), now)
    component = robot.components.get(name)
    if component is None:
        return changes
    _uncount(book, component)
    component.since, component.flaps = None, None
    changes += end_all(book, (*component.problems.values(), *component.values.values()), now)
    if name in robot.components:  # it went with its last problem, if it had one
        book.drop_component(component)
    _thin(book, robot.many)
    return changes


def move_component(
    book: Book, robot: RobotRecord, old: ComponentName, new: ComponentName, now: Instant
) -> list[Change]:
    """Give a component another name: each of its faults ends under the old and begins here."""
    if old == new:
        return []
    trends.drop(robot, old)
    changes = remove_component(book, robot, new, now)
    capabilities.follow_component(book, robot, old, new)
    component = robot.components.get(old)
    if component is None:
        return changes
    counted, problems = component.counted, list(component.all_problems())
    _uncount(book, component)
    book.drop_component(component)
    component.name, component.counted, component.noted = new, counted, None
    component.row = ("component", (robot.name, *new))
    book.add_component(component)
    for problem in problems:
        changes += _rename(book, problem, new, now)
    components.wake(book, component)
    causes.count_component(book, component, now)
    return changes


def _rename(book: Book, problem: Problem, name: ComponentName, now: Instant) -> list[Change]:
    del book.problems[problem.identity]
    book.write(problem)
    ended = problem.fault
    problem.identity = problem.identity._replace(group=name.group, component=name.component)
    problem.row = ("problem", problem.identity)
    book.problems[problem.identity] = problem
    book.write(problem)
    book.touch((problem,))
    if ended is None:
        return []
    ends.add(book, ended, "removed", now)
    ends.drop(book, problem.identity)
    problem.fault = replace(ended, identity=problem.identity)
    return [Change("removed", ended, now.wall), Change("began", problem.fault, now.wall)]


def remove_check(book: Book, robot: RobotRecord, check: str, now: Instant) -> list[Change]:
    """Take out a check that expects nothing any more."""
    problem = robot.checks.get(check)
    return [] if problem is None else end_all(book, (problem,), now)


def end_pending(book: Book, robot: RobotRecord, now: Instant) -> list[Change]:
    """No longer miss a robot that is not declared any more."""
    problem = robot.problems.get(State.PENDING)
    return [] if problem is None or robot.declared else end_all(book, (problem,), now)


def leave_site(book: Book, robot: RobotRecord, now: Instant) -> None:
    """No longer count the robot towards its site; it may be one of another, silent as this one."""
    site = book.present.get(robot.settings.site, set())
    if robot.name in site:
        site.discard(robot.name)
        if not site:
            del book.present[robot.settings.site]
        book.touch_causes()
    if robot.counted:
        robot.counted = False
        cause = book.cause(Scope.SITE, robot.settings.site)
        cause.count(robot.name, "", counts=False, fresh=False)
        _thin(book, cause)
        if cause.is_fault:
            book.explain_until(robot, now.mono + TIME_TO_RETURN)


def _thin(book: Book, cause: Cause) -> None:
    """Note that a person has taken out some of what a cause counts, where that may end it.

    Such an end is no recovery.
    """
    cause.thinned |= cause.active is not None
    book.touched_causes[cause] = None


def _uncount(book: Book, component: ComponentRecord) -> None:
    if component.counted:
        component.counted = False
        cause = book.cause(Scope.COMMON, component.name.component)
        cause.count(component.robot.name, component.name.group, counts=False, fresh=False)
        _thin(book, cause)
