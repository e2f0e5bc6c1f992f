"""The fleet as a discrete simulation: what each robot publishes when, on a clock of its own.

Free of ROS and of any real clock: time (seconds since the fleet's start) only moves when advance()
is called, so a story played twice is the same story, message by message.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from enum import Enum
from itertools import count
from pathlib import Path
from random import Random
from typing import NamedTuple

from virtual_robots.aggregator import Aggregator, Report
from virtual_robots.components import Fault
from virtual_robots.diagnostics import Status
from virtual_robots.kinds import build_components, load_analyzers, load_kind
from virtual_robots.robot import Robot

# A real aggregator's first array after its start is often from before any input: all headers, no
# components, all STALE. So it is here.
DRIVER_AFTER_AGGREGATOR = 0.35


class Topic(Enum):
    """The topics of a robot, below its namespace."""

    RAW = "diagnostics"
    AGGREGATED = "diagnostics_agg"
    TOPLEVEL = "diagnostics_toplevel_state"


class Message(NamedTuple):
    """Something published: ``at`` and ``stamp`` in seconds since the fleet's start.

    ``statuses`` has exactly one element on TOPLEVEL.
    """

    at: float
    robot: str
    topic: Topic
    statuses: tuple[Status, ...]
    stamp: float


class RobotSpec(NamedTuple):
    """A robot to be made: its name, which is also its namespace, and the file of its kind."""

    name: str
    kind: Path


class Due(NamedTuple):
    """What happens at a time; ``order`` keeps what falls on one instant in its order."""

    at: float
    order: int
    action: Callable[[float], Iterator[Message]]


@dataclass
class Member:
    """A robot in the fleet, with its aggregator (None: raw diagnostics only)."""

    spec: RobotSpec
    robot: Robot
    period: float
    aggregator: Aggregator | None


class Fleet:
    """Robots, their aggregators, and what is due next.

    ``seed`` decides everything random; ``version`` is the aggregator's, None for none.
    Raises DocumentError or AnalyzerConfigError for a kind that cannot be used.
    """

    def __init__(
        self, specs: list[RobotSpec], seed: int = 0, version: str | None = "4.2.7"
    ) -> None:
        self._seed = seed
        self._version = version
        self._order = count()
        self._due: list[Due] = []
        self.now = 0.0
        self.members = {spec.name: self._make(spec) for spec in specs}
        for member in self.members.values():
            self._start(member, Random(f"{seed}/{member.spec.name}/phase").random() * member.period)

    def advance(self, until: float) -> Iterator[Message]:
        """All that is published up to ``until``, in order of time."""
        while self._due and self._due[0].at <= until:
            due = heapq.heappop(self._due)
            self.now = due.at
            yield from due.action(due.at)
        self.now = until

    def next_at(self) -> float:
        """When the next thing is due (infinity: never)."""
        return self._due[0].at if self._due else float("inf")

    def member(self, robot: str) -> Member:
        """A robot by its name. Raises KeyError with a text."""
        if robot not in self.members:
            raise KeyError(f"there is no robot {robot!r}, only {_few(list(self.members))}")
        return self.members[robot]

    def inject(self, robot: str, component: str, fault: Fault | None) -> None:
        """Begin or end (None) a fault. Raises KeyError or UnknownFaultError with a text."""
        self.member(robot).robot.inject(component, fault)

    def _make(self, spec: RobotSpec) -> Member:
        kind = load_kind(spec.kind)
        robot = Robot(spec.name, build_components(kind, f"{self._seed}/{spec.name}"))
        aggregator = None
        if self._version is not None:
            aggregator = Aggregator(load_analyzers(spec.kind), self.now, self._version)
        return Member(spec, robot, kind.period, aggregator)

    def _start(self, member: Member, at: float) -> None:
        self._at(at, lambda now: self._aggregate(member, now))
        self._at(at + DRIVER_AFTER_AGGREGATOR, lambda now: self._tick(member, now))

    def _at(self, at: float, action: Callable[[float], Iterator[Message]]) -> None:
        heapq.heappush(self._due, Due(at, next(self._order), action))

    def _tick(self, member: Member, now: float) -> Iterator[Message]:
        robot = member.robot
        statuses = robot.tick(now)
        yield Message(now, robot.name, Topic.RAW, statuses, now + robot.clock_offset)
        if member.aggregator is not None:
            report = member.aggregator.receive(statuses, now)
            yield from _published(member, report, now)
        self._at(now + member.period, lambda then: self._tick(member, then))

    def _aggregate(self, member: Member, now: float) -> Iterator[Message]:
        if member.aggregator is not None:
            yield from _published(member, member.aggregator.publish(now), now)
            period = member.aggregator.period
            self._at(now + period, lambda then: self._aggregate(member, then))


def _published(member: Member, report: Report | None, now: float) -> Iterator[Message]:
    if report is None:
        return
    robot = member.robot
    stamp = now + robot.clock_offset
    yield Message(now, robot.name, Topic.AGGREGATED, report.statuses, stamp)
    yield Message(now, robot.name, Topic.TOPLEVEL, (report.toplevel,), stamp)


def _few(names: list[str], most: int = 10) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
