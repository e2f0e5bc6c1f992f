"""The door of the state: every robot of the fleet, guarded by a lock.

Told: arrays, what the graph shows, that time passes, a new config. Asked: which topics are
wanted, what each robot is like. All methods may be called from any thread.
"""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Mapping

from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.model import Array, Instant, Level
from ros_diagnostics_exporter.state.component import Component
from ros_diagnostics_exporter.state.fault_reports import FaultReports
from ros_diagnostics_exporter.state.maintenance import in_maintenance
from ros_diagnostics_exporter.state.network import Endpoint, Topic
from ros_diagnostics_exporter.state.persisted import RememberedRobot
from ros_diagnostics_exporter.state.registry import Roster, takes
from ros_diagnostics_exporter.state.robot import Robot
from ros_diagnostics_exporter.state.shared import Splitter
from ros_diagnostics_exporter.state.trimming import trimmed

__all__ = ["State", "Topic"]

log = logging.getLogger(__name__)

AUTO_WAIT = 5.0  # seconds that a raw array waits for an aggregate before raw is the source
SLOW_TICK = 1.0  # seconds between two looks at what changes slowly: maintenance, forgetting


class State:
    """All that is known about the fleet."""

    def __init__(self, fleet: config.Fleet, now: Instant, record: Callable[[Event], None]) -> None:
        self.lock = threading.RLock()
        self.fleet = fleet
        self._record = record
        self._now = now  # the latest that was told, for events of the roster
        self._slow_tick_at = now.mono
        self.faults = FaultReports(now)  # call it only under ``lock``
        self._roster = Roster(fleet, now, self._level_changed, self._note)

    # -- told --------------------------------------------------------------------------------

    def receive(self, topic: Topic, array: Array, now: Instant) -> None:
        """Take in an array that arrived on a wanted topic."""
        whole, array = array, trimmed(array)  # without the lock: it looks at every text
        with self.lock:
            self._now = now
            if array is not whole:
                self._roster.refuse_long(topic)
            splitter = self._roster.splitters.get(topic)
            if splitter is not None:
                self._receive_shared(topic, splitter, array, now)
                return
            for robot, raw in self._roster.bindings.get(topic, ()):
                if self._is_source(robot, now, raw=raw):
                    self._hand(robot, array, now, raw=raw)

    def _hand(self, robot: Robot, array: Array, now: Instant, *, raw: bool) -> None:
        if not robot.up:
            self._note("heard", robot)
            self._roster.received(robot)
        robot.receive(array, now, raw=raw)
        self.faults.update(robot, now)

    def _receive_shared(self, topic: Topic, splitter: Splitter, array: Array, now: Instant) -> None:
        parts, unknown = splitter.split(array.statuses)
        if unknown:
            self._roster.refusals.unknown(topic, unknown)
        for name, statuses in parts.items():
            robot = self._roster.on_shared_topic(topic, name, now)
            if robot is not None:
                size = array.size * len(statuses) // max(1, len(array.statuses))
                part = Array(array.stamp, tuple(statuses), size)
                self._hand(robot, part, now, raw=splitter.settings.raw)

    def undecodable(self, topic: Topic, now: Instant, error: str) -> None:
        """Count a message on a wanted topic that could not be decoded."""
        with self.lock:
            for robot, _raw in self._roster.bindings.get(topic, ()):
                robot.reject("undecodable")
                robot.undecodable = True
                log.debug("robot %s: undecodable at %f: %s", robot.settings.name, now.wall, error)

    def dropped(self, topic: Topic, count: int) -> None:
        """Count messages on a wanted topic that were dropped: more came than are decoded."""
        with self.lock:
            if topic in self._roster.splitters:  # whose they were, nobody has read
                self._roster.refusals.rejected["rate"] += count
                return
            for robot, _raw in self._roster.bindings.get(topic, ()):
                robot.rejected["rate"] += count
                robot.versions.receipt += 1

    def graph(self, domain_id: int, endpoints: Mapping[str, Endpoint], now: Instant) -> None:
        """Take in what one domain's graph shows: robots appear, publishers come and go."""
        with self.lock:
            self._now = now
            self._roster.discover(domain_id, endpoints, now)
            for topic, bound in self._roster.bindings.items():
                if topic.domain_id == domain_id:
                    for robot, _raw in bound:
                        robot.see(topic.name, endpoints.get(topic.name), now)

    def domain_joined(self, domain_id: int, *, joined: bool) -> None:
        """Note whether a domain could be joined."""
        with self.lock:
            for robot in self._roster.robots.values():
                if robot.settings.domain_id == domain_id and robot.network.domain_up != joined:
                    robot.network.domain_up = joined
                    robot.versions.receipt += 1

    def tick(self, now: Instant) -> None:
        """Let time pass for every robot; to be called a few times a second."""
        slow = now.mono - self._slow_tick_at >= SLOW_TICK
        if slow:
            self._slow_tick_at = now.mono
        for robot in self.each():
            with self.lock:
                self._now = now
                if robot.tick(now):
                    self._note("silent", robot)
                known = self._roster.robots.get(robot.settings.name) is robot
                if slow and known:
                    self._plan(robot, now)
                    known = not self._forget_gone(robot, now)
                if known:
                    self.faults.update(robot, now)
        with self.lock:
            self._judge(now, slow=slow)

    def _judge(self, now: Instant, *, slow: bool) -> None:
        if slow:
            self.faults.plan(now)
            self.faults.take_rows(now)  # what is to be written grows until it is taken
        self.faults.advance(now)

    def _plan(self, robot: Robot, now: Instant) -> None:
        labels = {
            **robot.settings.labels,
            "fleet": self.fleet.name,
            "robot": robot.settings.name,
        }
        planned = in_maintenance(self.fleet, labels, now.wall)
        if planned != robot.maintenance:
            robot.maintenance = planned
            robot.versions.inventory += 1

    def _forget_gone(self, robot: Robot, now: Instant) -> bool:
        """Forget what is long gone and has no problem; whether the robot went."""
        for component in list(robot.members.forgettable(now)):
            if self.faults.keeps(robot, component):
                continue
            self._note_component(now, robot, component, component.level, "forgotten")
            robot.members.remove(component)
        if robot.is_forgettable(now) and not self.faults.keeps(robot):
            self._roster.drop(robot)
            return True
        return False

    def configure(self, fleet: config.Fleet, now: Instant) -> None:
        """Follow another config; robots that it leaves unchanged lose nothing."""
        with self.lock:
            self._now = now
            self.fleet = fleet
            self._roster.configure(fleet, now)
            self.faults.configure(now)
            self._slow_tick_at = float("-inf")

    def forget(self, name: str, component: str | None, now: Instant) -> int:
        """Forget a component by its name, or a robot with all of them; how many went.

        Raises:
            LookupError: there is no such robot, or it has no such component.
        """
        with self.lock:
            self._now = now
            robot = self._roster.robots.get(name)
            if robot is None:
                raise LookupError(f"no robot {name!r}")
            doomed = [
                each
                for each in robot.components.values()
                if component is None or each.name == component
            ]
            if component is not None and not doomed:
                raise LookupError(f"robot {name!r} has no component {component!r}")
            for each in doomed:
                self._note_component(now, robot, each, each.level, "forgotten")
                robot.members.remove(each)
            if component is None and not robot.declared:
                self._roster.drop(robot)
            else:
                self.faults.update(robot, now)
            return len(doomed)

    def restore(self, known: Mapping[str, RememberedRobot], now: Instant) -> None:
        """Put back what a former process knew of the robots that the config still wants."""
        with self.lock:
            self._now = now
            for name, remembered in known.items():
                robot = self._roster.find_again(name, remembered, now)
                if robot is not None:
                    robot.restore(remembered, now)

    # -- asked -------------------------------------------------------------------------------

    @property
    def robots(self) -> Mapping[str, Robot]:
        """The robots by name; read one only under ``lock``."""
        return self._roster.robots

    @property
    def rejected(self) -> Mapping[str, int]:
        """What belongs to no robot and was not taken in, by reason."""
        return self._roster.refusals.rejected

    @property
    def shut_out(self) -> list[str]:
        """The robots that are not known because the limits leave no room, by name."""
        with self.lock:
            return sorted(self._roster.refusals.shut_out)

    def wanted(self, domain_id: int) -> list[Topic]:
        """The topics to be subscribed in a domain, now."""
        with self.lock:
            return list(self._roster.wanted(domain_id))

    def each(self) -> Iterator[Robot]:
        """Every robot in the order of names; read one only under ``lock``."""
        with self.lock:
            robots = sorted(self._roster.robots.items())
        return (robot for _name, robot in robots)

    def _is_source(self, robot: Robot, now: Instant, *, raw: bool) -> bool:
        """Whether arrays of this kind are taken in; ``auto`` is decided here, once."""
        if robot.source is not config.Source.AUTO:
            return takes(robot.source, raw=raw)
        if not raw:
            robot.source = config.Source.AGG
            return True
        if robot.first_raw is None:
            robot.first_raw = now.mono
        if now.mono - robot.first_raw < AUTO_WAIT:
            return False
        robot.source = config.Source.RAW
        return True

    # -- events ------------------------------------------------------------------------------

    def _level_changed(self, robot: Robot, component: Component, before: int, now: Instant) -> None:
        if before >= 0:
            self._note_component(now, robot, component, before)

    def _note(self, word: str, robot: Robot) -> None:
        if word == "known":  # no scrape may see it out of a downtime that holds
            self._plan(robot, self._now)
            self.faults.add(robot, self._now)
        elif word == "forgotten":
            self.faults.remove(robot, self._now)
        self._record(Event(self._now.wall, "robot", robot.settings.name, after=word))

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
