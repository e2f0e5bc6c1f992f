"""The fleet as a discrete simulation: what each robot publishes when, on a clock of its own.

Free of ROS and of any real clock: time (seconds since the fleet's start) only moves when advance()
is called, so a story played twice is the same story, message by message.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from pathlib import Path
from random import Random
from typing import NamedTuple

from virtual_robots.aggregator import VERSIONS, Aggregator, Report
from virtual_robots.schema.thesis import COUNTS, ThesisSettings, draw, load_settings, shaped
from virtual_robots.simulation.components import Fault
from virtual_robots.simulation.kinds import build_components, load_analyzers, load_kind
from virtual_robots.simulation.members import (
    Happening,
    Member,
    Message,
    Presence,
    RobotSpec,
    State,
    Topic,
)
from virtual_robots.simulation.robot import Robot

# A real aggregator's first array after its start is often from before any input: all headers, no
# components, all STALE. So it is here.
DRIVER_AFTER_AGGREGATOR = 0.35

Action = Callable[[float], Iterator[Happening]]


class Due(NamedTuple):
    """What happens at a time; ``order`` keeps what falls on one instant in its order."""

    at: float
    order: int
    action: Action


class Fleet:
    """Robots, their aggregators, and what is due next.

    ``seed`` decides everything random; ``version`` is the aggregator's, None for none;
    ``complaints`` tells what the real one would refuse of the kinds' analyzers.
    Raises DocumentError or AnalyzerConfigError for a kind that cannot be used.
    """

    def __init__(
        self, specs: Sequence[RobotSpec], seed: int = 0, version: str | None = VERSIONS[0]
    ) -> None:
        self._seed = seed
        self._version = version
        self._order = count()
        self._due: list[Due] = []
        self.complaints = _complaints({spec.kind for spec in specs}, version)
        self.now = 0.0
        self.members = {spec.name: self._make(spec) for spec in specs}
        for member in self.members.values():
            if not member.spec.absent:
                member.present = True
                self._switch_on(member, member.rng.random() * member.period)

    def advance(self, until: float) -> Iterator[Happening]:
        """All that happens up to ``until``, in order of time."""
        while self._due and self._due[0].at <= until:
            due = heapq.heappop(self._due)
            self.now = due.at
            yield from due.action(due.at)
        self.now = max(self.now, until)

    def next_at(self) -> float:
        """When the next thing is due (infinity: never)."""
        return self._due[0].at if self._due else float("inf")

    def plan(self, at: float, action: Action) -> None:
        """Let ``action`` happen at a time; it is called with that time."""
        heapq.heappush(self._due, Due(at, next(self._order), action))

    def member(self, robot: str) -> Member:
        """A robot by its name. Raises KeyError with a text."""
        if robot not in self.members:
            raise KeyError(f"there is no robot {robot!r}, only {_few(list(self.members))}")
        return self.members[robot]

    def inject(self, robot: str, component: str, fault: Fault | None) -> None:
        """Begin or end (None) a fault. Raises KeyError or UnknownFaultError with a text."""
        member = self.member(robot)
        member.robot.inject(component, fault)
        member.drawn -= {component}

    def start(self, member: Member, at: float) -> None:
        """Boot the robot at a time: driver and aggregator begin anew.

        Nothing happens if it runs by then, or was stopped (again) before.
        """
        life = member.life
        self.plan(at, lambda now: self._boot(member, life, now))

    def resume(self, member: Member, now: float) -> None:
        """Let a robot that was paused go on as if nothing had been."""
        member.state = State.RUNNING
        life = member.life
        self.plan(now, lambda then: self._aggregate(member, life, then))
        self.plan(now + DRIVER_AFTER_AGGREGATOR, lambda then: self._tick(member, life, then))

    def stop(self, member: Member, state: State) -> None:
        """Let nothing more come from the robot, PAUSED or OFF; the graph still knows it."""
        member.state = state
        member.life += 1

    def reload(self, settings: Path) -> None:
        """Read a settings file again, for all robots that have it. Raises DocumentError."""
        latest = load_settings(settings)
        for member in self.members.values():
            if member.spec.settings == settings:
                self._reshape(member, latest)

    def _make(self, spec: RobotSpec) -> Member:
        kind = load_kind(spec.kind)
        robot = Robot(spec.name, [])
        member = Member(spec, robot, kind.period, Random(f"{self._seed}/{spec.name}"))
        self._reshape(member, load_settings(spec.settings) if spec.settings else None)
        return member

    def _reshape(self, member: Member, settings: ThesisSettings | None) -> None:
        """Give the robot the components of its settings; those that it had go on."""
        kind = load_kind(member.spec.kind)
        member.settings = settings
        if settings is not None:
            kind = shaped(kind, settings)
            self.plan(self.now, lambda now: self._refresh(member, settings, now))
        components = build_components(kind, f"{self._seed}/{member.spec.name}")
        member.robot.replace_components(components)

    def _boot(self, member: Member, life: int, now: float) -> Iterator[Happening]:
        if member.state is State.RUNNING or member.life != life:
            return
        self._switch_on(member, now)
        yield from appear(member, now)

    def _switch_on(self, member: Member, at: float) -> None:
        """Begin the robot's life anew; its first message comes soon after ``at``."""
        member.robot.boot()
        if self._version is not None:
            member.aggregator = Aggregator(load_analyzers(member.spec.kind), at, self._version)
        self.resume(member, at)

    def _refresh(self, member: Member, settings: ThesisSettings, now: float) -> Iterator[Happening]:
        if member.settings is not settings:
            return
        components = [c for c in member.robot.components if c.model.name in COUNTS]
        levels = draw(settings, member.rng, [component.name for component in components])
        for component in components:
            if component.name in levels:
                component.inject(Fault(levels[component.name], now))
            elif component.name in member.drawn:
                component.inject(None)
        member.drawn = frozenset(levels)
        self.plan(
            now + settings.refresh_interval, lambda then: self._refresh(member, settings, then)
        )
        yield from ()

    def _tick(self, member: Member, life: int, now: float) -> Iterator[Happening]:
        if life != member.life:
            return
        robot = member.robot
        statuses = robot.tick(now)
        if member.online:
            yield Message(now, robot.name, Topic.RAW, statuses, now + robot.clock_offset)
        if member.aggregator is not None:
            yield from _published(member, member.aggregator.receive(statuses, now), now)
        self.plan(now + member.period, lambda then: self._tick(member, life, then))

    def _aggregate(self, member: Member, life: int, now: float) -> Iterator[Happening]:
        if life != member.life or member.aggregator is None:
            return
        yield from _published(member, member.aggregator.publish(now), now)
        period = member.aggregator.period
        self.plan(now + period, lambda then: self._aggregate(member, life, then))


def appear(member: Member, now: float) -> Iterator[Happening]:
    """Let the graph see the robot if there is one to be seen: on, and with a network."""
    if member.state is not State.OFF and member.online and not member.present:
        member.present = True
        yield Presence(now, member.spec.name, present=True)


def _complaints(kinds: set[Path], version: str | None) -> list[str]:
    """What is wrong with the analyzers, said at the start and not at each robot's boot."""
    if version is None:
        return []
    return [
        text
        for kind in sorted(kinds)
        for text in Aggregator(load_analyzers(kind), 0.0, version).complaints
    ]


def _published(member: Member, report: Report | None, now: float) -> Iterator[Happening]:
    if report is None or not member.online:
        return
    robot = member.robot
    stamp = now + robot.clock_offset
    yield Message(now, robot.name, Topic.AGGREGATED, report.statuses, stamp)
    yield Message(now, robot.name, Topic.TOPLEVEL, (report.toplevel,), stamp)


def _few(names: list[str], most: int = 10) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
