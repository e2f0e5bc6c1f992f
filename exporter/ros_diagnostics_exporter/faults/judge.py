"""Beginning and ending: what is in trouble, due and not quiet is a fault until it is well."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from ros_diagnostics_exporter.faults import capabilities, causes, ends
from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.model import Change, Fault, Verdict
from ros_diagnostics_exporter.faults.quiet import why_not_begin, why_not_end
from ros_diagnostics_exporter.faults.records import Problem
from ros_diagnostics_exporter.model import Instant

EVIDENCE_LENGTH = 4096  # characters


def settle(book: Book, now: Instant) -> list[Change]:
    """Judge all that was touched, larger causes first; what began and ended."""
    capabilities.update_touched(book, now)
    causes.update_touched(book, now)
    changes: list[Change] = []
    # In the order of their identities, so that the result depends on nothing else.
    touched = sorted(book.touched, key=lambda problem: problem.identity)
    book.touched.clear()
    for problem in touched:
        change = _judge(book, problem, now)
        if change is not None:
            changes.append(change)
    return changes


def _judge(book: Book, problem: Problem, now: Instant) -> Change | None:
    if problem.fault is not None:
        if problem.verdict is Verdict.WELL and why_not_end(problem) is None:
            _drop(book, problem)
            ends.add(book, problem.fault, "recovered", now)
            return Change("recovered", problem.fault, now.wall)
        return None
    if problem.verdict is Verdict.WELL:
        _drop(book, problem)
        return None
    due = book.due(problem)
    if now.mono < due:
        book.timers.set(("confirm", problem), due)
        return None
    return _begin(book, problem, now) if why_not_begin(book, problem, now) is None else None


def _begin(book: Book, problem: Problem, now: Instant) -> Change:
    labels = {} if problem.robot is None else dict(problem.robot.settings.labels)
    fault = Fault(problem.identity, problem.since.wall, now.wall, MappingProxyType(labels))
    problem.fault = fault
    ends.drop(book, fault.identity)
    book.write(problem)
    return Change("began", fault, now.wall)


def end_all(book: Book, problems: Iterable[Problem], now: Instant) -> list[Change]:
    """Take problems out, as a person wants it; those that were faults, as changes."""
    ordered = sorted(problems, key=lambda problem: problem.identity)
    for problem in ordered:
        _drop(book, problem)
        if problem.fault is not None:
            ends.add(book, problem.fault, "removed", now)
    return [
        Change("removed", problem.fault, now.wall)
        for problem in ordered
        if problem.fault is not None
    ]


def describe(
    book: Book, fault: Fault, evidence: str, work: str, details: Mapping[str, Any]
) -> Fault:
    """Fix a fault's evidence, for its life; the fault with it."""
    if fault.evidence:
        return fault
    texts = evidence[:EVIDENCE_LENGTH], work[:EVIDENCE_LENGTH]
    described = replace(fault, evidence=texts[0], work=texts[1], details=details)
    problem = book.problems.get(fault.identity)
    if problem is not None and problem.fault is fault:  # it still lasts
        problem.fault = described
        book.write(problem)
    return described


def _drop(book: Book, problem: Problem) -> None:
    component = problem.component
    book.drop_problem(problem)
    if component is not None and component.is_usual:
        book.drop_component(component)
    if problem.cause is not None:
        causes.drop_usual(book, problem.cause)
