"""Faults as rows that outlive the process; times in them are Unix time.

Robots, components in trouble, problems and larger causes have a row each, so that a change is
written alone. What can be counted from them is counted again.

The wall clock may have been set since they were written: nothing of before lies in the future, and
nothing that is to end lasts longer than if it had begun now.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from math import inf
from operator import attrgetter
from types import MappingProxyType
from typing import Any

from ros_diagnostics_exporter.faults import (
    capabilities,
    causes,
    components,
    fleet_capabilities,
    judge,
)
from ros_diagnostics_exporter.faults.book import CLOCK_TIME, TIME_TO_RETURN, Book
from ros_diagnostics_exporter.faults.model import (
    Ability,
    ComponentName,
    ComponentSettings,
    End,
    Fault,
    Identity,
    PartName,
    RobotSettings,
    Row,
    Scope,
    State,
    Verdict,
    at_mono,
)
from ros_diagnostics_exporter.faults.needs import Bad
from ros_diagnostics_exporter.faults.records import (
    CapabilityRecord,
    Cause,
    ComponentRecord,
    Ended,
    FlapHistory,
    Presence,
    Problem,
    RobotRecord,
    RowKey,
)
from ros_diagnostics_exporter.faults.stored import (
    SCHEMAS,
    History,
    OfCapability,
    OfCause,
    OfComponent,
    OfEnd,
    OfFleet,
    OfProblem,
    OfRobot,
    Stored,
    StoredFault,
    StoredSettings,
    as_fields,
)
from ros_diagnostics_exporter.model import Instant, Level

_ORDER = tuple(SCHEMAS)  # each refers to those before


class _Clock:
    """Turns readings of the monotonic clock into Unix time and back, by one Instant."""

    def __init__(self, now: Instant) -> None:
        self.offset = now.wall - now.mono

    def wall(self, mono: float) -> float | None:
        """The Unix time; None for never."""
        return None if mono == -inf else mono + self.offset

    def mono(self, wall: float | None) -> float:
        """The monotonic clock's reading then."""
        return -inf if wall is None else wall - self.offset

    def instant(self, wall: float) -> Instant:
        """Both."""
        return Instant(wall - self.offset, wall)


def take(book: Book, now: Instant) -> list[Row]:
    """The rows that were to be written, which then no longer are."""
    clock = _Clock(now)
    taken = [Row(kind, key, _fields(book, (kind, key), clock)) for kind, key in book.written]
    book.written.clear()
    return taken


def restore(book: Book, rows: Iterable[Row], now: Instant) -> list[Row]:
    """Put rows back into an empty book; returns those that cannot be, which are left out.

    A row that refers to one that is not there is such a row: a component of an unknown robot.
    """
    clock = _Clock(now)
    readers: dict[str, Callable[[Book, tuple[str, ...], Any, _Clock], None]] = {
        "fleet": _read_fleet,
        "robot": _read_robot,
        "component": _read_component,
        "cause": _read_cause,
        "capability": _read_capability,
        "problem": _read_problem,
        "end": _read_end,
    }
    dropped: list[Row] = []
    for row in sorted(rows, key=lambda row: (_ORDER.index(row.kind), row.key)):
        if row.fields is None:
            continue
        try:
            stored = SCHEMAS[row.kind].validate_python(row.fields)
            readers[row.kind](book, row.key, stored, clock)
        except (LookupError, ValueError, TypeError):  # a part of its key names nothing
            dropped.append(row)
    _bound(book, now)
    _count(book, now)
    _set_timers(book)
    judge.set_hours_timer(book, now)
    book.touched.clear()
    book.touched_causes.clear()
    book.touched_robots.clear()
    book.written.clear()
    return dropped


# -- writing -----------------------------------------------------------------------------------


def _fields(book: Book, row: RowKey, clock: _Clock) -> dict[str, object] | None:
    stored = _stored(book, row, clock)
    return None if stored is None else as_fields(stored)


def _stored(book: Book, row: RowKey, clock: _Clock) -> Stored | None:
    kind, key = row
    if kind == "fleet":
        return OfFleet(
            grace_until=clock.wall(book.grace_until), settled_at=clock.wall(book.settled_at)
        )
    if kind == "problem":
        problem = book.problems.get(_identity(key))
        return None if problem is None else _of_problem(problem, clock)
    if kind == "end":
        return _of_end(book.ended.get(_identity(key)))
    if kind == "cause":
        cause = _cause(book, key)
        return None if cause is None else _of_cause(cause, clock)
    robot = book.robots.get(key[0])
    return None if robot is None else _stored_of(robot, row, clock)


def _stored_of(robot: RobotRecord, row: RowKey, clock: _Clock) -> Stored | None:
    """The row of a robot, or of what it has."""
    kind, key = row
    if kind == "robot":
        return _of_robot(robot, clock)
    if kind == "capability":
        return _of_capability(robot.capabilities.get(key[1]), clock)
    component = robot.components.get(ComponentName(*key[1:]))
    return None if component is None else _of_component(component, clock)


def _identity(key: tuple[str, ...]) -> Identity:
    scope, state, *others = key
    return Identity(Scope(scope), State(state), *others)


def _cause(book: Book, key: tuple[str, ...]) -> Cause | None:
    scope, name = Scope(key[0]), key[1]
    if scope is not Scope.ROBOT:
        return book.causes.get((scope, name))
    robot = book.robots.get(name)
    return None if robot is None else robot.many


def _of_problem(problem: Problem, clock: _Clock) -> OfProblem:
    return OfProblem(
        since=problem.since.wall,
        clock=problem.clock + clock.offset,
        verdict=int(problem.verdict),
        fault=None if problem.fault is None else _of_fault(problem.fault),
    )


def _of_fault(fault: Fault) -> StoredFault:
    return StoredFault(
        since=fault.since,
        confirmed=fault.confirmed,
        labels=dict(fault.labels),
        evidence=fault.evidence,
        work=fault.work,
        details=dict(fault.details),
    )


def _of_cause(cause: Cause, clock: _Clock) -> OfCause | None:
    if cause.active is None and cause.covers_until == -inf:
        return None
    return OfCause(
        active=None if cause.active is None else cause.active.wall,
        covers_until=clock.wall(cause.covers_until),
        adopted=cause.adopted,
    )


def _of_capability(capability: CapabilityRecord | None, clock: _Clock) -> OfCapability | None:
    if capability is None or (capability.active is None and capability.covers_until == -inf):
        return None
    return OfCapability(
        active=None if capability.active is None else capability.active.wall,
        covers_until=clock.wall(capability.covers_until),
        worst=int(capability.worst),
        parts=[
            (*part, int(bad.ability), bad.due + clock.offset)
            for part, bad in capability.parts.items()
        ],
    )


def _of_end(ended: Ended | None) -> OfEnd | None:
    if ended is None or ended.end.fault is None:
        return None
    end, fault = ended.end, ended.end.fault
    return OfEnd(
        reason=end.reason,
        at=end.at,
        message=end.message,
        since=fault.since,
        labels=dict(fault.labels),
    )


def _of_robot(robot: RobotRecord, clock: _Clock) -> OfRobot:
    settings = robot.settings
    return OfRobot(
        labels=dict(settings.labels),
        confirm_after=settings.confirm_after,
        flap_interval=settings.flap_interval,
        presence_interval=settings.presence_interval,
        declared=robot.declared,
        presence=robot.presence.value,
        maintenance=robot.maintenance,
        returned_until=clock.wall(robot.returned_until),
        total=robot.total,
        counted=robot.counted,
        history=_of_history(robot.history, clock),
    )


def _of_component(component: ComponentRecord, clock: _Clock) -> OfComponent:
    settings = component.settings
    return OfComponent(
        settings=StoredSettings(
            confirm_after=settings.confirm_after,
            planned_stale=settings.planned_stale,
            stale_is_critical=settings.stale_is_critical,
            behind=sorted(settings.behind),
        ),
        level=int(component.level),
        since=None if component.since is None else component.since.wall,
        counted=component.counted,
        flaps=_of_history(component.flaps, clock),
        explained_until=clock.wall(component.explained_until),
    )


def _of_history(history: FlapHistory | None, clock: _Clock) -> History | None:
    if history is None:
        return None
    changed = [mono + clock.offset for mono in history.changed]
    return History(slots=list(history.slots), last=history.last + clock.offset, changed=changed)


# -- reading -----------------------------------------------------------------------------------


def _read_fleet(book: Book, _key: tuple[str, ...], stored: OfFleet, clock: _Clock) -> None:
    book.grace_until = clock.mono(stored.grace_until)
    book.settled_at = clock.mono(stored.settled_at)


def _read_robot(book: Book, key: tuple[str, ...], stored: OfRobot, clock: _Clock) -> None:
    settings = RobotSettings(
        MappingProxyType(stored.labels),
        stored.confirm_after,
        stored.flap_interval,
        stored.presence_interval,
    )
    robot = book.add_robot(key[0], settings)
    robot.declared = stored.declared
    robot.presence = Presence(stored.presence)
    robot.maintenance = stored.maintenance
    robot.returned_until = clock.mono(stored.returned_until)
    robot.total = stored.total
    robot.counted = stored.counted
    robot.history = _read_history(stored.history, clock)


def _read_component(book: Book, key: tuple[str, ...], stored: OfComponent, clock: _Clock) -> None:
    behind = frozenset(stored.settings.behind)
    settings = ComponentSettings(**{**stored.settings._asdict(), "behind": behind})
    robot, group, name = key
    component = book.add_component(
        ComponentRecord(book.robots[robot], ComponentName(group, name), settings)
    )
    component.level = Level(stored.level)
    since = stored.since
    component.since = None if since is None else clock.instant(since)
    component.counted = stored.counted
    component.flaps = _read_history(stored.flaps, clock)
    component.robot.chained = component.robot.chained or bool(behind)
    component.explained_until = clock.mono(stored.explained_until)


def _read_history(stored: History | None, clock: _Clock) -> FlapHistory | None:
    if stored is None:
        return None
    history = FlapHistory(stored.slots, clock.mono(stored.last))
    history.changed = tuple(map(clock.mono, stored.changed))
    return history


def _read_cause(book: Book, key: tuple[str, ...], stored: OfCause, clock: _Clock) -> None:
    scope, name = Scope(key[0]), key[1]
    cause = book.robots[name].many if scope is Scope.ROBOT else book.cause(scope, name)
    active = stored.active
    cause.active = None if active is None else clock.instant(active)
    cause.covers_until = clock.mono(stored.covers_until)
    cause.adopted = stored.adopted


def _read_capability(book: Book, key: tuple[str, ...], stored: OfCapability, clock: _Clock) -> None:
    robot = book.robots[key[0]]
    capability = robot.capabilities[key[1]] = CapabilityRecord(robot, key[1])
    capability.active = None if stored.active is None else clock.instant(stored.active)
    capability.covers_until = clock.mono(stored.covers_until)
    capability.worst = Ability(stored.worst)
    capability.parts = {
        PartName(*part): Bad(Ability(ability), clock.mono(due))
        for *part, ability, due in stored.parts
    }


def _read_problem(book: Book, key: tuple[str, ...], stored: OfProblem, clock: _Clock) -> None:
    identity = _identity(key)
    problem = Problem(identity, clock.instant(stored.since))
    problem.clock = clock.mono(stored.clock)
    problem.verdict = Verdict(stored.verdict)
    fault = stored.fault
    if fault is not None:
        labels = MappingProxyType(fault.labels)
        times = fault.since, fault.confirmed
        problem.fault = Fault(identity, *times, labels, fault.evidence, fault.work, fault.details)
        problem.restored = True
    give_to_owner(book, problem)
    book.add_problem(problem)


def _read_end(book: Book, key: tuple[str, ...], stored: OfEnd, _clock: _Clock) -> None:
    identity, since = _identity(key), stored.since
    fault = Fault(identity, since, since, MappingProxyType(stored.labels))
    end = End(fault, identity.robot, stored.reason, stored.at, stored.message)
    book.ended[identity] = Ended(end)


def give_to_owner(book: Book, problem: Problem) -> None:
    """Have a problem where what it is about finds it."""
    identity = problem.identity
    robot = problem.robot = book.robots[identity.robot] if identity.robot else None
    if identity.scope is Scope.EXPORTER:
        book.own.setdefault(identity.component, CLOCK_TIME)
        return
    if robot is None and identity.scope is Scope.CAPABILITY:
        problem.capability = fleet_capabilities.adopt(book, identity.check)
        problem.capability.problems[identity.state] = problem
    elif robot is None or identity.state is State.MANY:
        of = identity.site if identity.scope is Scope.SITE else identity.component
        cause = book.cause(identity.scope, of) if robot is None else robot.many
        problem.cause = cause
        cause.problems[identity.severity] = problem
    elif identity.scope is Scope.CHECK:
        robot.checks[identity.check] = problem
    elif identity.scope is Scope.CAPABILITY:
        problem.capability = capabilities.adopt(book, robot, identity.check)
        problem.capability.problems[identity.state] = problem
    elif identity.scope is Scope.ROBOT:
        robot.problems[identity.state] = problem
    else:
        name = ComponentName(identity.group, identity.component)
        component = problem.component = robot.components[name]
        if identity.scope is Scope.VALUE:
            component.values[identity.key, identity.bound, identity.state.value] = problem
        else:
            component.problems[identity.state] = problem


# -- a wall clock that was set back ------------------------------------------------------------


def _bound(book: Book, now: Instant) -> None:
    for problem in book.problems.values():
        _bound_problem(book, problem, now)
    for robot in book.robots.values():
        most = now.mono + robot.settings.confirm_after
        robot.returned_until = min(robot.returned_until, most)
        _bound_history(robot.history, now)
        for component in robot.components.values():
            component.since = _not_after(component.since, now)
            latest = now.mono + TIME_TO_RETURN
            component.explained_until = min(component.explained_until, latest)
            _bound_history(component.flaps, now)
        for capability in robot.capabilities.values():
            capability.active = _not_after(capability.active, now)
            capability.covers_until = min(capability.covers_until, most)
    for cause in (*book.causes.values(), *(robot.many for robot in book.robots.values())):
        cause.active = _not_after(cause.active, now)
        most = now.mono + causes.confirm_after(book, cause)
        cause.covers_until = min(cause.covers_until, most)


def _bound_problem(book: Book, problem: Problem, now: Instant) -> None:
    """Date a problem before now, and one that is confirmed long enough before."""
    latest = now
    component = problem.component if problem.identity.scope is Scope.COMPONENT else None
    if problem.fault is not None:
        latest = at_mono(now.mono - (book.due(problem) - problem.clock), now)
    if problem.clock > now.mono:
        problem.clock = latest.mono
    if problem.since.wall > now.wall:
        problem.since = latest
    if component is not None and component.since is not None and component.since.wall > now.wall:
        component.since = latest


def _bound_history(history: FlapHistory | None, now: Instant) -> None:
    if history is not None:
        history.last = min(history.last, now.mono)
        history.changed = tuple(min(mono, now.mono) for mono in history.changed)


def _not_after(then: Instant | None, now: Instant) -> Instant | None:
    return None if then is None else min(then, now, key=attrgetter("wall"))


# -- what follows from the rows ----------------------------------------------------------------


def _count(book: Book, now: Instant) -> None:
    for robot in book.robots.values():
        book.note_presence(robot)
        causes.count_robot(book, robot, now)
        for component in robot.components.values():
            causes.count_component(book, component)


def _set_timers(book: Book) -> None:
    timers = book.timers
    if book.grace_until > -inf:
        timers.set(("settled", None), book.grace_until)
    for problem in book.problems.values():
        if problem.fault is None:
            timers.set(("confirm", problem), book.due(problem))
    for cause in (*book.causes.values(), *(robot.many for robot in book.robots.values())):
        if cause.covers_until > -inf:
            timers.set(("cover", cause), cause.covers_until)
    for robot in book.robots.values():
        _set_timers_of(book, robot)
        for capability in robot.capabilities.values():
            if capability.covers_until > -inf:
                timers.set(("cover", capability), capability.covers_until)


def _set_timers_of(book: Book, robot: RobotRecord) -> None:
    if robot.returned_until > -inf:
        book.timers.set(("returned", robot), robot.returned_until)
    if robot.history is not None and robot.history.ratio > 0.0:
        due = robot.history.last + robot.settings.presence_interval
        book.timers.set(("presence", robot), due)
    if robot.up:
        for component in robot.components.values():
            components.wake(book, component)
