"""The faults of a fleet: takes what the state finds out, returns the faults that began and ended.

A component is judged only while its robot is up: what was known is void once it is silent. So
after `robot_back` the caller reports every component, every value that has thresholds and every
check that expects something, as they are after the robot's first array; then what changes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from math import inf
from typing import Any

from ros_diagnostics_exporter.config.fleet import FaultSettings
from ros_diagnostics_exporter.faults import (
    adoption,
    capabilities,
    causes,
    clocks,
    components,
    ends,
    judge,
    members,
    own,
    presence,
    removal,
    rows,
    trends,
)
from ros_diagnostics_exporter.faults.book import FLEET_ROW, Book, TimerKind
from ros_diagnostics_exporter.faults.model import (
    NO_OTHERS,
    CapabilityView,
    Change,
    ComponentName,
    ComponentReport,
    ComponentSettings,
    Counts,
    End,
    Fault,
    Followed,
    Identity,
    Others,
    OwnReport,
    ProblemView,
    Reason,
    RobotSettings,
    Row,
    ValueReport,
    Verdict,
    at_mono,
)
from ros_diagnostics_exporter.faults.needs import NeedView, WantedCapability
from ros_diagnostics_exporter.faults.records import Presence, RobotRecord
from ros_diagnostics_exporter.faults.suppression import why_not_begin, why_not_end
from ros_diagnostics_exporter.model import Instant

_SUPPRESSED = (Reason.DEPENDS_ON, Reason.CAPABILITY)  # by another fault of the same robot
Action = Callable[[Book, Any, Instant], None]
# What each timer does with the record that it is of, if any.
_ACTIONS: Mapping[TimerKind, Action] = {
    "confirm": lambda book, problem, _now: book.touch((problem,)),
    "ends": lambda book, _, now: ends.drop_old(book, now),
    "flaps": components.decay,
    "fleet": lambda book, _, now: capabilities.update_fleet(book, now),
    "hours": lambda book, _, now: judge.follow_hours(book, now),
    "presence": presence.decay,
    "waits": presence.end_wait,
    "returned": lambda book, robot, _now: presence.touch_all(book, robot),
    "settled": lambda book, _, now: presence.settle(book, now),
    "trends": trends.sample,
}


class Faults:
    """Everything that is wrong with a fleet.

    Each input lets time pass up to ``now`` first. All of them return what began and ended, in
    that order of time; robots that were not configured raise LookupError. Not thread-safe.
    """

    def __init__(self, settings: FaultSettings, others: Others = NO_OTHERS) -> None:
        self._book = Book(settings, others)

    # -- time --------------------------------------------------------------------------------

    def started(
        self, now: Instant, longest_confirm_after: float, found_after: float = 0.0
    ) -> list[Change]:
        """Note that the process has started: nothing is received yet, and restart_grace begins.

        To be called first, after `restore` and before time passes. Without the rows of a former
        process nothing is `settled` until what was wrong before has been judged again: it is
        received within restart_grace, and a fault after the fleet's ``longest_confirm_after``.
        ``found_after`` so many seconds all robots are known that are not declared.
        """
        book = self._book
        book.grace_until = now.mono + book.settings.restart_grace
        book.fleet_known_at = max(book.grace_until, now.mono + found_after)
        judged = book.grace_until + longest_confirm_after
        is_known = book.settled_at > -inf
        settled = max(book.grace_until, book.settled_at) if is_known else judged
        book.settled_at = min(settled, judged)  # whatever the wall clock was set to meanwhile
        book.timers.set(("settled", None), book.grace_until)
        book.written[FLEET_ROW] = None
        judge.set_hours_timer(book, now)
        for problem in book.problems.values():
            if problem.robot is None and problem.cause is None:  # of the exporter, or the fleet
                book.give_verdict(problem, Verdict.NO_DATA)  # until its part is reported
        for robot in book.robots.values():
            if robot.up:
                presence.fall_silent(book, robot, now, now, counts=False)
                robot.is_restarted = True
        return judge.settle(book, now)

    def settled(self, now: Instant) -> bool:
        """Whether restart_grace is over, and whatever was wrong before the start is a fault."""
        return now.mono >= self._book.settled_at

    @property
    def due_at(self) -> float:
        """When (monotonic) the next timer is due; infinite where there is none."""
        return self._book.timers.next

    def advance(self, now: Instant) -> list[Change]:
        """Let time pass; costs nothing while no timer is due."""
        timers = self._book.timers
        changes: list[Change] = []
        if self._book.settings.warning_hours is not None and judge.clock_was_set(self._book, now):
            judge.follow_hours(self._book, now)
            changes += judge.settle(self._book, now)
        while (due := timers.next) <= now.mono:
            # As of when each was due, so that it does not matter how often this is called; but not
            # of before the rows were read, whose state is a later one.
            at = at_mono(max(due, self._book.restored_at), now)
            for kind, record in timers.pop():
                _ACTIONS[kind](self._book, record, at)
            changes += judge.settle(self._book, at)
        return changes

    # -- config and people -------------------------------------------------------------------

    def configure(
        self, settings: FaultSettings, now: Instant, *, is_over: bool = True
    ) -> list[Change]:
        """Follow other settings of the fleet.

        Unless the reload ``is_over``, robots follow next, and this is to be called once more: only
        then does anything begin, and is judged what is larger than a robot.
        """
        changes = self.advance(now)
        book, has_changed = self._book, settings != self._book.settings
        book.settings, book.is_reloading = settings, not is_over
        if is_over:
            book.touch_causes()
            book.touch(book.problems.values())
        if has_changed:
            judge.set_hours_timer(book, now)
        for robot in book.robots.values() if has_changed else ():
            presence.judge_anew(book, robot, now)
        return changes + judge.settle(book, now)

    def take_others(self, others: Others, now: Instant) -> list[Change]:
        """Take what the other exporters of the fleet count towards larger faults."""
        changes = self.advance(now)
        causes.take_others(self._book, others)
        return changes + judge.settle(self._book, now)

    def configure_robot(
        self, name: str, settings: RobotSettings, now: Instant, *, declared: bool
    ) -> list[Change]:
        """Add a robot, or follow other settings of it; ``declared`` ones are missed if pending.

        What a fault has of the former settings, its labels, stays as it is.
        """
        changes = self.advance(now)
        book = self._book
        robot = book.robots.get(name)
        if robot is None:
            robot = book.add_robot(name, settings)
        elif robot.settings.site != settings.site:
            removal.leave_site(book, robot, now)
        robot.settings = settings
        robot.declared = declared
        if robot.presence is Presence.NEVER:
            changes += removal.end_pending(book, robot, now)
            presence.become_pending(book, robot, now)
        book.note_presence(robot)
        causes.count_robot(book, robot, now)
        presence.judge_anew(book, robot, now)
        book.write(robot)
        return changes + judge.settle(book, now)

    def configure_capabilities(
        self, robot: str | None, wanted: Iterable[WantedCapability], now: Instant
    ) -> list[Change]:
        """Have just these capabilities of a robot, or (None) the fleet, in their order of need."""
        changes = self.advance(now)
        record = None if robot is None else self._robot(robot)
        gone = capabilities.configure(self._book, record, wanted, now)
        changes += judge.end_all(self._book, gone, now)
        return changes + judge.settle(self._book, now) + self.advance(now)

    def maintenance(self, planned: Mapping[str, bool], now: Instant) -> list[Change]:
        """Begin (True) or end the planned downtimes of robots, of all that change at one time.

        What many of them have in common is seen only when they are given together.
        """
        changes = self.advance(now)
        for name, is_planned in planned.items():
            robot = self._robot(name)
            if robot.maintenance != is_planned:
                presence.set_maintenance(self._book, robot, now, planned=is_planned)
        return changes + judge.settle(self._book, now)

    def cut_off(self, changed: Mapping[str, bool], now: Instant) -> list[Change]:
        """Note robots whose DDS domain cannot be joined (True), or can again: all at one time."""
        changes = self.advance(now)
        for name, is_so in changed.items():
            presence.cut_off(self._book, self._robot(name), now, is_so=is_so)
        return changes + judge.settle(self._book, now)

    def components_in_maintenance(
        self, robot: str, names: frozenset[str], now: Instant
    ) -> list[Change]:
        """Set which components of a robot, by name, are in a downtime of their own."""
        changes = self.advance(now)
        presence.maintain_components(self._book, self._robot(robot), names, now)
        return changes + judge.settle(self._book, now)

    def forget_robot(self, name: str, now: Instant, *, moved: bool = False) -> list[Change]:
        """Take out a robot with all that is wrong with it, as a person wants it.

        ``moved``: another exporter has it now, and what is wrong with it lasts there.
        """
        changes = self.advance(now)
        removed = removal.remove_robot(self._book, self._robot(name), now)
        for each in removed if moved else ():
            ends.drop(self._book, each.fault.identity)
        changes += [] if moved else removed
        return changes + judge.settle(self._book, now)

    def forget_component(self, robot: str, name: ComponentName, now: Instant) -> list[Change]:
        """Take out a component with all that is wrong with it, as a person wants it."""
        changes = self.advance(now)
        changes += removal.remove_component(self._book, self._robot(robot), name, now)
        return changes + judge.settle(self._book, now)

    def component_moved(
        self, robot: str, old: ComponentName, new: ComponentName, now: Instant
    ) -> list[Change]:
        """Follow a component into another group: its faults end there and begin here."""
        changes = self.advance(now)
        changes += removal.move_component(self._book, self._robot(robot), old, new, now)
        return changes + judge.settle(self._book, now)

    # -- what is received --------------------------------------------------------------------

    def robot_back(self, name: str, now: Instant, *, may_boot: bool = True) -> list[Change]:
        """Note that a robot is received, for the first time or again; see the module.

        ``may_boot``: nobody has just begun to listen to it, as the exporter does after a start.
        """
        changes = self.advance(now)
        presence.come_back(self._book, self._robot(name), now, may_boot=may_boot)
        return changes + judge.settle(self._book, now)

    def robot_silent(self, name: str, since: Instant, now: Instant) -> list[Change]:
        """Note that nothing was received of a robot for its stale_after, ``since`` then."""
        changes = self.advance(now)
        presence.fall_silent(self._book, self._robot(name), since, now, counts=True)
        return changes + judge.settle(self._book, now)

    def robot_pending(self, name: str, now: Instant) -> list[Change]:
        """Note that a robot never received lost the publishers for which it counted as silent."""
        changes = self.advance(now)
        presence.become_pending(self._book, self._robot(name), now)
        return changes + judge.settle(self._book, now)

    def clocks(self, offsets: Mapping[str, float], now: Instant) -> list[Change]:
        """Take how far the clocks of all robots that are received differ, in seconds, by robot."""
        changes = self.advance(now)
        clocks.judge(self._book, offsets, now)
        return changes + judge.settle(self._book, now)

    def own(self, reports: Iterable[OwnReport], now: Instant) -> list[Change]:
        """Take all parts of the exporter itself, as they are now."""
        changes = self.advance(now)
        changes += own.judge(self._book, reports, now)
        return changes + judge.settle(self._book, now)

    def components_changed(
        self, robot: str, reports: Iterable[ComponentReport], total: int, now: Instant
    ) -> list[Change]:
        """Take the components whose level or settings one array changed.

        ``total`` is how many components the robot has. Nothing counts while the robot is silent.
        """
        changes = self.advance(now)
        book, known = self._book, self._robot(robot)
        if known.total != total:
            known.total = total
            book.touched_causes[known.many] = None
            book.write(known)
        if known.up:
            for report in reports:
                components.report_level(book, known, report, now)
        return changes + judge.settle(book, now)

    def values_changed(
        self,
        robot: str,
        name: ComponentName,
        settings: ComponentSettings,
        reports: Iterable[ValueReport],
        now: Instant,
    ) -> list[Change]:
        """Take the values of one component that changed, of those that have thresholds, or had."""
        changes = self.advance(now)
        known = self._robot(robot)
        if known.up:
            for report in reports:
                of = known, name, settings
                changes += components.report_value(self._book, of, report, now)
                trends.follow(self._book, of, report, now)
        return changes + judge.settle(self._book, now)

    def check_changed(
        self, robot: str, check: str, found: int, expected: int | None, now: Instant
    ) -> list[Change]:
        """Take how many components a check finds; ``expected`` None: it expects none any more."""
        changes = self.advance(now)
        known = self._robot(robot)
        if expected is None:
            changes += removal.remove_check(self._book, known, check, now)
        elif known.up:
            components.report_check(self._book, known, check, (found, expected), now)
        return changes + judge.settle(self._book, now)

    def describe(
        self,
        fault: Fault,
        evidence: str,
        capabilities: str = "",
        details: Mapping[str, Any] | None = None,
    ) -> Fault:
        """Fix the evidence of a fault that began: once, for its life, at most 4,096 characters.

        Returns the fault with it.
        """
        return judge.describe(self._book, fault, evidence, capabilities, details or {})

    def may_adopt(self, fault: Fault, now: Instant) -> bool:
        """Whether `adopt` would go on with a fault."""
        return adoption.may_adopt(self._book, fault, now)

    def adopt(self, fault: Fault, now: Instant) -> list[Change]:
        """Go on with a fault whose alert fires and which this process does not know.

        Nothing follows if its robot is not known, or it is known here that it has ended. What
        the robot's parts are now is to be reported again.
        """
        changes = self.advance(now)
        adopted = adoption.adopt(self._book, fault, now)
        if adopted is not None:
            changes.append(adopted)
        return changes + judge.settle(self._book, now)

    def describe_end(self, fault: Fault, message: str) -> None:
        """Keep the message that ended a fault, for those who read its end."""
        ends.describe(self._book, fault, message)

    def forget(self, robot: str, now: Instant) -> None:
        """Note that nothing of a robot is to be held any more, whether it is known here or not."""
        ends.forget(self._book, robot, now)

    def note_served(self, now: Instant) -> None:
        """Note that what ended was read by whoever holds the faults."""
        for ended in (*self._book.ended.values(), *self._book.forgotten.values()):
            if ended.until == inf:
                ended.until = now.mono + ends.KEPT
                self._book.timers.set_at_latest(("ends", None), ended.until)

    # -- what is asked -----------------------------------------------------------------------

    def faults(self) -> Iterator[Fault]:
        """All faults that last."""
        found = (each.fault for each in self._book.problems.values())
        return (each for each in found if each is not None)

    def faults_of(self, robot: str) -> list[Identity]:
        """Which faults a robot and its parts have."""
        problems = self._robot(robot).all_problems()
        return [each.identity for each in problems if each.fault is not None]

    def served(self) -> Iterator[Fault]:
        """Those that something has confirmed since the start: what a database has may be over."""
        for problem in self._book.problems.values():
            if problem.fault is not None and not problem.restored:
                yield problem.fault

    def counts(self) -> Counts:
        """What this exporter's robots count towards larger faults, for the others."""
        return causes.counts(self._book)

    def members(self, identity: Identity) -> Iterator[members.Member]:
        """The robots, or components of them, that a larger fault is about."""
        return members.members(self._book, identity)

    def ends(self) -> Iterator[End]:
        """What ended of late, and has not begun again."""
        for ended in (*self._book.ended.values(), *self._book.forgotten.values()):
            yield ended.end

    def problems(self, now: Instant, robot: str | None = None) -> Iterator[ProblemView]:
        """All problems, soft and hard, or those of one robot and its parts."""
        book = self._book
        wanted = book.problems.values() if robot is None else self._robot(robot).all_problems()
        for problem in wanted:
            healthy = problem.verdict is Verdict.HEALTHY
            reason, by = why_not_end(problem) if healthy else None, None
            if not healthy and problem.fault is None:
                found = why_not_begin(book, problem, now)
                reason = None if found is None else found.reason
                by = None if found is None or found.by is None else found.by.identity
            yield ProblemView(
                identity=problem.identity,
                since=problem.since.wall,
                due=at_mono(book.due(problem), now).wall,
                fault=problem.fault,
                suppressed=reason,
                healthy=healthy,
                by=by,
            )

    def suppressed_components(self, robot: str, now: Instant) -> dict[ComponentName, Reason]:
        """The components whose trouble is due and begins no fault: another one explains it."""
        book, record = self._book, self._robot(robot)
        if not (record.has_dependencies or record.capabilities):
            return {}
        return {
            component.name: found.reason
            for component in record.components.values()
            for problem in component.problems.values()
            if problem.lasts and problem.fault is None and book.due(problem) <= now.mono
            if (found := why_not_begin(book, problem, now)) and found.reason in _SUPPRESSED
        }

    def capabilities(self, robot: str) -> dict[str, CapabilityView]:
        """What a robot can do, each after those that it needs."""
        return {name: each.view for name, each in self._robot(robot).capabilities.items()}

    def needs(self, robot: str | None) -> dict[str, NeedView]:
        """What a robot, or (None) the fleet, can do in order of need, with how good parts are."""
        book = self._book
        records = book.capabilities if robot is None else self._robot(robot).capabilities
        return capabilities.views(book, records)

    def identities(self, robot: str) -> Iterator[Identity]:
        """Which problems a robot and its parts have."""
        return (problem.identity for problem in self._robot(robot).all_problems())

    def in_trouble(self, robot: str, name: ComponentName | None = None) -> bool:
        """Whether a component, or a robot or any part of it, has a problem: not to be forgotten."""
        known = self._robot(robot)
        if name is None:
            return next(known.all_problems(), None) is not None
        component = known.components.get(name)
        return component is not None and bool(component.problems or component.values)

    def followed(self, robot: str) -> dict[ComponentName, Followed]:
        """What is kept of the components of a robot that are or were in trouble."""
        return {
            name: Followed(each.since and each.since.wall, each.flaps.ratio if each.flaps else 0.0)
            for name, each in self._robot(robot).components.items()
        }

    def take_followed(self) -> list[str]:
        """The robots of which `followed` changed since they were last taken."""
        names, self._book.followed = self._book.followed, {}
        return list(names)

    # -- what outlives the process -----------------------------------------------------------

    def take_rows(self, now: Instant) -> list[Row]:
        """The rows that changed since they were last taken; to be taken now and then."""
        return rows.take(self._book, now)

    def restore(self, stored: Iterable[Row], now: Instant) -> list[Row]:
        """Put back the rows that a former process had, into an engine that has nothing yet.

        What follows is as it would have been there; robots that are no longer wanted are to be
        forgotten. Returns the rows that cannot be put back.
        """
        return rows.restore(self._book, stored, now)

    def _robot(self, name: str) -> RobotRecord:
        if name not in self._book.robots:
            raise LookupError(f"no robot {name!r} is configured")
        return self._book.robots[name]
