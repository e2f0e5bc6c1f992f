"""The hours of the week in which faults of severity warning may begin."""

from __future__ import annotations

from math import inf

from ros_diagnostics_exporter import weekly
from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.model import Instant

_TOLERANCE = 0.001  # seconds by which a time that is computed by two clocks may be early
_CLOCK_SET = 1.0  # seconds between both clocks after which the wall clock was set


def warnings_may_begin(book: Book, now: Instant) -> bool:
    """Whether it is in the hours, or the config names none."""
    hours = book.settings.warning_hours
    if hours is None:
        return True
    return weekly.holds(hours.weekly, hours.time_zone, int((now.wall + _TOLERANCE) // 60))


def follow(book: Book, now: Instant) -> None:
    """Judge what may wait for the hours, now and when they begin or end next."""
    book.touch(problem for problem in book.problems.values() if problem.fault is None)
    wake(book, now)


def wake(book: Book, now: Instant) -> None:
    """Set the timer for the next begin or end of the hours."""
    hours = book.settings.warning_hours
    book.clock_offset = now.wall - now.mono
    change = inf
    if hours is not None:
        change = weekly.next_change(hours.weekly, hours.time_zone, now.wall + _TOLERANCE)
    if change < inf:
        book.timers.set(("hours", None), change - book.clock_offset)
    else:
        book.timers.clear(("hours", None))


def clock_was_set(book: Book, now: Instant) -> bool:
    """Whether the wall clock was set since the timer was, which is then wrong."""
    if book.settings.warning_hours is None:
        return False
    return abs(now.wall - now.mono - book.clock_offset) > _CLOCK_SET
