"""The faults that have ended: an alert resolves by this evidence, never because a fault is missing.

They are kept for an hour after they were first served, so that an end is known to whoever could not
ask for long, and until the same begins again.
"""

from __future__ import annotations

from dataclasses import replace
from math import inf
from typing import Literal

from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.model import End, Fault, Identity
from ros_diagnostics_exporter.faults.records import Ended, RowKey
from ros_diagnostics_exporter.model import Instant

KEPT = 3600.0  # seconds after it was first served
MOST = 10_000  # of either kind; the newest are kept


def row(identity: Identity) -> RowKey:
    """The row of what ended a fault."""
    return "end", identity


def add(book: Book, fault: Fault, reason: Literal["recovered", "removed"], now: Instant) -> None:
    """Note that a fault has ended."""
    drop(book, fault.identity)
    at = max(now.wall, fault.since)
    end = End(
        replace(fault, evidence="", capabilities="", details={}), fault.identity.robot, reason, at
    )
    book.ended[fault.identity] = Ended(end)
    book.written[row(fault.identity)] = None
    while len(book.ended) > MOST:
        drop(book, next(iter(book.ended)))


def drop(book: Book, identity: Identity) -> None:
    """No longer keep it: the same has begun again, or it was kept for long enough."""
    if book.ended.pop(identity, None) is not None:
        book.written[row(identity)] = None


def forget(book: Book, robot: str, now: Instant) -> None:
    """Note that a person wants nothing of a robot to be held, whether it is known or not."""
    book.forgotten.pop(robot, None)
    book.forgotten[robot] = Ended(End(None, robot, "removed", now.wall))
    while len(book.forgotten) > MOST:
        del book.forgotten[next(iter(book.forgotten))]


def describe(book: Book, fault: Fault, message: str) -> None:
    """Keep the message that ended a fault, for those who read its end."""
    ended = book.ended.get(fault.identity)
    if ended is not None:
        ended.end = ended.end._replace(message=message)
        book.written[row(fault.identity)] = None


def drop_old(book: Book, now: Instant) -> None:
    """Drop what was kept for long enough."""
    for identity in [each for each, ended in book.ended.items() if ended.until <= now.mono]:
        drop(book, identity)
    for robot in [each for each, ended in book.forgotten.items() if ended.until <= now.mono]:
        del book.forgotten[robot]
    left = [each.until for each in (*book.ended.values(), *book.forgotten.values())]
    if (due := min(left, default=inf)) < inf:
        book.timers.set(("ends", None), due)
