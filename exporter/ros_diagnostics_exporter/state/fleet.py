"""The door of the state: every robot of the fleet, found by domain and topic, guarded by a lock.

Told: arrays, what the graph shows, that time passes, a new config. Asked: which topics are
wanted, what each robot is like. All methods may be called from any thread.
"""

from __future__ import annotations

import logging
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.config.windows import in_maintenance
from ros_diagnostics_exporter.diagnostics import Array, Instant, Level
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.state.bounds import Budget
from ros_diagnostics_exporter.state.component import Component
from ros_diagnostics_exporter.state.discovery import found_robot, robot_name
from ros_diagnostics_exporter.state.network import Endpoint
from ros_diagnostics_exporter.state.remembered import RememberedRobot
from ros_diagnostics_exporter.state.robot import Robot

log = logging.getLogger(__name__)

MOST_CONFLICTS = 1_000
AUTO_WAIT = 5.0  # seconds that a raw array waits for an aggregate before raw is the source


class Topic(NamedTuple):
    """A topic of one DDS domain."""

    domain_id: int
    name: str


class State:
    """All that is known about the fleet."""

    def __init__(self, fleet: config.Fleet, now: Instant, record: Callable[[Event], None]) -> None:
        self.lock = threading.RLock()
        self.fleet = fleet
        self.robots: dict[str, Robot] = {}
        self.rejected: Counter[str] = Counter()
        self._record = record
        self.budget = Budget(fleet.limits.series)
        self._conflicts: set[Topic] = set()
        self._bindings: dict[Topic, list[tuple[Robot, bool]]] = {}
        for settings in fleet.robots:
            self._add(settings, now, declared=True)

    # -- told --------------------------------------------------------------------------------

    def receive(self, topic: Topic, array: Array, now: Instant) -> None:
        """Take in an array that arrived on a wanted topic."""
        with self.lock:
            for robot, raw in self._bindings.get(topic, ()):
                if not self._is_source(robot, now, raw=raw):
                    continue
                if not robot.up:
                    self._note(now, robot, "heard")
                robot.receive(array, now, raw=raw)

    def undecodable(self, topic: Topic, now: Instant, error: str) -> None:
        """Count a message on a wanted topic that could not be decoded."""
        with self.lock:
            for robot, _raw in self._bindings.get(topic, ()):
                robot.reject("undecodable")
                robot.undecodable = True
                log.debug("robot %s: undecodable at %f: %s", robot.settings.name, now.wall, error)

    def graph(self, domain_id: int, endpoints: Mapping[str, Endpoint], now: Instant) -> None:
        """Take in what one domain's graph shows: robots appear, publishers come and go."""
        with self.lock:
            for discovery in self.fleet.discoveries:
                self._discover(discovery, domain_id, endpoints, now)
            for topic, bound in self._bindings.items():
                if topic.domain_id == domain_id:
                    for robot, _raw in bound:
                        if robot.network.see(topic.name, endpoints.get(topic.name)):
                            robot.versions.receipt += 1

    def domain_failed(self, domain_id: int) -> None:
        """Note that a domain could not be joined."""
        with self.lock:
            for robot in self.robots.values():
                if robot.settings.domain_id == domain_id:
                    robot.network.domain_up = False
                    robot.versions.receipt += 1

    def tick(self, now: Instant) -> None:
        """Let time pass for every robot; to be called about twice a second."""
        for robot in self.each():
            with self.lock:
                if robot.tick(now):
                    self._note(now, robot, "silent")
                labels = {"fleet": self.fleet.name, "robot": robot.settings.name}
                planned = in_maintenance(self.fleet, {**robot.settings.labels, **labels}, now.wall)
                if planned != robot.maintenance:
                    robot.maintenance = planned
                    robot.versions.inventory += 1
                for identity in list(robot.forgettable(now)):
                    component = robot.components[identity]
                    self._note_component(now, robot, component, component.level, "forgotten")
                    robot.forget(identity)
                if not robot.declared and self._is_gone(robot, now):
                    self._drop(robot, now)

    def forget(self, name: str, component: str | None, now: Instant) -> int:
        """Forget a component by its name, or a robot with all of them; how many went."""
        with self.lock:
            robot = self.robots.get(name)
            if robot is None:
                return 0
            doomed = [
                (identity, each)
                for identity, each in robot.components.items()
                if component is None or each.name == component
            ]
            for identity, each in doomed:
                self._note_component(now, robot, each, each.level, "forgotten")
                robot.forget(identity)
            if component is None and not robot.declared:
                self._drop(robot, now)
                return len(doomed) + 1
            return len(doomed)

    def restore(self, known: Mapping[str, RememberedRobot], now: Instant) -> None:
        """Put back what a former process knew of the robots that the config still wants."""
        with self.lock:
            for name, remembered in known.items():
                robot = self.robots.get(name)
                if robot is None:
                    robot = self._find_again(name, remembered, now)
                if robot is not None:
                    robot.restore(remembered, now)

    def _find_again(self, name: str, known: RememberedRobot, now: Instant) -> Robot | None:
        for discovery in self.fleet.discoveries:
            if robot_name(discovery, known.topic, known.domain_id) == name:
                found = found_robot(discovery, name, known.topic, known.domain_id)
                return self._add(found, now, declared=False)
        return None

    # -- asked -------------------------------------------------------------------------------

    def wanted(self, domain_id: int) -> list[Topic]:
        """The topics to be subscribed in a domain, now."""
        with self.lock:
            return [
                topic
                for topic, bound in self._bindings.items()
                if topic.domain_id == domain_id
                and any(_takes(robot.source, raw=raw) for robot, raw in bound)
            ]

    def each(self) -> Iterator[Robot]:
        """Every robot in the order of names; read one only under ``lock``."""
        with self.lock:
            robots = sorted(self.robots.items())
        return (robot for _name, robot in robots)

    # -- robots ------------------------------------------------------------------------------

    def _add(self, settings: config.Robot, now: Instant, *, declared: bool) -> Robot | None:
        if len(self.robots) >= self.fleet.limits.robots:
            self.rejected["robot_limit"] += 1
            return None
        robot = Robot(
            settings, self.fleet.limits, self.budget, self._level_changed, declared=declared
        )
        self.robots[settings.name] = robot
        self._bind(robot)
        self._note(now, robot, "known")
        return robot

    def _bind(self, robot: Robot) -> None:
        settings = robot.settings
        for topic, raw in ((settings.topic_agg, False), (settings.topic_raw, True)):
            if topic is not None and _takes(settings.source, raw=raw):
                bound = self._bindings.setdefault(Topic(settings.domain_id, topic), [])
                bound.append((robot, raw))

    def _unbind(self, robot: Robot) -> None:
        for topic, bound in list(self._bindings.items()):
            bound[:] = [entry for entry in bound if entry[0] is not robot]
            if not bound:
                del self._bindings[topic]

    def _drop(self, robot: Robot, now: Instant) -> None:
        self._note(now, robot, "forgotten")
        self._unbind(robot)
        robot.release()
        del self.robots[robot.settings.name]

    def _is_gone(self, robot: Robot, now: Instant) -> bool:
        if robot.up or robot.components or robot.network.publishers:
            return False
        last = robot.last_mono
        return last is not None and now.mono - last > robot.settings.profile.forget_after

    def _is_source(self, robot: Robot, now: Instant, *, raw: bool) -> bool:
        """Whether arrays of this kind are taken in; ``auto`` is decided here, once."""
        if robot.source is not config.Source.AUTO:
            return _takes(robot.source, raw=raw)
        if not raw:
            robot.source = config.Source.AGG
            return True
        if robot.first_raw is None:
            robot.first_raw = now.mono
        if now.mono - robot.first_raw < AUTO_WAIT:
            return False
        robot.source = config.Source.RAW
        return True

    def _discover(
        self,
        discovery: config.Discovery,
        domain_id: int,
        endpoints: Mapping[str, Endpoint],
        now: Instant,
    ) -> None:
        for topic, endpoint in endpoints.items():
            if endpoint.publishers == 0 or Topic(domain_id, topic) in self._bindings:
                continue
            name = robot_name(discovery, topic, domain_id)
            if name is None:
                continue
            if name in self.robots:
                self._conflict(name, domain_id, topic)
            else:
                found = found_robot(discovery, name, topic, domain_id)
                self._add(found, now, declared=False)

    def _conflict(self, name: str, domain_id: int, topic: str) -> None:
        """Say once that a second robot claims a name that is taken."""
        claim = Topic(domain_id, topic)
        if claim in self._conflicts or len(self._conflicts) >= MOST_CONFLICTS:
            return
        self._conflicts.add(claim)
        self.rejected["duplicate_robot"] += 1
        log.warning(
            "topic %s in domain %d would be robot %r, but that name is taken; give it another "
            "name in fleet.yml, or exclude it from discovery",
            topic,
            domain_id,
            name,
        )

    # -- events ------------------------------------------------------------------------------

    def _level_changed(self, robot: Robot, component: Component, before: int, now: Instant) -> None:
        if before >= 0:
            self._note_component(now, robot, component, before)

    def _note(self, now: Instant, robot: Robot, word: str) -> None:
        self._record(Event(now.wall, "robot", robot.settings.name, after=word))

    def _note_component(
        self, now: Instant, robot: Robot, component: Component, before: int, word: str = ""
    ) -> None:
        self._record(
            Event(
                time=now.wall,
                kind="level",
                robot=robot.settings.name,
                group=component.group,
                component=component.name,
                before=Level(before).name,
                after=word or Level(component.level).name,
                message=component.message,
            )
        )


def _takes(source: config.Source, *, raw: bool) -> bool:
    return source is not (config.Source.AGG if raw else config.Source.RAW)
