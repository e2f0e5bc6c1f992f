"""The fleet as a discrete simulation: what each robot publishes when, on a clock of its own.

No ROS and no real clock: time (seconds since the fleet's start) only advances when advance() is
called, so the same scenario with the same seed gives the same messages.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from pathlib import Path
from random import Random
from typing import NamedTuple

from virtual_robots.aggregator import VERSIONS, Aggregator, Report
from virtual_robots.schema.thesis import COUNTS, ThesisSettings, draw, load_settings, with_settings
from virtual_robots.simulation.components import Fault
from virtual_robots.simulation.driver import Driver
from virtual_robots.simulation.kinds import (
    build_actions,
    build_components,
    load_analyzers,
    load_kind,
)
from virtual_robots.simulation.outputs import (
    FieldMessage,
    GoalStep,
    Message,
    Output,
    Presence,
    Topic,
)
from virtual_robots.simulation.robots import RobotSpec, State, VirtualRobot

# A real aggregator's first array after its start is often from before any input: all headers, no
# components, all STALE. So it is here.
DRIVER_AFTER_AGGREGATOR = 0.35

Callback = Callable[[float], Iterator[Output]]


class Scheduled(NamedTuple):
    """A call at a time; ``number`` keeps calls of one instant in the order of their scheduling."""

    at: float
    number: int
    callback: Callback


class Fleet:
    """Robots, their aggregators, and the queue of what happens next.

    ``seed`` determines everything random; ``version`` is the aggregator's, None for none;
    ``warnings`` lists the analyzers of the kinds that the real aggregator would reject.
    Raises DocumentError or AnalyzerConfigError for a kind that cannot be used.
    """

    def __init__(
        self, specs: Sequence[RobotSpec], seed: int = 0, version: str | None = VERSIONS[0]
    ) -> None:
        self._seed = seed
        self._version = version
        self._numbers = count()
        self._queue: list[Scheduled] = []
        self.warnings = _warnings({spec.kind for spec in specs}, version)
        self.now = 0.0
        self.robots = {spec.name: self._create(spec) for spec in specs}
        for robot in self.robots.values():
            if not robot.spec.absent:
                robot.present = True
                self._switch_on(robot, robot.rng.random() * robot.period)

    def advance(self, until: float) -> Iterator[Output]:
        """Run everything scheduled up to ``until``; yield its outputs in order of time."""
        while self._queue and self._queue[0].at <= until:
            due = heapq.heappop(self._queue)
            self.now = due.at
            yield from due.callback(due.at)
        self.now = max(self.now, until)

    def next_at(self) -> float:
        """Return the time of the next scheduled call (infinity: there is none)."""
        return self._queue[0].at if self._queue else float("inf")

    def schedule(self, at: float, callback: Callback) -> None:
        """Call ``callback`` with the time when it is ``at``."""
        heapq.heappush(self._queue, Scheduled(at, next(self._numbers), callback))

    def robot(self, name: str) -> VirtualRobot:
        """Return a robot. Raises KeyError with a text."""
        if name not in self.robots:
            raise KeyError(f"there is no robot {name!r}, only {_few(list(self.robots))}")
        return self.robots[name]

    def inject(self, robot: str, component: str, fault: Fault | None) -> None:
        """Begin or end (None) a fault. Raises KeyError or UnknownFaultError with a text."""
        found = self.robot(robot)
        found.driver.inject(component, fault)
        found.drawn -= {component}

    def start(self, robot: VirtualRobot, at: float) -> None:
        """Boot the robot at a time: driver and aggregator start anew.

        Nothing happens if it runs by then, or was stopped (again) before.
        """
        generation = robot.generation
        self.schedule(at, lambda now: self._boot(robot, generation, now))

    def resume(self, robot: VirtualRobot, now: float) -> None:
        """Resume a paused robot with its state unchanged."""
        robot.state = State.RUNNING
        generation = robot.generation
        self.schedule(now, lambda then: self._aggregate(robot, generation, then))
        self.schedule(
            now + DRIVER_AFTER_AGGREGATOR, lambda then: self._tick(robot, generation, then)
        )

    def stop(self, robot: VirtualRobot, state: State) -> None:
        """Stop publishing, PAUSED or OFF; the robot stays in the graph."""
        robot.state = state
        robot.generation += 1

    def reload(self, settings: Path) -> None:
        """Read a settings file again, for all robots that have it. Raises DocumentError."""
        latest = load_settings(settings)
        for robot in self.robots.values():
            if robot.spec.settings == settings:
                self._apply_settings(robot, latest)

    def _create(self, spec: RobotSpec) -> VirtualRobot:
        kind = load_kind(spec.kind)
        seed = f"{self._seed}/{spec.name}"
        driver = Driver(spec.name, [], build_actions(kind, seed))
        robot = VirtualRobot(spec, driver, kind.period, Random(seed))
        self._apply_settings(robot, load_settings(spec.settings) if spec.settings else None)
        return robot

    def _apply_settings(self, robot: VirtualRobot, settings: ThesisSettings | None) -> None:
        """Give the robot the components of its settings; existing ones keep their state."""
        kind = load_kind(robot.spec.kind)
        robot.settings = settings
        if settings is not None:
            kind = with_settings(kind, settings)
            self.schedule(self.now, lambda now: self._refresh(robot, settings, now))
        components = build_components(kind, f"{self._seed}/{robot.spec.name}")
        robot.driver.replace_components(components)

    def _boot(self, robot: VirtualRobot, generation: int, now: float) -> Iterator[Output]:
        if robot.state is State.RUNNING or robot.generation != generation:
            return
        self._switch_on(robot, now)
        yield from appear(robot, now)

    def _switch_on(self, robot: VirtualRobot, at: float) -> None:
        """Start driver and aggregator; the first message comes soon after ``at``."""
        robot.driver.boot()
        if self._version is not None and robot.driver.has_diagnostics:
            robot.aggregator = Aggregator(load_analyzers(robot.spec.kind), at, self._version)
        self.resume(robot, at)

    def _refresh(
        self, robot: VirtualRobot, settings: ThesisSettings, now: float
    ) -> Iterator[Output]:
        if robot.settings is not settings:
            return
        components = [c for c in robot.driver.components if c.model.name in COUNTS]
        levels = draw(settings, robot.rng, [component.name for component in components])
        for component in components:
            if component.name in levels:
                component.inject(Fault(levels[component.name], now))
            elif component.name in robot.drawn:
                component.inject(None)
        robot.drawn = frozenset(levels)
        self.schedule(
            now + settings.refresh_interval, lambda then: self._refresh(robot, settings, then)
        )
        yield from ()

    def _tick(self, robot: VirtualRobot, generation: int, now: float) -> Iterator[Output]:
        if generation != robot.generation:
            return
        driver = robot.driver
        statuses = driver.tick(now)
        if robot.online and driver.has_diagnostics:
            yield Message(now, driver.name, Topic.RAW, statuses, now + driver.clock_offset)
        if robot.online:
            for topic, fields in driver.messages():
                yield FieldMessage(now, driver.name, topic, fields)
        else:
            driver.publish_again()
        for action, step in driver.goal_steps(now, reached=robot.online):
            yield GoalStep(now, driver.name, action, step)
        if robot.aggregator is not None:
            yield from _published(robot, robot.aggregator.receive(statuses, now), now)
        self.schedule(now + robot.period, lambda then: self._tick(robot, generation, then))

    def _aggregate(self, robot: VirtualRobot, generation: int, now: float) -> Iterator[Output]:
        if generation != robot.generation or robot.aggregator is None:
            return
        yield from _published(robot, robot.aggregator.publish(now), now)
        period = robot.aggregator.period
        self.schedule(now + period, lambda then: self._aggregate(robot, generation, then))


def appear(robot: VirtualRobot, now: float) -> Iterator[Output]:
    """Add the robot to the graph if it is on, has a network and is not there yet."""
    if robot.state is not State.OFF and robot.online and not robot.present:
        robot.present = True
        yield Presence(now, robot.spec.name, present=True)


def _warnings(kinds: set[Path], version: str | None) -> list[str]:
    """Return what is wrong with the analyzers, once for each kind, not at each robot's boot."""
    if version is None:
        return []
    return [
        text
        for kind in sorted(kinds)
        if load_kind(kind).has_diagnostics
        for text in Aggregator(load_analyzers(kind), 0.0, version).warnings
    ]


def _published(robot: VirtualRobot, report: Report | None, now: float) -> Iterator[Output]:
    if report is None or not robot.online:
        return
    driver = robot.driver
    stamp = now + driver.clock_offset
    yield Message(now, driver.name, Topic.AGGREGATED, report.statuses, stamp)
    yield Message(now, driver.name, Topic.TOPLEVEL, (report.toplevel,), stamp)


def _few(names: list[str], most: int = 10) -> str:
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
