"""Nodes that publish one status name, each in arrays of its own: drivers leave the namespace out.

Their hardware_ids tell them apart. Where these are the same, the worse status counts, until no node
has repeated it for longer than it takes. What one node publishes never goes back and forth: the
hardware_id changes at most when a device is replaced, and the middleware's numbers grow.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ros_diagnostics_exporter.model import Instant, Status
from ros_diagnostics_exporter.robots.component import (
    GAP_FACTOR,
    LEAST_STALE_AFTER,
    STALE,
    STALE_AFTER_FIRST,
    Component,
    Held,
)

RETURNS = 3  # times that it goes back, each within STALE_AFTER_FIRST, until it is two nodes
MOST_NAMES = 4096  # of one robot, that are suspected


@dataclass(slots=True)
class _Suspect:
    """A name whose hardware_id or number went back: how often, and when last."""

    returns: int = 0
    at: float = float("-inf")
    high: int = 0  # the number before it went back
    left: dict[str, float] = field(default_factory=dict)  # hardware_ids, and when they were last

    def note(self, now: Instant) -> bool:
        """Count one more; whether it is several nodes."""
        self.returns = self.returns + 1 if now.mono - self.at <= STALE_AFTER_FIRST else 1
        self.at = now.mono
        return self.returns >= RETURNS


Suspects = dict[str, _Suspect]


def _suspect(suspects: Suspects, name: str) -> _Suspect:
    if len(suspects) >= MOST_NAMES:
        suspects.clear()
    return suspects.setdefault(name, _Suspect())


def are_by_id(suspects: Suspects, former: Status, status: Status, now: Instant) -> bool:
    """Whether the hardware_ids, of which another one came just now, are of several nodes."""
    suspect = _suspect(suspects, status.name)
    if len(suspect.left) >= MOST_NAMES:
        suspect.left.clear()
    suspect.left[former.hardware_id] = now.mono
    last = suspect.left.pop(status.hardware_id, float("-inf"))
    return now.mono - last <= STALE_AFTER_FIRST and suspect.note(now)


def are_by_number(suspects: Suspects, component: Component, number: int, now: Instant) -> bool:
    """Whether the numbers, of which one did not follow the last, are of several nodes.

    A node that was started again begins anew, and does not go on where it was before.
    """
    suspect = _suspect(suspects, component.identity[0])
    if number < component.number:
        suspect.high, component.goes_back = component.number, True
        return False
    if number > component.number and not suspect.high < number > component.number + 1:
        return False
    component.goes_back = False
    return suspect.note(now)


def counts(component: Component, held: Held, status: Status, now: Instant) -> bool:
    """Whether a status of several nodes counts: no worse one of another node does."""
    last, new = _severity(component.reported), _severity(status.level)
    is_beyond = component.values.beyond and not component.values.would_be_beyond(status.values)
    if new > last or (new == last and not is_beyond):
        component.held = Held(now.mono, now.mono - held.at if new == last else 0.0)
        return True
    return now.mono - held.at > max(LEAST_STALE_AFTER, GAP_FACTOR * held.gap)


def worse(one: Status, other: Status) -> Status:
    """The worse of two statuses, the first of two that are as bad."""
    return max(one, other, key=lambda status: _severity(status.level))


def _severity(level: int) -> int:
    """By the rank of its state, in which ERROR, and what counts as it, is worse than STALE."""
    return {0: 0, 1: 1, STALE: 2}.get(level, 3)
