"""What is wrong with the exporter itself: a fault as any other, of no robot."""

from __future__ import annotations

from collections.abc import Iterable

from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.judge import end_all
from ros_diagnostics_exporter.faults.model import (
    Change,
    Identity,
    OwnReport,
    Scope,
    State,
    Verdict,
)
from ros_diagnostics_exporter.model import Instant, Level

CLOCK = Identity(Scope.EXPORTER, State.WARNING, component="clock")  # `clocks` judges it
_LEVEL = {State.WARNING: Level.WARN, State.CRITICAL: Level.ERROR}


def judge(book: Book, reports: Iterable[OwnReport], now: Instant) -> list[Change]:
    """Take all parts of the exporter as they are; what is wrong with others ends as removed."""
    parts = {report.part: report for report in reports}
    gone = [
        problem
        for part in book.own.keys() - parts.keys() - {CLOCK.component}
        for state in _LEVEL
        if (problem := book.problems.get(_identity(part, state))) is not None
    ]
    book.own = {part: report.confirm_after for part, report in parts.items()}
    for part, report in parts.items():
        for state, level in _LEVEL.items():
            book.judge(_identity(part, state), _verdict(report.level, level), now)
    return end_all(book, gone, now)


def _identity(part: str, state: State) -> Identity:
    return Identity(Scope.EXPORTER, state, component=part)


def _verdict(level: Level, bad: Level) -> Verdict:
    if level is Level.STALE:
        return Verdict.NO_DATA
    return Verdict.FAILING if level is bad else Verdict.HEALTHY
