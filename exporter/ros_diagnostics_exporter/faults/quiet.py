"""Why a problem does not begin although it is due, or a fault does not end although it is well."""

from __future__ import annotations

from ros_diagnostics_exporter.faults import capabilities
from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.hours import warnings_may_begin
from ros_diagnostics_exporter.faults.model import Reason, Scope, State, Verdict, severity_of
from ros_diagnostics_exporter.faults.records import (
    CapabilityRecord,
    ComponentRecord,
    Problem,
    RobotRecord,
)
from ros_diagnostics_exporter.model import Instant

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
