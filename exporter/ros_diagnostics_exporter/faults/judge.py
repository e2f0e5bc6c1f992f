"""Beginning and ending: what is in trouble, due and not quiet is a fault until it is well.

Why a problem does not begin although it is due, or a fault does not end although it is well, and
the hours of the week in which faults of severity warning may begin.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from math import inf
from operator import attrgetter
from types import MappingProxyType
from typing import Any

from ros_diagnostics_exporter import weekly
from ros_diagnostics_exporter.faults import capabilities, causes, ends
from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.model import (
    Change,
    Fault,
    Reason,
    Scope,
    State,
    Verdict,
    severity_of,
)
from ros_diagnostics_exporter.faults.records import (
    CapabilityRecord,
    ComponentRecord,
    Problem,
    RobotRecord,
)
from ros_diagnostics_exporter.model import Instant

_TOLERANCE = 0.001  # seconds by which a time that is computed by two clocks may be early
_CLOCK_SET = 1.0  # seconds between both clocks after which the wall clock was set


def warnings_may_begin(book: Book, now: Instant) -> bool:
    """Whether it is in the hours, or the config names none."""
    hours = book.settings.warning_hours
    if hours is None:
        return True
    return weekly.holds(hours.weekly, hours.time_zone, int((now.wall + _TOLERANCE) // 60))


def follow_hours(book: Book, now: Instant) -> None:
    """Judge what may wait for the hours, now and when they begin or end next."""
    book.touch(problem for problem in book.problems.values() if problem.fault is None)
    set_hours_timer(book, now)


def set_hours_timer(book: Book, now: Instant) -> None:
    """Set the timer for the next begin or end of the hours."""
    hours = book.settings.warning_hours
    book.clock_offset = now.wall - now.mono
    change = inf
    if hours is not None:
        change = weekly.next_change(hours.weekly, hours.time_zone, now.wall + _TOLERANCE)
    if change < inf:
        book.timers.set(("hours", None), change - book.clock_offset)
    else:
        book.timers.clear(("hours", None))


def clock_was_set(book: Book, now: Instant) -> bool:
    """Whether the wall clock was set since the timer of the hours was, which is then wrong."""
    return abs(now.wall - now.mono - book.clock_offset) > _CLOCK_SET


# Of the robot itself rather than of a part of it: its silence keeps none of them quiet.
_OF_PRESENCE = {State.SILENT, State.PENDING, State.FLAPPING}


def why_not_begin(book: Book, problem: Problem, now: Instant) -> Reason | None:
    """The first reason that keeps the problem from beginning now; None: it may."""
    robot = problem.robot
    if robot is not None:
        reason = _of_uplink(problem, robot) or _of_robot(book, problem, robot, now)
        if reason is not None:
            return reason
    reason = _of_larger(book, problem, now)
    if reason is not None:
        return reason
    if problem.verdict is Verdict.HELD:
        return Reason.NO_DATA
    if problem.verdict is Verdict.ABSENT and now.mono < book.grace_until:
        return Reason.RESTART
    if severity_of(problem.identity) == "warning" and not warnings_may_begin(book, now):
        return Reason.HOURS
    return None


def why_not_end(problem: Problem) -> Reason | None:
    """What keeps a fault from ending although it is well; None: it ends.

    Maintenance and flapping are quiet both ways.
    """
    robot, component, identity = problem.robot, problem.component, problem.identity
    if _in_maintenance(problem):
        return Reason.MAINTENANCE
    if robot is not None and identity.state is State.SILENT and robot.flapping:
        return Reason.ROBOT_FLAPPING
    if component is not None and identity.scope is Scope.COMPONENT and component.flapping:
        return Reason.FLAPPING
    return None


def _in_maintenance(problem: Problem) -> bool:
    robot, component = problem.robot, problem.component
    if component is not None:
        return component.maintenance
    return robot is not None and robot.maintenance


def _of_robot(book: Book, problem: Problem, robot: RobotRecord, now: Instant) -> Reason | None:
    """Why the robot keeps it quiet."""
    identity = problem.identity
    if _in_maintenance(problem):
        return Reason.MAINTENANCE
    of_presence = identity.scope is Scope.ROBOT and identity.state in _OF_PRESENCE
    if not of_presence and not robot.up:
        return Reason.ROBOT_SILENT
    if (
        of_presence
        and identity.state is not State.PENDING
        and book.covered(Scope.SITE, robot.settings.site, now)
    ):
        return Reason.SITE
    # What is freshly received of a robot that comes and goes is as true as of any other.
    flaps = robot.problems.get(State.FLAPPING)
    if problem.verdict is Verdict.ABSENT and _is_reported(book, flaps, now):
        return Reason.ROBOT_FLAPPING
    if not of_presence and problem.verdict is Verdict.ABSENT and now.mono < robot.returned_until:
        return Reason.RETURNED
    return None


def _of_uplink(problem: Problem, robot: RobotRecord) -> Reason | None:
    """Why what rests on what is not received, or not measured, of a robot out of reach is quiet."""
    if not robot.unreachable or _in_maintenance(problem):
        return None
    component, identity = problem.component, problem.identity
    if component is None:
        explained = identity.scope is Scope.ROBOT and identity.state in _OF_PRESENCE
    else:
        explained = component.settings.measured or problem.verdict is Verdict.ABSENT
    return Reason.UNREACHABLE if explained else None


def _is_reported(book: Book, flaps: Problem | None, now: Instant) -> bool:
    """Whether something flaps, and people are notified of that instead of each change.

    A warning is not reported outside of its hours: then it hides nothing that is critical.
    """
    if flaps is None or not flaps.in_trouble:
        return False
    return flaps.fault is not None or warnings_may_begin(book, now)


def _of_larger(book: Book, problem: Problem, now: Instant) -> Reason | None:
    """Why what it is about, or what that is a part of, keeps it quiet."""
    reason = None
    component, absent = problem.component, problem.verdict is Verdict.ABSENT
    if component is not None:
        if component.settings.behind and component.is_behind(stale=absent):
            return Reason.BEHIND
        reason = _of_component(book, problem, component, now)
    elif isinstance(problem.capability, CapabilityRecord):
        reason = _of_parts(book, problem.capability, now)
    if reason is None and capabilities.explains(problem, now):
        return Reason.CAPABILITY
    return reason


def _of_component(
    book: Book, problem: Problem, component: ComponentRecord, now: Instant
) -> Reason | None:
    """Why the component's own flapping, or what explains its level, keeps it quiet."""
    if problem.identity.scope is Scope.VALUE:
        return Reason.FAULT if _is_too_low(problem, component) else None
    flaps = component.problems.get(State.FLAPPING)
    if problem.identity.scope is Scope.COMPONENT and _is_reported(book, flaps, now):
        return Reason.FLAPPING
    if problem.identity.state is State.INTERMITTENT:
        reason = _of_changes(book, component)
        if reason is not None:
            return reason
    if component.robot.many.covers(now):
        return Reason.MANY
    if book.covered(Scope.COMMON, component.name.component, now):
        return Reason.COMMON
    return None


def _of_parts(book: Book, capability: CapabilityRecord, now: Instant) -> Reason | None:
    """What explains all parts that keep a capability from being OK."""
    if capability.robot.many.covers(now):
        return Reason.MANY
    if capability.parts and all(
        part.component and book.covered(Scope.COMMON, part.component, now)
        for part in capability.parts
    ):
        return Reason.COMMON
    return None


def _of_changes(book: Book, component: ComponentRecord) -> Reason | None:
    """Why its changes are no intermittent fault: it flaps, or may soon, or has another fault."""
    history = component.flaps
    if component.flapping or (history and history.ratio >= book.settings.flapping.stop):
        return Reason.FLAPPING
    return Reason.FAULT if component.has_fault else None


def _is_too_low(problem: Problem, component: ComponentRecord) -> bool:
    """Whether it is about a value that falls, and it is a fault that it is too low already."""
    of = problem.identity
    return of.state is State.FALLING and any(
        each.fault is not None
        for (key, bound, _), each in component.values.items()
        if each is not problem and (key, bound) == (of.key, of.bound)
    )


EVIDENCE_LENGTH = 4096  # characters


def settle(book: Book, now: Instant) -> list[Change]:
    """Judge all that was touched, larger causes first; what began and ended."""
    if book.touched_robots:
        capabilities.update_touched(book, now)
    causes.update_touched(book, now)
    changes: list[Change] = []
    # In the order of their identities, so that the result depends on nothing else.
    touched = sorted(book.touched, key=attrgetter("identity"))
    book.touched.clear()
    for problem in touched:
        change = _judge(book, problem, now)
        if change is not None:
            changes.append(change)
    return changes


def _judge(book: Book, problem: Problem, now: Instant) -> Change | None:
    if problem.fault is not None:
        if problem.verdict is Verdict.WELL and why_not_end(problem) is None:
            _drop(book, problem)
            ends.add(book, problem.fault, "recovered", now)
            return Change("recovered", problem.fault, now.wall)
        return None
    if problem.verdict is Verdict.WELL:
        _drop(book, problem)
        return None
    due = book.due(problem)
    if now.mono < due:
        book.timers.set(("confirm", problem), due)
        return None
    return _begin(book, problem, now) if why_not_begin(book, problem, now) is None else None


def _begin(book: Book, problem: Problem, now: Instant) -> Change:
    labels = {} if problem.robot is None else dict(problem.robot.settings.labels)
    fault = Fault(problem.identity, problem.since.wall, now.wall, MappingProxyType(labels))
    problem.fault = fault
    ends.drop(book, fault.identity)
    book.write(problem)
    return Change("began", fault, now.wall)


def end_all(book: Book, problems: Iterable[Problem], now: Instant) -> list[Change]:
    """Take problems out, as a person wants it; those that were faults, as changes."""
    ordered = sorted(problems, key=attrgetter("identity"))
    for problem in ordered:
        _drop(book, problem)
        if problem.fault is not None:
            ends.add(book, problem.fault, "removed", now)
    return [
        Change("removed", problem.fault, now.wall)
        for problem in ordered
        if problem.fault is not None
    ]


def describe(
    book: Book, fault: Fault, evidence: str, work: str, details: Mapping[str, Any]
) -> Fault:
    """Fix a fault's evidence, for its life; the fault with it."""
    if fault.evidence:
        return fault
    texts = evidence[:EVIDENCE_LENGTH], work[:EVIDENCE_LENGTH]
    described = replace(fault, evidence=texts[0], work=texts[1], details=details)
    problem = book.problems.get(fault.identity)
    if problem is not None and problem.fault is fault:  # it still lasts
        problem.fault = described
        book.write(problem)
    return described


def _drop(book: Book, problem: Problem) -> None:
    component = problem.component
    book.drop_problem(problem)
    if component is not None and component.is_usual:
        book.drop_component(component)
    if problem.cause is not None:
        causes.drop_usual(book, problem.cause)
