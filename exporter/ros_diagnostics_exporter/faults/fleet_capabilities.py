"""What a fleet can do: how many of its robots can do something, by the same expressions.

No fault of a robot is quiet under that of the fleet: each robot has to be repaired all the same.
A robot in maintenance is left out in both directions; what is not received of one is not known.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf

from ros_diagnostics_exporter.faults import needs
from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.capabilities import STATES, take_verdicts, verdict_on
from ros_diagnostics_exporter.faults.model import (
    Ability,
    PartName,
    Scope,
    State,
    Verdict,
)
from ros_diagnostics_exporter.faults.needs import (
    FINE,
    NOT_KNOWN,
    Bad,
    NeedView,
    Other,
    Standing,
    WantedCapability,
)
from ros_diagnostics_exporter.faults.records import FleetCapabilityRecord, Problem, RobotRecord
from ros_diagnostics_exporter.model import Instant

_Found = dict[str, "Standing | None"]


def configure(book: Book, wanted: Iterable[WantedCapability], now: Instant) -> list[Problem]:
    """Have just these, each after those that it needs; the problems of those that are gone."""
    former, book.fleet_capabilities = book.fleet_capabilities, {}
    for each in wanted:
        record = former.pop(each.name, None) or FleetCapabilityRecord(each.name)
        record.wanted = each
        book.fleet_capabilities[each.name] = record
    if book.fleet_capabilities:
        book.timers.set_at_latest(("fleet", None), now.mono)
    return [problem for each in former.values() for problem in each.problems.values()]


def adopt(book: Book, name: str) -> FleetCapabilityRecord:
    """The capability of a fault of before the start, which lasts until robots are received."""
    record = book.fleet_capabilities.get(name)
    if record is None:
        record = book.fleet_capabilities[name] = FleetCapabilityRecord(name)
    record.adopted = True
    return record


def judge(book: Book, now: Instant) -> None:
    """Judge what the fleet can do, by what its robots can."""
    found: _Found = {}
    in_use: _Found = {}
    for name, record in book.fleet_capabilities.items():
        actual = found[name] = _outcome(book, record, found, leave_out=False)
        left = in_use[name] = _outcome(book, record, in_use, leave_out=True)
        if record.adopted and now.mono >= book.grace_until:
            record.adopted = False
        if record.adopted or record.wanted is None:
            actual = left = NOT_KNOWN
        _judge(book, record, actual or NOT_KNOWN, left or NOT_KNOWN, now)


def _outcome(
    book: Book, record: FleetCapabilityRecord, others: _Found, *, leave_out: bool
) -> Standing | None:
    def look(part: PartName | Other) -> Standing | None:
        if isinstance(part, Other):
            return others[part.name]
        robot = book.robots.get(part.robot)
        if robot is None:
            return NOT_KNOWN
        if robot.maintenance:
            return None if leave_out or not record.problems else _held(book, record, robot, part)
        return _of_robot(book, robot, part)

    return None if record.wanted is None else needs.outcome(record.wanted.need, look)


def _held(
    book: Book, record: FleetCapabilityRecord, robot: RobotRecord, part: PartName
) -> Standing | None:
    """A robot in maintenance while there is a fault: as bad as before it, which is no recovery."""
    found = _of_robot(book, robot, part)
    before = record.parts.get(part)
    if before is None:
        return found
    ability = max(found.ability, before.ability)
    return Standing(ability, {part: Bad(ability, before.due)}, before.due, found.absent)


def _of_robot(book: Book, robot: RobotRecord, part: PartName) -> Standing:
    """How good a robot is at it: one that has no reserve for it can do it."""
    capability = robot.capabilities.get(part.check)
    if capability is None:
        return NOT_KNOWN
    if not robot.up:
        due = _due_of_silence(book, robot)
        return Standing(Ability.UNKNOWN, {part: Bad(Ability.UNKNOWN, due)}, due, absent=True)
    if capability.ability in (Ability.OK, Ability.NO_RESERVE):
        return FINE
    is_unknown = capability.ability is Ability.UNKNOWN
    bad = Bad(capability.ability, capability.due)
    return Standing(bad.ability, {part: bad}, bad.due, absent=is_unknown)


def _due_of_silence(book: Book, robot: RobotRecord) -> float:
    """When (monotonic) its silence is a fault; never where something larger explains it.

    Nor for one that was never received: what that lacks is not lost.
    """
    problem = robot.problems.get(State.SILENT)
    explained = robot.unreachable or any(
        site == robot.settings.site and scope is Scope.SITE and cause.active
        for (scope, site), cause in book.causes.items()
    )
    return inf if problem is None or explained else book.due(problem)


def _judge(
    book: Book, record: FleetCapabilityRecord, actual: Standing, in_use: Standing, now: Instant
) -> None:
    record.ability = actual.ability
    if actual.ability is Ability.OK:
        record.parts = {}
    elif actual.ability is not Ability.UNKNOWN:
        record.parts = {**in_use.parts, **actual.parts}
    verdicts = {state: verdict_on(each, actual, in_use) for state, each in STATES.items()}
    if in_use.due == inf:
        verdicts = {state: min(each, Verdict.HELD) for state, each in verdicts.items()}
    take_verdicts(book, record, verdicts, in_use.due, now)


def views(book: Book) -> dict[str, NeedView]:
    """What the fleet can do, each after those that it needs, with how good all robots are."""
    found: dict[str, NeedView] = {}
    for name, record in book.fleet_capabilities.items():
        if record.wanted is None:
            continue
        others = {other: view.parts for other, view in found.items()}
        parts = list(dict.fromkeys(needs.parts_of(record.wanted.need, others)))
        found[name] = NeedView(
            record.ability,
            record.wanted,
            {each: _ability(book, each) for each in parts},
            frozenset(each for each in parts if _is_maintained(book, each)),
        )
    return found


def _ability(book: Book, part: PartName) -> Ability:
    robot = book.robots.get(part.robot)
    capability = None if robot is None else robot.capabilities.get(part.check)
    return Ability.UNKNOWN if capability is None else capability.ability


def _is_maintained(book: Book, part: PartName) -> bool:
    robot = book.robots.get(part.robot)
    return robot is not None and robot.maintenance
