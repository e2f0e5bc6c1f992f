"""Clocks that are wrong: a robot's, or the exporter's own where half of the robots' differ.

Offsets are receipt minus stamp, so that the delay of the transport is part of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from statistics import median

from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.model import Identity, Scope, State, Verdict
from ros_diagnostics_exporter.faults.own import CLOCK
from ros_diagnostics_exporter.model import Instant

LIMIT = 5.0  # seconds: far above a delay, and enough to confuse whoever compares logs
_BACK = 4.0  # seconds: within this it is right again
_ENOUGH = 3  # robots that tell the exporter's clock from one of theirs


def judge(book: Book, offsets: Mapping[str, float], now: Instant) -> None:
    """Judge the offsets of all robots that are received; of others nothing is known."""
    own = _judge_own(book, offsets, now)
    for name, offset in offsets.items():
        robot = book.robots[name]
        problem = robot.problems.get(State.CLOCK)
        if own is Verdict.FAILING:
            verdict = Verdict.NO_DATA
        else:
            verdict = _verdict(offset, in_trouble=problem is not None)
        known = Verdict.HEALTHY if problem is None else problem.verdict
        if verdict is not known:  # of most robots nothing changes, and all are asked each second
            book.judge(Identity(Scope.ROBOT, State.CLOCK, robot=name), verdict, now)


def _judge_own(book: Book, offsets: Mapping[str, float], now: Instant) -> Verdict:
    problem = book.problems.get(CLOCK)
    verdict = Verdict.NO_DATA
    if len(offsets) >= _ENOUGH:
        verdict = _verdict(median(offsets.values()), in_trouble=problem is not None)
    book.judge(CLOCK, verdict, now)
    # Its fault says it of each robot also while too few are left to see it end.
    is_fault = problem is not None and problem.fault is not None
    return Verdict.FAILING if is_fault and verdict is Verdict.NO_DATA else verdict


def _verdict(offset: float, *, in_trouble: bool) -> Verdict:
    limit = _BACK if in_trouble else LIMIT
    return Verdict.FAILING if abs(offset) > limit else Verdict.HEALTHY
