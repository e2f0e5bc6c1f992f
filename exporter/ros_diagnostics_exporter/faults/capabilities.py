"""What a robot or the fleet can do: judged by the problems of its parts, which its own explain.

A capability in trouble is the larger fault of what it rests on, and of capabilities that are in
trouble for no other parts: so there is one notification. The parts of a robot's are components,
values and checks; those of the fleet's are robots, none of whose faults it explains: each robot has
to be repaired all the same. What is in maintenance is left out in both directions.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from math import inf

from ros_diagnostics_exporter.faults import needs, suppression
from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.model import (
    CapabilityState,
    ComponentName,
    Identity,
    PartName,
    Scope,
    State,
    Verdict,
)
from ros_diagnostics_exporter.faults.needs import (
    FINE,
    MISSING,
    NOT_KNOWN,
    Bad,
    NeedView,
    Other,
    Standing,
    WantedCapability,
)
from ros_diagnostics_exporter.faults.records import CapabilityRecord, Problem, RobotRecord
from ros_diagnostics_exporter.model import Instant, Level

FLEET_DELAY = 0.5  # seconds: what changes at once of many robots is judged together
_STATES = {
    State.NO_RESERVE: CapabilityState.NO_RESERVE,
    State.DEGRADED: CapabilityState.DEGRADED,
    State.LOST: CapabilityState.LOST,
}
_OF_LEVEL = {
    Level.WARN: CapabilityState.DEGRADED,
    Level.STALE: CapabilityState.UNKNOWN,
    Level.ERROR: CapabilityState.LOST,
}
_NO_TROUBLE = {State.INTERMITTENT, State.FALLING}  # of what it can do now
_Outcomes = dict[str, "Standing | None"]


# -- config ------------------------------------------------------------------------------------


def configure(
    book: Book, robot: RobotRecord | None, wanted: Iterable[WantedCapability], now: Instant
) -> list[Problem]:
    """Have just these capabilities of a robot, or (None) of the fleet, in their order of need.

    Returns what is to be taken out: problems of what is no longer wanted, or whose parts are gone.
    """
    records = book.capabilities if robot is None else robot.capabilities
    former = dict(records)
    records.clear()
    gone: list[Problem] = []
    parts: dict[str, set[PartName]] = {}
    for each in wanted:
        capability = former.pop(each.name, None) or CapabilityRecord(robot, each.name)
        parts[each.name] = set(needs.parts_of(each.need, parts))
        # After a restart, components that its patterns match may not have been received yet.
        known = robot is not None and capability.wanted is not None
        if known:
            wanted_parts = {part: part for part in parts[each.name]}
            gone += _follow_parts(book, capability, wanted_parts.get)
        capability.wanted = each
        records[each.name] = capability
    for capability in former.values():
        gone += capability.problems.values()
        book.write(capability)
    if robot is None:
        book.timers.set_at_latest(("fleet", None), now.mono if records else inf)
        return gone
    book.touched_robots[robot] = None
    book.touch(robot.all_problems())
    book.followed[robot.name] = None
    return gone


def _follow_parts(
    book: Book, capability: CapabilityRecord, named: Callable[[PartName], PartName | None]
) -> Iterable[Problem]:
    """Have its parts as they are ``named`` now, or no longer; what rested on none but these."""
    former = capability.parts
    found = {named(part): bad for part, bad in former.items()}
    capability.parts = {part: bad for part, bad in found.items() if part is not None}
    if capability.parts != former:
        book.write(capability)
    return list(capability.problems.values()) if former and not capability.parts else ()


def follow_component(
    book: Book, robot: RobotRecord, old: ComponentName, new: ComponentName | None
) -> list[Problem]:
    """Have a component as a part by its new name, or (None) no longer; see `_follow_parts`."""

    def named(part: PartName) -> PartName | None:
        if (part.group, part.component) != old:
            return part
        return None if new is None else part._replace(group=new.group, component=new.component)

    gone: list[Problem] = []
    for capability in robot.capabilities.values():
        wanted = capability.wanted
        if wanted is not None:
            need = needs.with_parts(wanted.need, named) or MISSING
            capability.wanted = wanted._replace(need=need)
        gone += _follow_parts(book, capability, named)
    book.touched_robots[robot] = None
    return gone


# -- judged ------------------------------------------------------------------------------------


def update_touched(book: Book, now: Instant) -> None:
    """Judge the capabilities of robots whose parts were touched, and the fleet's after them."""
    robots = list(book.touched_robots)
    book.touched_robots.clear()
    for robot in robots:
        if robot.up and now.mono >= robot.returned_until:
            for capability in robot.capabilities.values():
                capability.adopted = False
        _update(book, robot.capabilities, now, is_known=robot.up)
    if book.capabilities:
        book.timers.set_at_latest(("fleet", None), now.mono + FLEET_DELAY)


def update_fleet(book: Book, now: Instant) -> None:
    """Judge what the fleet can do, by what its robots can; not before a reload is over."""
    if book.is_reloading:
        book.timers.set(("fleet", None), now.mono + FLEET_DELAY)
        return
    if now.mono >= book.fleet_known_at:
        for capability in book.capabilities.values():
            capability.adopted = False
    _update(book, book.capabilities, now, is_known=True)


def _update(
    book: Book, records: Mapping[str, CapabilityRecord], now: Instant, *, is_known: bool
) -> None:
    every: _Outcomes = {}
    in_use: _Outcomes = {}  # without what is in maintenance
    for name, capability in records.items():
        robot, wanted = capability.robot, capability.wanted
        every[name] = _outcome(book, capability, every, now, leave_out=False)
        in_use[name] = every[name]
        if robot is None or robot.maintained:
            in_use[name] = _outcome(book, capability, in_use, now, leave_out=True)
        if wanted is None:
            continue  # of an earlier process, and not configured yet: it stays as it was
        if is_known and not capability.adopted:
            actual = every[name] or NOT_KNOWN
            _judge(book, capability, actual, in_use[name] or NOT_KNOWN, now)
        else:
            _judge(book, capability, NOT_KNOWN, NOT_KNOWN, now)


def _outcome(
    book: Book, capability: CapabilityRecord, others: _Outcomes, now: Instant, *, leave_out: bool
) -> Standing | None:
    robot, wanted = capability.robot, capability.wanted
    if wanted is None or wanted.applies is None:
        return NOT_KNOWN
    if not wanted.applies:
        return FINE

    def look(part: PartName | Other) -> Standing | None:
        if isinstance(part, Other):
            return others[part.name]
        is_planned = is_maintained(book, robot, part)
        if is_planned and (leave_out or (robot is None and not capability.problems)):
            return None
        actual = _of_robot(book, part, now) if robot is None else _of_part(book, robot, part)
        before = capability.parts.get(part) if is_planned and capability.problems else None
        if before is None:
            return actual
        # As bad as before its maintenance, which ends nothing.
        worst, due = max(actual.parts.get(part, before), before)
        return Standing(worst, {part: Bad(worst, due)}, due, actual.absent)

    return needs.outcome(wanted.need, look)


def is_maintained(book: Book, robot: RobotRecord | None, part: PartName) -> bool:
    """Whether a part of a robot's capability, or (None) of the fleet's, is in maintenance."""
    if robot is not None:
        return part.component in robot.maintained
    owner = book.robots.get(part.robot)
    return owner is not None and owner.maintenance


def _of_part(book: Book, robot: RobotRecord, part: PartName) -> Standing:
    """How good a part of a robot is, by the problems that it has."""
    worst = FINE
    for problem in _problems_of(robot, part):
        state = _state_of_part(problem)
        if state is CapabilityState.OK or state < worst.state or _is_off(robot, part, problem):
            continue
        due = book.due(problem, as_part=True)
        if state == worst.state:
            due = min(due, worst.due)
        absent = state is CapabilityState.UNKNOWN or problem.verdict is Verdict.ABSENT
        worst = Standing(state, {part: Bad(state, due)}, due, absent)
    return worst


def _is_off(robot: RobotRecord, part: PartName, problem: Problem) -> bool:
    """Whether its component is just switched off as planned: then it is as good as when it is on.

    Not so where it is known to be broken, by a fault of its own or of a capability.
    """
    component = problem.component
    if component is None or not component.is_planned_stale or problem.fault is not None:
        return False
    return not any(each.is_fault and part in each.parts for each in robot.capabilities.values())


def _of_robot(book: Book, part: PartName, now: Instant) -> Standing:
    """How good a robot is at it: one that has no reserve for it can do it."""
    robot = book.robots.get(part.robot)
    capability = None if robot is None else robot.capabilities.get(part.check)
    if robot is None or capability is None:
        return NOT_KNOWN
    bad = Bad(capability.state, capability.due)
    if not robot.up:
        bad = Bad(CapabilityState.UNKNOWN, _due_of_silence(book, robot, now))
    elif capability.state in (CapabilityState.OK, CapabilityState.NO_RESERVE):
        return FINE
    return Standing(bad.state, {part: bad}, bad.due, absent=bad.state is CapabilityState.UNKNOWN)


def _due_of_silence(book: Book, robot: RobotRecord, now: Instant) -> float:
    """When (monotonic) its silence is a fault; never where something larger explains it.

    Nor for one that was never received: what that lacks is not lost.
    """
    problem = robot.problems.get(State.SILENT)
    if problem is None or robot.cut_off_since is not None:
        return inf
    return inf if suppression.explanation(book, problem, now) else book.due(problem)


def _problems_of(robot: RobotRecord, part: PartName) -> Iterable[Problem]:
    if part.check:
        return [robot.checks[part.check]] if part.check in robot.checks else ()
    component = robot.components.get(ComponentName(part.group, part.component))
    if component is None:
        return ()
    if not part.key:
        return component.all_problems()
    # Of a value nothing is known while its component is STALE.
    stale = [] if component.level is not Level.STALE else [*component.problems.values()]
    return [*stale, *(each for key, each in component.values.items() if key[0] == part.key)]


def _state_of_part(problem: Problem) -> CapabilityState:
    """What a problem leaves of the part that has it."""
    state, verdict = problem.identity.state, problem.verdict
    if state in _NO_TROUBLE or verdict is Verdict.HEALTHY:
        return CapabilityState.OK
    component = problem.component
    if state is State.FLAPPING and component is not None and component.flaps is not None:
        # One that changes all the time is as good as at its worst.
        levels = map(Level, set(component.flaps.slots))
        return max(_OF_LEVEL.get(level, CapabilityState.OK) for level in levels)
    if verdict is Verdict.NO_DATA or state is State.STALE:
        return CapabilityState.UNKNOWN
    if state is State.CRITICAL:
        return CapabilityState.LOST
    return CapabilityState.DEGRADED if verdict is Verdict.FAILING else CapabilityState.UNKNOWN


def _judge(
    book: Book, capability: CapabilityRecord, actual: Standing, in_use: Standing, now: Instant
) -> None:
    """Take how good it is, and how good it is without what is in maintenance."""
    robot = capability.robot
    if actual.state is not capability.state:
        capability.state = actual.state
        if robot is not None:
            book.followed[robot.name] = None
    capability.due = actual.due
    capability.lacks_only_unreceived = (
        actual.state is CapabilityState.UNKNOWN and actual is not NOT_KNOWN and not actual.parts
    )
    parts = dict(_remembered(book, capability, {**in_use.parts, **actual.parts}))
    # What is STALE in a downtime of its own hides nothing of the others.
    known = in_use if actual.state is CapabilityState.UNKNOWN else actual
    if known.state not in (CapabilityState.OK, CapabilityState.UNKNOWN):
        worst = min(in_use.state, known.state)
        if (worst, parts) != (capability.worst, capability.parts):
            capability.worst, capability.parts = worst, parts
            book.write(capability)
            if robot is not None:
                book.touch(robot.all_problems())
    for fault_state, state in _STATES.items():
        verdict = _verdict_on(state, actual, in_use)
        if verdict is Verdict.NO_DATA and _is_repaired(book, capability, actual, now):
            verdict = Verdict.HEALTHY
        if in_use.due == inf:  # something larger explains the silence of too many robots
            verdict = min(verdict, Verdict.NO_DATA)
        _take_verdict(book, capability, fault_state, (verdict, in_use.due), now)


def _remembered(
    book: Book, capability: CapabilityRecord, parts: Mapping[PartName, Bad]
) -> Iterator[tuple[PartName, Bad]]:
    """The parts, those in maintenance as bad as before it: what is wrong meanwhile counts not."""
    for part, bad in parts.items():
        if not is_maintained(book, capability.robot, part):
            yield part, bad
        elif part in capability.parts:
            yield part, min(bad, capability.parts[part])


def _take_verdict(
    book: Book,
    capability: CapabilityRecord,
    state: State,
    verdict_and_due: tuple[Verdict, float],
    now: Instant,
) -> None:
    """Pass the verdict on a state on to its problem, made where there is trouble and none yet.

    With it when (monotonic) the trouble has lasted for its confirm_after.
    """
    verdict, due = verdict_and_due
    problem, robot = capability.problems.get(state), capability.robot
    if problem is None and verdict >= Verdict.ABSENT:
        name = "" if robot is None else robot.name
        identity = Identity(Scope.CAPABILITY, state, robot=name, check=capability.name)
        problem = book.new_problem(identity, now)
        book.write(capability)
    if problem is None:
        return
    clock = max(due, problem.since.mono)
    if verdict >= Verdict.ABSENT and problem.clock != clock:
        problem.clock = clock
        book.write(problem)  # with the same verdict, too: a restart is not to judge it sooner
    book.give_verdict(problem, verdict)


def _is_repaired(book: Book, capability: CapabilityRecord, actual: Standing, now: Instant) -> bool:
    """Whether it is not known, and not for the parts for which it was bad: these are OK.

    So it is with a part that was never received, or that fleet.yml ignores. Where it is not known
    for which it was bad, or these are robots, all that was received has to be OK.
    """
    wanted, bad = capability.wanted, capability.parts.keys()
    if wanted is None or actual is NOT_KNOWN:
        return False
    if actual.state is not CapabilityState.UNKNOWN:
        return False
    parts = set(needs.parts_of(wanted.need, defaultdict(tuple)))
    if capability.robot is None:
        is_known = all(_lacks_nothing_received(book, part, actual) for part in parts)
    elif bad:
        return bad <= parts and bad.isdisjoint(actual.parts)
    else:
        is_known = not actual.parts
    return is_known and now.mono >= book.grace_until


def _lacks_nothing_received(book: Book, part: PartName, actual: Standing) -> bool:
    """Whether a robot can do it, as far as anything was received of what it takes."""
    owner = book.robots.get(part.robot)
    capability = None if owner is None else owner.capabilities.get(part.check)
    if capability is None:
        return False
    return part not in actual.parts or capability.lacks_only_unreceived


def _verdict_on(state: CapabilityState, actual: Standing, in_use: Standing) -> Verdict:
    """Whether it is just as good as this, by how good it is without what is in maintenance."""
    if in_use.state is state:
        return Verdict.ABSENT if in_use.absent else Verdict.FAILING
    # One goes on under a worse, which is no recovery; that nothing is known is none, either.
    is_known = CapabilityState.UNKNOWN not in (actual.state, in_use.state)
    return Verdict.HEALTHY if is_known and actual.state < state else Verdict.NO_DATA


# -- asked -------------------------------------------------------------------------------------


def views(book: Book, records: Mapping[str, CapabilityRecord]) -> dict[str, NeedView]:
    """What a robot or the fleet can do, in the order of need, with how good all parts are."""
    found: dict[str, NeedView] = {}
    for name, capability in records.items():
        if capability.wanted is None:  # adopted, and not configured yet
            continue
        others = {other: view.parts for other, view in found.items()}
        parts = dict.fromkeys(needs.parts_of(capability.wanted.need, others))
        robot = capability.robot
        found[name] = NeedView(
            capability.state,
            capability.wanted,
            {each: _known_state(book, robot, each) for each in parts},
            frozenset(each for each in parts if is_maintained(book, robot, each)),
        )
    return found


def _known_state(book: Book, robot: RobotRecord | None, part: PartName) -> CapabilityState:
    if robot is not None:
        return _of_part(book, robot, part).state if robot.up else CapabilityState.UNKNOWN
    owner = book.robots.get(part.robot)
    capability = None if owner is None else owner.capabilities.get(part.check)
    return CapabilityState.UNKNOWN if capability is None else capability.state
