"""Beginning and ending: what is in trouble, due and not suppressed is a fault until it is healthy.

Also the hours of the week in which faults of severity warning may begin.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from math import inf
from operator import attrgetter
from types import MappingProxyType
from typing import Any, Literal

from ros_diagnostics_exporter import weekly
from ros_diagnostics_exporter.faults import capabilities, causes, ends, suppression
from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.model import Change, Fault, Verdict
from ros_diagnostics_exporter.faults.records import Problem
from ros_diagnostics_exporter.faults.suppression import CLOCK_TOLERANCE
from ros_diagnostics_exporter.model import Instant

EVIDENCE_LENGTH = 4096  # characters
_HEALTHY = Verdict.HEALTHY
_CLOCK_SET = 1.0  # seconds between both clocks after which the wall clock was set


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
        change = weekly.next_change(hours.weekly, hours.time_zone, now.wall + CLOCK_TOLERANCE)
    if change < inf:
        book.timers.set(("hours", None), change - book.clock_offset)
    else:
        book.timers.clear(("hours", None))


def clock_was_set(book: Book, now: Instant) -> bool:
    """Whether the wall clock was set since the timer of the hours was, which is then wrong."""
    return abs(now.wall - now.mono - book.clock_offset) > _CLOCK_SET


def settle(book: Book, now: Instant) -> list[Change]:
    """Judge all that was touched, what explains others first; what began and ended."""
    changes: list[Change] = []
    while _propagate(book, now):
        # In the order of their identities, so that the result depends on nothing else. A fault that
        # is not healthy lasts, whatever else there is.
        touched = [each for each in book.touched if each.fault is None or each.verdict is _HEALTHY]
        touched.sort(key=attrgetter("identity"))
        book.touched.clear()
        for problem in touched:
            change = _judge(book, problem, now)
            if change is not None:
                changes.append(change)
    return changes


def _propagate(book: Book, now: Instant) -> bool:
    """Judge larger causes and capabilities, and pass on to all others what explains them now.

    Returns whether any problem is to be judged.
    """
    while book.changed or book.touched_robots or book.touched_causes:
        changed, book.changed = book.changed, {}
        for problem, before in changed.items():
            if problem.may_explain:
                _pass_on(book, problem, before, now)
        if book.touched_robots:
            capabilities.update_touched(book, now)
        # Last: enough of what something else explains would make one that then goes on with half.
        if not book.changed:
            causes.update_touched(book, now)
    return bool(book.touched)


def _pass_on(book: Book, explainer: Problem, before: Verdict, now: Instant) -> None:
    """Have judged again what a problem explains; once it is over, with time to be healthy, too."""
    explained = suppression.explained_by(book, explainer, now)
    explained_them = before >= Verdict.ABSENT or explainer.fault is not None
    if explained_them and explainer.verdict < Verdict.ABSENT and before is not explainer.verdict:
        suppression.release(book, explainer, explained, now)
    judge_explained(book, explainer, explained, now)


def judge_explained(book: Book, explainer: Problem, explained: list[Problem], now: Instant) -> None:
    """Have judged and counted again what a problem explains, or no longer does."""
    if not explained:
        return
    book.touch(explained)
    robots = dict.fromkeys([each.robot for each in explained if each.robot is not None])
    leaving_out = {each for each in robots if causes.may_leave_out(book, each)}
    for component in dict.fromkeys([each.component for each in explained]):
        if component is None or component is explainer.component:
            continue
        if component.robot in leaving_out:
            causes.count_component(book, component, now)
            book.touched_causes[component.robot.many] = None
    for robot in {each.robot: None for each in explained if each.component is None}:
        if robot is not None and robot is not explainer.robot:
            causes.count_robot(book, robot, now)


def _judge(book: Book, problem: Problem, now: Instant) -> Change | None:
    if problem.fault is not None:
        if problem.effect.ends and suppression.why_not_end(problem) is None:
            is_thinned = problem.is_thinned(now)
            reason: Literal["removed", "recovered"] = "removed" if is_thinned else "recovered"
            _drop(book, problem, now)
            ends.add(book, problem.fault, reason, now)
            return Change(reason, problem.fault, now.wall)
        return None
    if problem.verdict is _HEALTHY:
        _drop(book, problem, now)
        return None
    # In a reload, what it rests on may go with the former config: it is judged after that.
    return None if book.is_reloading else _begin_if_due(book, problem, now)


def _begin_if_due(book: Book, problem: Problem, now: Instant) -> Change | None:
    due = book.due(problem)
    if now.mono < due:
        book.timers.set(("confirm", problem), due)
        return None
    found = suppression.why_not_begin(book, problem, now)
    if found is None:
        return _begin(book, problem, now)
    _note_waiting(book, problem, found.by, now)
    return None


def _note_waiting(book: Book, problem: Problem, by: Problem | None, now: Instant) -> None:
    """Note since when only what is no fault yet explains it, and judge it when that is too long."""
    waits_since = problem.waits_since
    reporter = None if by is None else suppression.reporter_of(book, by, now)
    if reporter is None or reporter.fault is not None:
        waits_since = None
    elif waits_since is None:
        waits_since = now.mono
    if waits_since != problem.waits_since:
        problem.waits_since = waits_since
        book.write(problem)
    if waits_since is not None and suppression.latest(book, problem, now) > now.mono:
        book.timers.set(("confirm", problem), suppression.latest(book, problem, now))


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
        if problem.robot is not None:
            problem.robot.thinned = now.mono
        _drop(book, problem, now)
        if problem.fault is not None:
            ends.add(book, problem.fault, "removed", now)
    return [
        Change("removed", problem.fault, now.wall)
        for problem in ordered
        if problem.fault is not None
    ]


def describe(
    book: Book, fault: Fault, evidence: str, capabilities: str, details: Mapping[str, Any]
) -> Fault:
    """Fix a fault's evidence, for its life; the fault with it."""
    if fault.evidence:
        return fault
    texts = evidence[:EVIDENCE_LENGTH], capabilities[:EVIDENCE_LENGTH]
    described = replace(fault, evidence=texts[0], capabilities=texts[1], details=details)
    problem = book.problems.get(fault.identity)
    if problem is not None and problem.fault is fault:  # it still lasts
        problem.fault = described
        book.write(problem)
    return described


def _drop(book: Book, problem: Problem, now: Instant) -> None:
    component = problem.component
    may_explain = problem.lasts and problem.may_explain
    explained = suppression.explained_by(book, problem, now) if may_explain else []
    book.drop_problem(problem)
    judge_explained(book, problem, explained, now)
    if component is not None and component.is_usual:
        book.drop_component(component)
    if problem.cause is not None:
        causes.drop_usual(book, problem.cause)
