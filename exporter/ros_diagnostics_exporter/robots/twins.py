"""Nodes that publish one status name, each in arrays of its own: drivers leave the namespace out.

Their hardware_ids tell them apart: what one node publishes never goes back and forth. Where these
are the same, the worst counts of what each publisher said last. What it said counts until it takes
longer than it took before, or until the publisher is gone from the ROS graph; what is published
only on a change is not late. Whoever speaks alone is believed.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from math import inf
from typing import NamedTuple

from ros_diagnostics_exporter.model import Instant, Status
from ros_diagnostics_exporter.robots.component import (
    FIRST_GAP,
    GAP_FACTOR,
    STALE,
    STALE_AFTER_FIRST,
    Component,
    Said,
)
from ros_diagnostics_exporter.robots.components import Components

RETURNS = 3  # times that it goes back, each within STALE_AFTER_FIRST, until it is two nodes
MOST_NAMES = 4096  # of one robot, that are suspected
MOST_PUBLISHERS = 16  # of one component
LOOK_TIME = 5.0  # seconds that the graph may be older than when it is known


@dataclass(slots=True)
class _Suspect:
    """A name whose hardware_id went back: how often, and when last."""

    returns: int = 0
    at: float = -inf
    left: dict[str, float] = field(default_factory=dict)  # hardware_ids, and when they were last

    def note(self, now: Instant) -> bool:
        """Count one more; whether it is several nodes."""
        self.returns = self.returns + 1 if now.mono - self.at <= STALE_AFTER_FIRST else 1
        self.at = now.mono
        return self.returns >= RETURNS


Suspects = dict[str, _Suspect]


def are_by_id(suspects: Suspects, former: Status, status: Status, now: Instant) -> bool:
    """Whether the hardware_ids, of which another one came just now, are of several nodes."""
    if len(suspects) >= MOST_NAMES:
        suspects.clear()
    suspect = suspects.setdefault(status.name, _Suspect())
    if len(suspect.left) >= MOST_NAMES:
        suspect.left.clear()
    suspect.left[former.hardware_id] = now.mono
    last = suspect.left.pop(status.hardware_id, -inf)
    return now.mono - last <= STALE_AFTER_FIRST and suspect.note(now)


class Writers(NamedTuple):
    """The publishers of a topic as the ROS graph showed them, and when (monotonic)."""

    names: frozenset[str] = frozenset()
    at: float = -inf


def has_returned(component: Component, publisher: str) -> bool:
    """Whether another one has spoken since this publisher did: then they are two."""
    said = component.said or {}
    return publisher in said and publisher != next(reversed(said))


def note(component: Component, publisher: str, status: Status, now: Instant) -> None:
    """Note what a publisher says of a component."""
    said = component.said
    if said is None:
        said = component.said = {}
        if component.last is not None and component.publisher:
            at = min(component.last_report, now.mono)
            gap = component.gaps[-1] if component.gaps else 0.0
            said[component.publisher] = _said(component, component.last, at, gap)
    known = said.pop(publisher, None)
    gap = 0.0 if known is None else now.mono - known.at
    said[publisher] = _said(component, status, now.mono, gap)
    if len(said) > MOST_PUBLISHERS:
        del said[next(iter(said))]


def _said(component: Component, status: Status, at: float, gap: float) -> Said:
    is_beyond = component.values.judges and component.values.would_be_beyond(status.values)
    return Said(status, at, gap or FIRST_GAP, is_beyond)


def worst(component: Component, components: Components, writers: Writers, now: Instant) -> Status:
    """What counts of what all say; what does not any more is dropped.

    While the robot is not received nobody can say anything. That a publisher is gone is not known
    where the graph does not have the latest, too.
    """
    said = component.said or {}
    latest = next(reversed(said))
    for publisher, each in list(said.items()):
        after = max(components.stale_after, GAP_FACTOR * each.gap)
        after = inf if component.is_on_change else after
        at = max(each.at, components.arrays_since)
        is_seen = publisher in writers.names or latest not in writers.names
        is_gone = not is_seen and at + LOOK_TIME < writers.at
        if publisher != latest and (is_gone or now.mono - at > after):
            del said[publisher]
    counted = max(
        said.values(), key=lambda each: (severity(each.status, component), each.is_beyond, each.at)
    )
    if len(said) == 1:
        component.publisher, component.said = latest, None
    return counted.status


def severity(status: Status, component: Component | None) -> int:
    """By the rank of its state, in which ERROR, and what counts as it, is worse than STALE."""
    level = status.level if component is None else component.effective_level(status.level)
    return {0: 0, 1: 1, STALE: 2}.get(level, 3)
