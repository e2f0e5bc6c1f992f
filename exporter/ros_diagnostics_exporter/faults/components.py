"""What is reported of a robot's parts: levels of components, values, checks; what that means."""

from __future__ import annotations

from collections.abc import Container, Mapping
from math import inf, isnan
from types import MappingProxyType

from ros_diagnostics_exporter.config.fleet import Threshold
from ros_diagnostics_exporter.faults import causes, suppression
from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.judge import end_all
from ros_diagnostics_exporter.faults.model import (
    Change,
    ComponentName,
    ComponentReport,
    ComponentSettings,
    Identity,
    Scope,
    State,
    ValueReport,
    Verdict,
)
from ros_diagnostics_exporter.faults.records import (
    SLOTS,
    ComponentRecord,
    FlapHistory,
    Problem,
    RobotRecord,
    ValueKey,
)
from ros_diagnostics_exporter.model import Instant, Level

_HEALTHY, _NO_DATA, _ABSENT, _FAILING = Verdict
_OK, _WARN, _ERROR, _STALE = Level
_COMPONENT = Scope.COMPONENT
_CRITICAL, _FLAPPING, _INTERMITTENT = State.CRITICAL, State.FLAPPING, State.INTERMITTENT
_WARNING = State.WARNING
# WARNING goes on under STALE and CRITICAL, and STALE under CRITICAL: the worse is no recovery.
_OF_LEVEL: Mapping[Level, Mapping[State, Verdict]] = MappingProxyType(
    {
        Level.OK: {State.WARNING: _HEALTHY, State.STALE: _HEALTHY, State.CRITICAL: _HEALTHY},
        Level.WARN: {State.WARNING: _FAILING, State.STALE: _HEALTHY, State.CRITICAL: _HEALTHY},
        Level.ERROR: {State.WARNING: _NO_DATA, State.STALE: _NO_DATA, State.CRITICAL: _FAILING},
    }
)
_NOTHING_KNOWN = {State.WARNING: _NO_DATA, State.STALE: _NO_DATA, State.CRITICAL: _NO_DATA}


def of_component(
    level: Level, settings: ComponentSettings, known: Container[State]
) -> Mapping[State, Verdict]:
    """The verdict on each state of a component; ``known`` are those that it is in already."""
    if level is not _STALE:
        return _OF_LEVEL[level]
    if settings.planned_stale:
        return _NOTHING_KNOWN
    # An ERROR that no longer reports is still an ERROR, and a WARNING a WARNING.
    critical = settings.stale_is_critical or State.CRITICAL in known
    return {
        State.WARNING: _ABSENT if State.WARNING in known and not critical else _NO_DATA,
        State.STALE: _ABSENT,
        State.CRITICAL: _ABSENT if critical else _NO_DATA,
    }


def of_value(
    threshold: Threshold, number: float | None, hysteresis: float, *, in_trouble: bool
) -> Verdict:
    """The verdict on a value: in trouble beyond the threshold, and healthy again beyond hysteresis.

    ``hysteresis`` is a share of the threshold.
    """
    if number is None or isnan(number):
        return Verdict.NO_DATA
    margin = abs(threshold.value) * hysteresis if in_trouble else 0.0
    if threshold.bound == "low":
        good = number >= threshold.value + margin
    else:
        good = number <= threshold.value - margin
    return Verdict.HEALTHY if good else Verdict.FAILING


def judge_flapping(
    book: Book,
    problems: Mapping[State, Problem],
    history: FlapHistory,
    identity: Identity,
    now: Instant,
    *,
    is_known: bool = True,
) -> None:
    """Judge how often what has these problems changes; unless ``is_known``, rest is no end."""
    problem = problems.get(_FLAPPING) or book.new_problem(identity, now)
    settings, flaps = book.settings.flapping, problem.verdict is not _HEALTHY
    verdict = _HEALTHY if is_known else _NO_DATA
    if history.ratio >= (settings.stop if flaps else settings.start):
        verdict = _FAILING
    book.give_verdict(problem, verdict)


def report_level(book: Book, robot: RobotRecord, report: ComponentReport, now: Instant) -> None:
    """Take the level of one component of a robot that is up."""
    name, level, settings, is_first = report
    planned = level is _STALE and settings.planned_stale
    component = robot.components.get(name)
    if component is None:
        if level is _OK or planned:
            return
        component = book.add_component(ComponentRecord(robot, name, settings))
    component.settings, component.level = settings, level
    if settings.depends_on:
        robot.has_dependencies = True
    if not planned:
        _note_change(book, component, level, now)
    _judge_intermittent(book, component, now)
    if level is _OK:
        component.since, component.boots_until = None, -inf
    elif component.since is None and not planned:
        component.since = now
    if is_first and level is not _OK and not robot.is_restarted:
        component.boots_until = robot.booted_until
    _judge_level(book, component, now)
    causes.count_component(book, component, now)
    book.touched_causes[robot.many] = None
    book.write(component)
    if component.is_usual:
        book.drop_component(component)


def _judge_level(book: Book, component: ComponentRecord, now: Instant) -> None:
    if component.level is _OK and not component.problems:
        return
    known: Container[State] = ()
    if component.level is _STALE:  # asked of nothing else
        known = {state for state, each in component.problems.items() if not each.by_setting}
    found = of_component(component.level, component.settings, known)
    for state, verdict in found.items():
        problem = component.problems.get(state)
        if problem is None:
            if verdict < _ABSENT or component.since is None:
                continue
            # What is worse than a warning counts from when it turned so: one that got better and
            # worse again is another fault, which no acknowledgement of the first one holds.
            since = component.since if state is _WARNING else now
            identity = Identity(_COMPONENT, state, "", component.robot.name, *component.name)
            problem = book.new_problem(identity, since)
            problem.by_setting = state is _CRITICAL
        if component.since is not None:
            problem.clock = component.since.mono
        if verdict is _FAILING:
            problem.by_setting = False
        book.give_verdict(problem, verdict)
    if component.level is _STALE:
        for value in component.values.values():
            book.give_verdict(value, Verdict.NO_DATA)


def hold(book: Book, robot: RobotRecord, now: Instant) -> None:
    """Note that nothing fresh is known of any part of the robot."""
    robot.trends.clear()
    for problem in robot.checks.values():
        book.give_verdict(problem, Verdict.NO_DATA)
    for component in robot.components.values():
        component.level = _STALE
        for state, problem in component.problems.items():
            if state is not _FLAPPING:
                book.give_verdict(problem, _NO_DATA)
        for problem in component.values.values():
            book.give_verdict(problem, _NO_DATA)
        causes.count_component(book, component, now)
        book.write(component)
    book.touched_causes[robot.many] = None


# -- flapping ----------------------------------------------------------------------------------


def _note_change(book: Book, component: ComponentRecord, level: Level, now: Instant) -> None:
    """Count a change of level; not in maintenance, nor what an aggregator reports after a start."""
    robot = component.robot
    last = _OK if component.flaps is None else component.flaps.slots[-1]
    returned = level is _STALE and now.mono < robot.returned_until
    if level == last or returned or component.in_downtime:
        return
    if component.flaps is None:
        component.flaps = FlapHistory([last] * SLOTS, now.mono)
    component.flaps.change(level, now.mono, robot.settings.flap_interval)
    larger = robot.many.problems or book.causes or robot.settings.uplink
    may_be_said = larger or robot.capabilities or robot.has_dependencies
    if component.has_fault or (may_be_said and suppression.is_reported(book, component, now)):
        book.forget_changes(component)  # people know of what explains them
    _judge_flapping(book, component, component.flaps, now)


def decay(book: Book, component: ComponentRecord, now: Instant) -> None:
    """Let a component that changed come to rest; silence of its robot is no rest."""
    flaps = component.flaps
    if flaps is None or not component.robot.up:
        return
    flaps.decay(now.mono, component.robot.settings.flap_interval)
    within = book.settings.intermittent.within
    # Computed as the timer is: else rounding keeps what is due, and the timer is due for ever.
    flaps.changed = tuple(mono for mono in flaps.changed if mono + within > now.mono)
    if component.has_fault:
        book.forget_changes(component)  # people know: warnings may have waited for their hours
    _judge_intermittent(book, component, now)
    _judge_flapping(book, component, flaps, now)
    if _FLAPPING in component.problems:
        book.touch(component.problems.values())  # as `report_level` has what is received
    book.write(component)
    if component.is_usual:
        book.drop_component(component)


def resume(book: Book, component: ComponentRecord, now: Instant) -> None:
    """Go on counting changes after the robot's silence."""
    if component.flaps is not None:
        component.flaps.last = now.mono
        if component.is_intermittent:  # silence of its robot is no rest
            component.flaps.changed = (now.mono,) * len(component.flaps.changed)
        decay(book, component, now)


def wake(book: Book, component: ComponentRecord) -> None:
    """Have the component's changes decay in time, or forget that there were any."""
    flaps = component.flaps
    if flaps is None:
        return
    due = inf
    if flaps.ratio > 0.0:
        due = flaps.last + component.robot.settings.flap_interval
    if flaps.changed:
        due = min(due, flaps.changed[0] + book.settings.intermittent.within)
    book.timers.set_at_latest(("flaps", component), due)  # too early: it is set again then
    if due == inf and flaps.slots[-1] == _OK:
        component.flaps = None


def _judge_intermittent(book: Book, component: ComponentRecord, now: Instant) -> None:
    """Judge how many changes there were of late.

    A fault ends once fewer than half of what it takes are left, and the component is received OK.
    """
    problem = component.problems.get(_INTERMITTENT)
    number = 0 if component.flaps is None else len(component.flaps.changed)
    level, most = component.level, book.settings.intermittent.changes
    if problem is None and number < most:
        return
    is_fault = problem is not None and problem.fault is not None
    lasts = is_fault and (2 * number >= most or level is not _OK)
    verdict = _NO_DATA if lasts else _HEALTHY
    if number >= most:
        verdict = _FAILING
    robot = component.robot.name
    identity = Identity(Scope.FLAPPING, _INTERMITTENT, "", robot, *component.name)
    book.judge(identity, verdict, now)


def _judge_flapping(
    book: Book, component: ComponentRecord, flaps: FlapHistory, now: Instant
) -> None:
    robot, problems = component.robot, component.problems
    if _FLAPPING in problems or flaps.ratio >= book.settings.flapping.start:  # of most neither
        identity = Identity(Scope.FLAPPING, _FLAPPING, "", robot.name, *component.name)
        judge_flapping(book, problems, flaps, identity, now)
        book.touched_causes[robot.many] = None
    wake(book, component)


# -- values and checks -------------------------------------------------------------------------


def report_value(
    book: Book,
    location: tuple[RobotRecord, ComponentName, ComponentSettings],
    report: ValueReport,
    now: Instant,
) -> list[Change]:
    """Take one value of a component of a robot that is up; what ended with its threshold."""
    robot, name, settings = location
    changes = _drop_unwanted(book, robot.components.get(name), report, now)
    for threshold in report.thresholds:
        component = robot.components.get(name)
        problem = None if component is None else component.values.get(_value_key(report, threshold))
        verdict = of_value(
            threshold,
            report.number,
            book.settings.value_hysteresis,
            in_trouble=problem is not None and problem.lasts,
        )
        verdict = min(verdict, report.most)
        if problem is None and verdict is Verdict.FAILING:
            component = component or book.add_component(ComponentRecord(robot, name, settings))
            problem = _add_value(book, component, report, threshold, now)
        if problem is not None:
            if report.is_first and not robot.is_restarted:
                problem.boots_until = robot.booted_until
                book.write(problem)
            book.give_verdict(problem, verdict)
    if name in robot.components:
        robot.components[name].settings = settings
        book.write(robot.components[name])
    return changes


def _value_key(report: ValueReport, threshold: Threshold) -> ValueKey:
    return report.key, threshold.bound, threshold.severity


def _drop_unwanted(
    book: Book, component: ComponentRecord | None, report: ValueReport, now: Instant
) -> list[Change]:
    """End what rested on thresholds that the config no longer has."""
    if component is None:
        return []
    wanted = {_value_key(report, each) for each in report.thresholds}
    if (report.key, "low", "critical") in wanted:
        wanted.add((report.key, "low", "falling"))
    unwanted = [
        problem
        for value_key, problem in component.values.items()
        if value_key[0] == report.key and value_key not in wanted
    ]
    return end_all(book, unwanted, now)


def _add_value(
    book: Book, component: ComponentRecord, report: ValueReport, threshold: Threshold, now: Instant
) -> Problem:
    identity = Identity(
        Scope.VALUE,
        State(threshold.severity),
        "",
        component.robot.name,
        *component.name,
        key=report.key,
        bound=threshold.bound,
    )
    return book.new_problem(identity, now)


def report_check(
    book: Book, robot: RobotRecord, check: str, numbers: tuple[int, int], now: Instant
) -> None:
    """Take how many components a check of a robot that is up (found, expects)."""
    found, expected = numbers
    problem = robot.checks.get(check)
    if problem is None and found < expected:
        identity = Identity(Scope.CHECK, State.CRITICAL, robot=robot.name, check=check)
        problem = book.new_problem(identity, now)
    if problem is not None:
        if found < expected and not robot.is_restarted:
            problem.boots_until = robot.booted_until
        book.give_verdict(problem, Verdict.ABSENT if found < expected else Verdict.HEALTHY)
