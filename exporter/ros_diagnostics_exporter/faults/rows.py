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
from typing import Any

from ros_diagnostics_exporter.faults import (
    causes,
    components,
    judge,
    presence,
    stored,
)
from ros_diagnostics_exporter.faults.book import TIME_TO_RETURN, Book
from ros_diagnostics_exporter.faults.model import (
    ComponentName,
    ComponentSettings,
    End,
    Fault,
    Identity,
    RobotSettings,
    Row,
    Scope,
    State,
    at_mono,
)
from ros_diagnostics_exporter.faults.records import (
    Cause,
    ComponentRecord,
    Ended,
    FlapHistory,
    Problem,
    RobotRecord,
    RowKey,
    Subject,
)
from ros_diagnostics_exporter.faults.stored import SCHEMAS, Clock
from ros_diagnostics_exporter.model import Instant

_ORDER = tuple(SCHEMAS)  # each refers to those before


def take(book: Book, now: Instant) -> list[Row]:
    """The rows that were to be written, which then no longer are."""
    clock = Clock(now)
    taken = [Row(kind, key, _fields(book, (kind, key), clock)) for kind, key in book.written]
    book.written.clear()
    return taken


def restore(book: Book, rows: Iterable[Row], now: Instant) -> list[Row]:
    """Put rows back into an empty book; returns those that cannot be, which are left out.

    A row that refers to one that is not there is such a row: a component of an unknown robot.
    """
    clock = Clock(now)
    book.restored_at = now.mono
    dropped: list[Row] = []
    for row in sorted(rows, key=lambda row: (_ORDER.index(row.kind), row.key)):
        if row.fields is None:
            continue
        try:
            fields = SCHEMAS[row.kind].validate_python(row.fields)
            _READERS[row.kind](book, row.key, vars(fields), clock)
        except (LookupError, ValueError, TypeError):  # a part of its key names nothing
            dropped.append(row)
    _bound(book, now)
    _count(book, now)
    _set_timers(book, now)
    judge.set_hours_timer(book, now)
    book.changed.clear()
    book.touched.clear()
    book.touched_causes.clear()
    book.touched_robots.clear()
    book.written.clear()
    return dropped


# -- writing -----------------------------------------------------------------------------------


def _fields(book: Book, row: RowKey, clock: Clock) -> dict[str, Any] | None:
    """The fields of a row, None where there is nothing to keep."""
    kind, key = row
    if kind == "end":
        return _of_end(book.ended.get(_identity(key)))
    if kind == "robot":
        return _of_robot(book.robots.get(key[0]), clock)
    table, record = _record(book, row)
    return None if record is None else stored.write(table, record, clock)


def _record(book: Book, row: RowKey) -> tuple[stored.Table, object]:
    """What a row is written from: the record, None where there is nothing to keep."""
    kind, key = row
    if kind == "fleet":
        return stored.FLEET, book
    if kind == "problem":
        return stored.PROBLEM, book.problems.get(_identity(key))
    if kind == "cause":
        cause = _cause(book, key)
        return stored.CAUSE, cause if cause is not None and cause.active else None
    robot = book.robots.get(key[0])
    if kind == "capability":
        records = book.capabilities if robot is None else robot.capabilities
        capability = records.get(key[1])
        is_kept = capability is not None and capability.problems
        return stored.CAPABILITY, capability if is_kept else None
    components = {} if robot is None else robot.components
    return stored.COMPONENT, components.get(ComponentName(*key[1:]))


def _of_robot(robot: RobotRecord | None, clock: Clock) -> dict[str, Any] | None:
    if robot is None:
        return None
    settings = stored.write(stored.ROBOT_SETTINGS, robot.settings, clock)
    return settings | stored.write(stored.ROBOT, robot, clock)


def _identity(key: tuple[str, ...]) -> Identity:
    scope, state, *others = key
    return Identity(Scope(scope), State(state), *others)


def _cause(book: Book, key: tuple[str, ...]) -> Cause | None:
    scope, name = Scope(key[0]), key[1]
    if scope is not Scope.ROBOT:
        return book.causes.get((scope, name))
    robot = book.robots.get(name)
    return None if robot is None else robot.many


def _of_end(ended: Ended | None) -> dict[str, Any] | None:
    if ended is None or ended.end.fault is None:
        return None
    fault, end = ended.end.fault, ended.end
    ending = {name: getattr(end, name) for name in ("reason", "at", "message")}
    return ending | {"since": fault.since, "labels": dict(fault.labels)}


# -- reading -----------------------------------------------------------------------------------

_Fields = dict[str, Any]
_Key = tuple[str, ...]


def _set(record: object, table: stored.Table, fields: _Fields, clock: Clock) -> None:
    for name, value in stored.read(table, fields, clock).items():
        setattr(record, name, value)


def _read_fleet(book: Book, _key: _Key, fields: _Fields, clock: Clock) -> None:
    _set(book, stored.FLEET, fields, clock)


def _read_robot(book: Book, key: _Key, fields: _Fields, clock: Clock) -> None:
    settings = RobotSettings(**stored.read(stored.ROBOT_SETTINGS, fields, clock))
    _set(book.add_robot(key[0], settings), stored.ROBOT, fields, clock)


def _read_component(book: Book, key: _Key, fields: _Fields, clock: Clock) -> None:
    robot, group, name = key
    attributes = stored.read(stored.COMPONENT, fields, clock)
    settings = ComponentSettings(**attributes.pop("settings"))
    record = ComponentRecord(book.robots[robot], ComponentName(group, name), settings)
    for attribute, value in attributes.items():
        setattr(record, attribute, value)
    book.add_component(record)


def _read_cause(book: Book, key: _Key, fields: _Fields, clock: Clock) -> None:
    scope, name = Scope(key[0]), key[1]
    cause = book.robots[name].many if scope is Scope.ROBOT else book.cause(scope, name)
    _set(cause, stored.CAUSE, fields, clock)


def _read_capability(book: Book, key: _Key, fields: _Fields, clock: Clock) -> None:
    robot = book.robots[key[0]] if key[0] else None
    _set(book.capability(robot, key[1]), stored.CAPABILITY, fields, clock)


def _read_problem(book: Book, key: _Key, fields: _Fields, clock: Clock) -> None:
    attributes = stored.read(stored.PROBLEM, fields, clock)
    fault = attributes.pop("fault")
    problem = book.new_problem(_identity(key), attributes["since"])
    for name, value in attributes.items():
        setattr(problem, name, value)
    if fault is not None:
        problem.fault = Fault(problem.identity, **fault)
        problem.restored = True


def _read_end(book: Book, key: _Key, fields: _Fields, clock: Clock) -> None:
    ending = stored.read(stored.END, fields, clock)
    since, labels = ending.pop("since"), ending.pop("labels")
    fault = Fault(_identity(key), since, since, labels)
    book.ended[fault.identity] = Ended(End(fault, fault.identity.robot, **ending))


_READERS: dict[str, Callable[[Book, _Key, _Fields, Clock], None]] = {
    "fleet": _read_fleet,
    "robot": _read_robot,
    "component": _read_component,
    "cause": _read_cause,
    "capability": _read_capability,
    "problem": _read_problem,
    "end": _read_end,
}


# -- a wall clock that was set back ------------------------------------------------------------


def _bound(book: Book, now: Instant) -> None:
    for problem in book.problems.values():
        _bound_problem(book, problem, now)
        _bound_subject(problem, now)
    for robot in book.robots.values():
        robot.returned_until = min(robot.returned_until, now.mono + robot.settings.confirm_after)
        robot.booted_until = min(robot.booted_until, now.mono + robot.settings.boot_grace)
        for problem in robot.all_problems():
            problem.boots_until = min(problem.boots_until, robot.booted_until)
        _bound_subject(robot, now)
        _bound_history(robot.history, now)
        _bound_history(robot.history_before, now)
        for component in robot.components.values():
            component.since = _not_after(component.since, now)
            component.boots_until = min(component.boots_until, robot.booted_until)
            _bound_subject(component, now)
            _bound_history(component.flaps, now)
        for capability in robot.capabilities.values():
            _bound_subject(capability, now)
    for cause in (*book.causes.values(), *(robot.many for robot in book.robots.values())):
        cause.active = _not_after(cause.active, now)


def _bound_subject(subject: Subject, now: Instant) -> None:
    latest = now.mono + TIME_TO_RETURN
    subject.explained_until = min(subject.explained_until, latest)
    subject.returns_until = min(subject.returns_until, latest)


def _bound_problem(book: Book, problem: Problem, now: Instant) -> None:
    """Date a problem before now, and one that is confirmed long enough before."""
    latest = now
    component = problem.component if problem.identity.scope is Scope.COMPONENT else None
    if problem.fault is not None:
        latest = at_mono(now.mono - (book.due(problem) - problem.clock), now)
    if problem.clock > now.mono and problem.capability is None:  # whose parts set it anew
        problem.clock = latest.mono
    if problem.waits_since is not None:
        problem.waits_since = min(problem.waits_since, now.mono)
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
            causes.count_component(book, component, now)


def _set_timers(book: Book, now: Instant) -> None:
    timers = book.timers
    if book.grace_until > -inf:
        timers.set(("settled", None), book.grace_until)
    for problem in book.problems.values():
        if problem.fault is None:
            timers.set(("confirm", problem), book.due(problem))
    for robot in book.robots.values():
        _set_timers_of(book, robot)
        presence.await_time(book, robot, now)


def _set_timers_of(book: Book, robot: RobotRecord) -> None:
    if robot.returned_until > -inf:
        book.timers.set(("returned", robot), robot.returned_until)
    if robot.history is not None and robot.history.ratio > 0.0:
        due = robot.history.last + robot.settings.presence_interval
        book.timers.set(("presence", robot), due)
    if robot.up:
        for component in robot.components.values():
            components.wake(book, component)
