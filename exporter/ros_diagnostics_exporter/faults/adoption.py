"""A fault whose alert fires and of which this process knows nothing: it is judged on from here.

The database was lost, or belongs to another time. That nothing of it is received yet is no evidence
of its end, so it lasts as one of an earlier process does, until what ends a fault is received.
"""

from __future__ import annotations

from ros_diagnostics_exporter.faults import causes, components, presence
from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.model import (
    Change,
    ComponentName,
    ComponentSettings,
    Fault,
    Identity,
    Scope,
    State,
    Verdict,
)
from ros_diagnostics_exporter.faults.records import (
    SLOTS,
    Cause,
    ComponentRecord,
    FlapHistory,
    Presence,
    RobotRecord,
)
from ros_diagnostics_exporter.model import Instant, Level


def adopt(book: Book, fault: Fault, now: Instant) -> Change | None:
    """Go on with a fault, if it is one of a robot that is known, and did not end here."""
    identity = fault.identity
    if not may_adopt(book, fault, now):
        return None
    since = Instant(now.mono - max(0.0, now.wall - fault.since), fault.since)
    robot = book.robots.get(identity.robot)
    if identity.scope in {Scope.EXPORTER, Scope.CAPABILITY}:
        pass  # nothing else follows from it
    elif robot is None or identity.state is State.MANY:
        _prepare_cause(book, identity, since, now)
    else:
        _prepare_robot(book, robot, identity, since, now)
    problem = book.problems.get(identity)
    if problem is None:
        problem = book.new_problem(identity, since)
    if problem.capability is not None:
        problem.capability.adopted = True
        book.write(problem.capability)
    problem.since, problem.fault = since, fault
    problem.restored = now.mono < book.grace_until
    if robot is not None and _is_over(robot, identity):
        book.give_verdict(problem, Verdict.HEALTHY)
    book.write(problem)
    book.touch((problem,))
    return Change("began", fault, now.wall)


def may_adopt(book: Book, fault: Fault, now: Instant) -> bool:
    """Whether it is of a robot that is known, and neither is one here nor ended here."""
    identity = fault.identity
    if identity.scope is Scope.EXPORTER and now.mono >= book.settled_at:
        return False  # it is the other's of a pair, which ends it
    if bool(identity.robot) != (identity.robot in book.robots) or _is_of_nothing(book, identity):
        return False
    forgotten = book.forgotten.get(identity.robot)
    if identity in book.ended or (forgotten is not None and forgotten.end.at >= fault.since):
        return False
    problem = book.problems.get(identity)
    return problem is None or problem.fault is None


def _is_of_nothing(book: Book, identity: Identity) -> bool:
    """Whether fleet.yml has nothing that the fault is about: then nothing could ever end it."""
    if identity.scope is Scope.CAPABILITY and not identity.robot:
        return identity.check not in book.capabilities
    if identity.scope in (Scope.SITE, Scope.COMMON):
        return not causes.robots_of(book, identity.scope, identity.site)
    return False


def _is_over(robot: RobotRecord, identity: Identity) -> bool:
    """Whether what is received of the robot now is the end of it."""
    if identity.state is State.PENDING:
        return robot.presence is not Presence.NEVER
    return identity.state is State.SILENT and robot.up


def _prepare_robot(
    book: Book, robot: RobotRecord, identity: Identity, since: Instant, now: Instant
) -> None:
    """Have the robot, or its component, as it was when the fault was known."""
    if identity.state is State.SILENT and not robot.up:
        presence.fall_silent(book, robot, since, now, counts=False)
    elif identity.scope is Scope.ROBOT and identity.state is State.FLAPPING:
        robot.history = _restless(now, 0, 1)
        book.timers.set(("presence", robot), now.mono + robot.settings.presence_interval)
        book.write(robot)
    elif identity.component:
        component = _component(book, robot, ComponentName(identity.group, identity.component))
        if identity.scope is Scope.COMPONENT:
            component.since = component.since or since
        elif identity.scope is Scope.FLAPPING:
            _prepare_flaps(book, component, identity.state, now)
        book.write(component)


def _prepare_flaps(book: Book, component: ComponentRecord, state: State, now: Instant) -> None:
    """Have it change as it did: with fewer changes, the first message would end the fault."""
    flaps = component.flaps or FlapHistory([Level.OK] * SLOTS, now.mono)
    changed = flaps.changed
    if state is State.INTERMITTENT:
        changed = (now.mono,) * book.settings.intermittent.changes
    else:
        flaps = _restless(now, Level.OK, Level.ERROR)
    component.flaps, flaps.changed = flaps, changed
    components.wake(book, component)


def _component(book: Book, robot: RobotRecord, name: ComponentName) -> ComponentRecord:
    component = robot.components.get(name)
    if component is None:
        settings = ComponentSettings(robot.settings.confirm_after)
        component = book.add_component(ComponentRecord(robot, name, settings))
        component.level = Level.STALE  # until it is received
    return component


def _restless(now: Instant, one: int, other: int) -> FlapHistory:
    """A history of nothing but changes: it comes to rest in time, as any other."""
    return FlapHistory([(one, other)[number % 2] for number in range(SLOTS)], now.mono)


def _prepare_cause(book: Book, identity: Identity, since: Instant, now: Instant) -> None:
    """Have a cause active, which is not known to be over before enough is received."""
    cause = _cause(book, identity)
    cause.active = cause.active or since
    cause.adopted = True
    book.write(cause)
    book.touched_causes[cause] = None
    if identity.scope is not Scope.SITE:
        return
    for robot in book.robots.values():
        if robot.settings.site == identity.site and not robot.up:
            presence.fall_silent(book, robot, since, now, counts=False)
            robot.counted = True
            causes.count_robot(book, robot, now)


def _cause(book: Book, identity: Identity) -> Cause:
    if identity.robot:
        return book.robots[identity.robot].many
    of = identity.site if identity.scope is Scope.SITE else identity.component
    return book.cause(identity.scope, of)
