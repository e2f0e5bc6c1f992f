"""What a robot can do: judged by the problems of its parts, which are quiet under its own.

A capability in trouble is the larger cause of what it rests on, and of capabilities that are in
trouble for no other parts: so there is one notification. The parts that keep it from being OK
are quiet at once, and for confirm_after after its end.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import inf

from ros_diagnostics_exporter.faults import needs
from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.model import (
    Ability,
    ComponentName,
    Identity,
    PartName,
    Scope,
    State,
    Verdict,
)
from ros_diagnostics_exporter.faults.needs import (
    NOT_KNOWN,
    Bad,
    NeedView,
    Other,
    Standing,
    WantedCapability,
)
from ros_diagnostics_exporter.faults.records import (
    CapabilityRecord,
    ComponentRecord,
    FleetCapabilityRecord,
    Problem,
    RobotRecord,
)
from ros_diagnostics_exporter.model import Instant, Level

FLEET_DELAY = 0.5  # seconds: what changes at once of many robots is judged together
STATES = {
    State.NO_RESERVE: Ability.NO_RESERVE,
    State.DEGRADED: Ability.DEGRADED,
    State.LOST: Ability.LOST,
}
_OF_LEVEL = {Level.WARN: Ability.DEGRADED, Level.STALE: Ability.UNKNOWN, Level.ERROR: Ability.LOST}
_NO_TROUBLE = {State.INTERMITTENT, State.FALLING}  # of what it can do now


# -- config ------------------------------------------------------------------------------------


def configure(book: Book, robot: RobotRecord, wanted: Iterable[WantedCapability]) -> list[Problem]:
    """Have just these capabilities, each after those that it needs.

    Returns what is to be taken out: problems of what is no longer wanted, or whose parts are gone.
    """
    former, robot.capabilities = robot.capabilities, {}
    gone: list[Problem] = []
    parts: dict[str, set[PartName]] = {}
    for each in wanted:
        capability = former.pop(each.name, None) or CapabilityRecord(robot, each.name)
        parts[each.name] = set(needs.parts_of(each.need, parts))
        # After a restart, components that its patterns match may not have been received yet.
        if capability.wanted is not None and not capability.parts.keys() <= parts[each.name]:
            gone += capability.problems.values()
        capability.wanted = each
        robot.capabilities[each.name] = capability
    for capability in former.values():
        gone += capability.problems.values()
        book.timers.clear(("cover", capability))
        book.write(capability)
    book.touched_robots[robot] = None
    book.touch(robot.all_problems())
    book.followed[robot.name] = None
    return gone


# -- judged ------------------------------------------------------------------------------------


def update_touched(book: Book, now: Instant) -> None:
    """Judge the capabilities of robots whose parts were touched."""
    for robot in book.touched_robots:
        _update(book, robot, now)
    if book.touched_robots and book.fleet_capabilities:
        book.timers.set_at_latest(("fleet", None), now.mono + FLEET_DELAY)
    book.touched_robots.clear()


def _update(book: Book, robot: RobotRecord, now: Instant) -> None:
    found: dict[str, Standing | None] = {}
    in_use: dict[str, Standing | None] = {}  # without what is in maintenance
    for name, capability in robot.capabilities.items():
        found[name] = _outcome(book, capability, found, leave_out=False)
        in_use[name] = found[name]
        if robot.maintained:
            in_use[name] = _outcome(book, capability, in_use, leave_out=True)
        if capability.adopted and robot.up and now.mono >= robot.returned_until:
            capability.adopted = False
        if robot.up and not capability.adopted:
            actual = found[name] or NOT_KNOWN
            _judge(book, capability, actual, in_use[name] or NOT_KNOWN, now)
        else:
            _judge(book, capability, NOT_KNOWN, NOT_KNOWN, now)


def _outcome(
    book: Book,
    capability: CapabilityRecord,
    others: Mapping[str, Standing | None],
    *,
    leave_out: bool,
) -> Standing | None:
    robot, wanted = capability.robot, capability.wanted
    if wanted is None or wanted.applies is None:
        return NOT_KNOWN
    if not wanted.applies:
        return needs.FINE

    def look(part: PartName | Other) -> Standing | None:
        if isinstance(part, Other):
            return others[part.name]
        is_maintained = part.component in robot.maintained
        if is_maintained and leave_out:
            return None
        found = _of_part(book, robot, part)
        if is_maintained and capability.active and part in capability.parts:  # quiet both ways
            worst, due = max(found.parts.get(part, capability.parts[part]), capability.parts[part])
            return Standing(worst, {part: Bad(worst, due)}, due, found.absent)
        return found

    return needs.outcome(wanted.need, look)


def _of_part(book: Book, robot: RobotRecord, part: PartName) -> Standing:
    """How good a part is, by the problems that it has."""
    worst = needs.FINE
    for problem in _problems_of(robot, part):
        ability = _ability(problem)
        if ability is Ability.OK or ability < worst.ability:
            continue
        due = book.due(problem)
        if ability == worst.ability:
            due = min(due, worst.due)
        absent = ability is Ability.UNKNOWN or problem.verdict is Verdict.ABSENT
        worst = Standing(ability, {part: Bad(ability, due)}, due, absent)
    return worst


def _problems_of(robot: RobotRecord, part: PartName) -> Iterable[Problem]:
    if part.check:
        return [robot.checks[part.check]] if part.check in robot.checks else ()
    component = robot.components.get(ComponentName(part.group, part.component))
    if component is None:
        return ()
    values = [each for of, each in component.values.items() if part.key in ("", of[0])]
    return values if part.key else (*component.problems.values(), *values)


def _ability(problem: Problem) -> Ability:
    """What a problem leaves of the part that has it."""
    state, verdict = problem.identity.state, problem.verdict
    if state in _NO_TROUBLE or verdict is Verdict.WELL:
        return Ability.OK
    component = problem.component
    if state is State.FLAPPING and component is not None and component.flaps is not None:
        # One that changes all the time is as good as at its worst.
        levels = map(Level, set(component.flaps.slots))
        return max(_OF_LEVEL.get(level, Ability.OK) for level in levels)
    if verdict is Verdict.HELD or state is State.STALE:
        return Ability.UNKNOWN
    if state is State.CRITICAL:
        return Ability.LOST
    return Ability.DEGRADED if verdict is Verdict.BAD else Ability.UNKNOWN


def _judge(
    book: Book, capability: CapabilityRecord, actual: Standing, in_use: Standing, now: Instant
) -> None:
    """Take how good it is, and how good it is without what is in maintenance."""
    if actual.ability is not capability.ability:
        capability.ability = actual.ability
        book.followed[capability.robot.name] = None
    capability.due = actual.due
    if actual.ability is not Ability.UNKNOWN:
        _cover(book, capability, actual, in_use, now)
    verdicts = {state: verdict_on(each, actual, in_use) for state, each in STATES.items()}
    take_verdicts(book, capability, verdicts, in_use.due, now)


def take_verdicts(
    book: Book,
    capability: CapabilityRecord | FleetCapabilityRecord,
    verdicts: Mapping[State, Verdict],
    due: float,
    now: Instant,
) -> None:
    """Pass the verdict on each state on to its problem, made where there is trouble and none yet.

    Args:
        book: The records of the fleet.
        capability: That of a robot or of the fleet.
        verdicts: On each of `STATES`.
        due: When (monotonic) the trouble has lasted for its confirm_after.
        now: The present time.
    """
    robot = capability.robot if isinstance(capability, CapabilityRecord) else None
    for state, verdict in verdicts.items():
        problem = capability.problems.get(state)
        if problem is None and verdict >= Verdict.ABSENT:
            name = "" if robot is None else robot.name
            identity = Identity(Scope.CAPABILITY, state, robot=name, check=capability.name)
            problem = Problem(identity, now, robot=robot, capability=capability)
            capability.problems[state] = book.add_problem(problem)
        if problem is None:
            continue
        if verdict >= Verdict.ABSENT:
            problem.clock = max(due, problem.since.mono)
        if verdict is Verdict.BAD:
            problem.restored = False
        if verdict is not problem.verdict:
            problem.verdict = verdict
            book.write(problem)
        book.touched[problem] = None


def verdict_on(ability: Ability, actual: Standing, in_use: Standing) -> Verdict:
    """Whether it is just as good as this, by how good it is without what is in maintenance."""
    if in_use.ability is ability:
        return Verdict.ABSENT if in_use.absent else Verdict.BAD
    # One goes on under a worse, which is no recovery; that nothing is known is none, either.
    is_known = actual.ability is not Ability.UNKNOWN
    return Verdict.WELL if is_known and actual.ability < ability else Verdict.HELD


def _cover(
    book: Book, capability: CapabilityRecord, actual: Standing, in_use: Standing, now: Instant
) -> None:
    """Note which parts it explains."""
    if actual.ability is Ability.OK:
        if capability.active is None:
            return
        capability.active = None
        capability.covers_until = now.mono + capability.robot.settings.confirm_after
        book.timers.set(("cover", capability), capability.covers_until)
    else:
        capability.worst = min(in_use.ability, actual.ability)
        parts = {**in_use.parts, **actual.parts}
        if capability.active is not None and parts == capability.parts:
            return
        capability.active, capability.parts = capability.active or now, parts
        book.touch(capability.robot.all_problems())
    book.write(capability)


def end_cover(book: Book, capability: CapabilityRecord) -> None:
    """Judge again what it explained, now that it no longer does."""
    capability.covers_until = -inf
    capability.parts = {}
    book.write(capability)
    book.touch(capability.robot.all_problems())


def adopt(book: Book, robot: RobotRecord, name: str) -> CapabilityRecord:
    """The capability of a fault of which this process knows nothing else."""
    capability = robot.capabilities.get(name)
    if capability is None:
        capability = robot.capabilities[name] = CapabilityRecord(robot, name)
    capability.adopted = True
    book.touched_robots[robot] = None
    return capability


def views(book: Book, robot: RobotRecord) -> dict[str, NeedView]:
    """What a robot can do, each after those that it needs, with how good all parts are."""
    found: dict[str, NeedView] = {}
    for name, capability in robot.capabilities.items():
        if capability.wanted is None:  # adopted, and not configured yet
            continue
        others = {other: view.parts for other, view in found.items()}
        parts = dict.fromkeys(needs.parts_of(capability.wanted.need, others))
        found[name] = NeedView(
            capability.ability,
            capability.wanted,
            {each: _known_ability(book, robot, each) for each in parts},
            frozenset(each for each in parts if each.component in robot.maintained),
        )
    return found


def _known_ability(book: Book, robot: RobotRecord, part: PartName) -> Ability:
    return _of_part(book, robot, part).ability if robot.up else Ability.UNKNOWN


# -- what is quiet under it --------------------------------------------------------------------


def explains(problem: Problem, now: Instant) -> bool:
    """Whether a capability in trouble explains a problem of a part, or of another capability."""
    robot = problem.robot
    if robot is None or not robot.capabilities:
        return False
    if isinstance(problem.capability, CapabilityRecord):
        return any(
            _is_larger(each, problem.capability, now) for each in robot.capabilities.values()
        )
    parts = _parts(problem.identity)
    return any(
        each.covers(now) and not each.parts.keys().isdisjoint(parts)
        for each in robot.capabilities.values()
    )


def _parts(identity: Identity) -> set[PartName]:
    """The parts to which a problem of this identity belongs."""
    if identity.scope is Scope.CHECK:
        return {PartName(check=identity.check)}
    if identity.scope not in (Scope.COMPONENT, Scope.VALUE, Scope.FLAPPING):
        return set()
    of = PartName(identity.group, identity.component)
    return {of, of._replace(key=identity.key)}


def is_known(component: ComponentRecord) -> bool:
    """Whether it is confirmed that a capability is in trouble because of a component."""
    of = PartName(*component.name)
    return any(each.is_fault and of in each.parts for each in component.robot.capabilities.values())


def _confirmed(capability: CapabilityRecord, now: Instant) -> set[PartName]:
    """The parts that keep it from being OK for long enough, and out of maintenance."""
    return {
        part
        for part, bad in capability.parts.items()
        if bad.due <= now.mono and part.component not in capability.robot.maintained
    }


def _is_larger(one: CapabilityRecord, other: CapabilityRecord, now: Instant) -> bool:
    """Whether one is in trouble for all parts of another, and worse, notified or first."""
    if one is other or one.active is None:
        return False
    its, others = _confirmed(one, now), _confirmed(other, now)
    if not others <= its:
        return False
    if one.worst is not other.worst:
        return one.worst > other.worst
    if others != its:
        return True
    if one.is_fault is not other.is_fault:
        return one.is_fault
    names = list(one.robot.capabilities)
    return names.index(one.name) < names.index(other.name)
