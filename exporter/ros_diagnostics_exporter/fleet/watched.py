"""The robots of a fleet behind one lock, and what the ROS graph shows of them."""

from __future__ import annotations

import logging
import re
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence

from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.decode.goals import decode_goals
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.faults.model import MISSIONS, Fault, Row, Scope
from ros_diagnostics_exporter.fleet.discovery import end_of_topic
from ros_diagnostics_exporter.fleet.fault_reports import FaultReports
from ros_diagnostics_exporter.fleet.missions import FleetMissions
from ros_diagnostics_exporter.fleet.registry import RobotRegistry
from ros_diagnostics_exporter.loops import Timers
from ros_diagnostics_exporter.model import (
    Domain,
    Endpoint,
    Instant,
    Stream,
    Topic,
    Unclaimed,
    place,
)
from ros_diagnostics_exporter.robots.limits import truncate_statuses
from ros_diagnostics_exporter.robots.missions import ACTIONS
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.robots.updates import is_of_graph
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE
from ros_diagnostics_exporter.sources.graph import GraphWatch
from ros_diagnostics_exporter.sources.graph_messages import Message
from ros_diagnostics_exporter.sources.graph_topics import TopicView
from ros_diagnostics_exporter.sources.link import LinkReading, joined
from ros_diagnostics_exporter.sources.robot_graph import GROUP, Report
from ros_diagnostics_exporter.sources.topic_entries import asked_names

log = logging.getLogger(__name__)

MAX_EVENTS = 100_000  # between two calls of take_events; the oldest are dropped beyond


class WatchedFleet(ABC):
    """What `FleetState` takes from the ROS graph: domains, nodes, endpoints, links, other topics.

    What is seen there is kept under a lock of its own, which is taken before the fleet's, or alone.
    """

    def __init__(self, fleet: config.Fleet, now: Instant) -> None:
        self.fleet = fleet
        self._lock = threading.RLock()
        self._events: deque[Event] = deque(maxlen=MAX_EVENTS)
        self._ticks: Timers[RobotState] = Timers()  # when robots have to be looked at again
        self._watch = GraphWatch()
        if fleet.sources:
            self._watch.folder = fleet.sources[0].parent / "msg"
        self._watching = threading.Lock()  # of the watch
        self.recorder: Callable[[Stream, bytes, Instant], None] | None = None  # of messages
        self._faults = FaultReports(fleet, now, self._events)
        self._missions: FleetMissions | None = None  # until there is an action of any robot
        self._registry = RobotRegistry(fleet, now, self._events, self._faults)

    def wanted_topics(self, domain_id: Domain) -> dict[str, bool]:
        """The topics to be subscribed in a domain: name -> whether robots share it."""
        with self._lock:
            return dict(self._registry.wanted_topics(domain_id))

    @property
    def unclaimed(self) -> list[Unclaimed]:
        """The topics of diagnostics that no entry of fleet.yml takes."""
        with self._lock:
            return self._registry.unclaimed.entries

    def domain_joined(self, domain_id: Domain) -> None:
        """Note that a domain was joined."""
        self._set_domain_up(domain_id, up=True)

    def domain_failed(self, domain_id: Domain, error: str, now: Instant) -> None:
        """Note that a domain could not be joined."""
        self._set_domain_up(domain_id, up=False)
        with self._lock:
            self._registry.lose(domain_id)
            self._events.append(Event(now.wall, "config", message=f"{place(domain_id)}: {error}"))

    def domain_deaf(self, domain_id: Domain, topics: Iterable[str], why: str, now: Instant) -> None:
        """Note that this process receives nothing of some topics of a domain, though it should."""
        with self._lock:
            for name in topics:
                for robot, _raw in self._registry.bindings.get(Topic(domain_id, name), ()):
                    robot.network.domain_up = False
            self._events.append(Event(now.wall, "config", message=f"{place(domain_id)}: {why}"))

    def received_since(self, domain_id: Domain, mono: float) -> list[bool]:
        """Of each robot of a domain that was received since then whether it is up."""
        with self._lock:
            return [
                robot.up
                for robot in self._registry.robots.values()
                if robot.settings.domain_id == domain_id and (robot.last_mono or 0.0) > mono
            ]

    def reject_undecodable(self, topic: Topic, error: str, now: Instant) -> None:
        """Count a message on a wanted topic that could not be decoded."""
        with self._lock:
            for robot, _raw in self._registry.bindings.get(topic, ()):
                robot.reject_undecodable(now)
                log.debug("robot %s: undecodable at %f: %s", robot.settings.name, now.wall, error)

    def reject_dropped(self, topic: Topic, count: int) -> None:
        """Count messages on a wanted topic that were dropped because too many are published."""
        with self._lock:
            if topic in self._registry.shared_topics:  # undecoded, so nobody knows whose they were
                self._registry.rejections.counts["rate"] += count
                return
            for robot, _raw in self._registry.bindings.get(topic, ()):
                robot.count_rejected("rate", count)

    def silent_topics(self, domain_id: Domain) -> list[str]:
        """The topics of a domain of which no robot is up."""
        with self._lock:
            return [
                topic.name
                for topic, bound in self._registry.bindings.items()
                if topic.domain_id == domain_id and not any(robot.up for robot, _raw in bound)
            ]

    def gone_nodes(self, domain_id: Domain) -> list[str]:
        """The full names of the nodes of a domain of which it is a problem that they are gone."""
        with self._watching:
            return self._watch.gone_nodes(domain_id)

    def _set_domain_up(self, domain_id: Domain, *, up: bool) -> None:
        with self._lock:
            for robot in self._registry.robots.values():
                if robot.settings.domain_id == domain_id:
                    robot.network.domain_up = up

    def update_graph(
        self, domain_id: Domain, endpoints: Mapping[str, Endpoint], now: Instant
    ) -> None:
        """Discover robots in one domain's graph, and update which topics have publishers."""
        with self._lock:
            self._registry.discover(domain_id, endpoints, now)
            for topic, bound in self._registry.bindings.items():
                if topic.domain_id == domain_id:
                    for robot, _raw in bound:
                        robot.update_endpoint(topic.name, endpoints.get(topic.name), now)

    def finders(self, domain_id: Domain) -> list[re.Pattern[str]]:
        """The patterns of topics of a domain by which robots are found, whatever their types."""
        return [
            each.pattern
            for each in self.fleet.discoveries
            if each.source is config.Source.NONE and domain_id in each.domain_ids
        ]

    def note_other_types(
        self, domain_id: Domain, types: Mapping[str, tuple[str, ...]], now: Instant
    ) -> None:
        """Note the types of all topics of a domain that have no DiagnosticArray, by name."""
        with self._lock:
            self._registry.note_other_types(domain_id, types, now)

    def update_nodes(self, domain_id: Domain, nodes: list[tuple[str, str]], now: Instant) -> bool:
        """Take the name and namespace of all nodes of a domain, and judge what is due there.

        Returns whether any robot there is watched.
        """
        robots = self._watch_robots(domain_id, now)
        shown = [robot for robot in robots if robot.is_shown_by_nodes(now)]
        with self._watching:
            self._watch.see_nodes(domain_id, nodes, now)
            reports = list(self._watch.reports(domain_id, now))
            watches = self._watch.watches(domain_id)
            present = self._watch.present(domain_id) if shown else ()
        for robot in shown:
            if robot.settings.name in present:
                self._note_seen(robot, now)
        for report in reports:
            self._receive_report(report, now)
        return watches

    def _configure_watch(self, now: Instant) -> None:
        """Have the watch follow the config, after the robots did."""
        with self._watching:
            watched = self._watch.configure(self.fleet.domain_ids)
        for domain_id in watched:
            self._watch_robots(domain_id, now)

    def _watch_robots(self, domain_id: Domain, now: Instant) -> list[RobotState]:
        """Watch the robots of a domain that there are now, by their settings; returns them."""
        robots = self._robots_of(domain_id)
        with self._watching:
            self._watch.set_robots(domain_id, (each.settings for each in robots), now)
        return robots

    def _robots_of(self, domain_id: Domain) -> list[RobotState]:
        """The robots of a domain that have a namespace of their own."""
        with self._lock:
            return [
                robot
                for robot in self._registry.robots.values()
                if robot.settings.domain_id == domain_id
                and robot.settings.in_ros
                and not robot.shared
            ]

    def _note_seen(self, robot: RobotState, now: Instant) -> None:
        """Note that a node of a robot is there, where that shows that it is up."""
        with self._lock:
            if self._registry.robots.get(robot.settings.name) is robot:
                if not robot.up:
                    self._registry.mark_publishing(robot)
                robot.note_seen(now)
                self._follow(robot, now)

    def update_endpoints(
        self, domain_id: Domain, topics: Mapping[str, TopicView], now: Instant
    ) -> None:
        """Take all endpoints of some topics of a domain, by name."""
        with self._watching:
            self._watch.see_topics(domain_id, topics, now)
        self._follow_servers(now)

    def watched_topics(
        self, domain_id: Domain, types: Mapping[str, Sequence[str]], now: Instant
    ) -> dict[str, str]:
        """Of the topics of a domain those to be subscribed beside diagnostics, with their types."""
        with self._watching:
            wanted = self._watch.wanted(domain_id, types, now)
        self._follow_servers(now)
        return wanted

    def record_watched(
        self, domain_id: Domain, topic: str, kind: str, data: bytes, now: Instant
    ) -> None:
        """Keep a message of such a topic as it was received, where its robot asks for it."""
        if self.recorder is None:
            return
        with self._watching:
            robot = self._watch.owner(domain_id, topic, kind, data)
        if robot is not None:
            self.recorder(Stream(Topic(domain_id, topic), kind, robot), data, now)

    def receive_watched(
        self, domain_id: Domain, topic: str, message: Message, now: Instant
    ) -> None:
        """Take a message of such a topic."""
        with self._watching:
            self._watch.see_message(domain_id, topic, message, now)

    def receive_goals(self, domain_id: Domain, topic: str, data: bytes, now: Instant) -> None:
        """Take a list of goals as its action server sent it."""
        try:
            goals = decode_goals(data)
        except ValueError as error:
            log.debug("%s: undecodable: %s", topic, error)
            return
        with self._watching:
            server = self._watch.servers.find(domain_id, topic)
        with self._lock:
            robot = None if server is None else self._registry.robots.get(server.robot)
            if server is None or robot is None:
                return
            if self._with_missions().see(robot, server.action, goals, now):
                self._follow(robot, now)

    def _with_missions(self) -> FleetMissions:
        if self._missions is None:
            self._missions = FleetMissions(self._events, self._faults)
        return self._missions

    def _restore_missions(self, rows: list[Row], now: Instant) -> None:
        """Go on from the rows of an earlier process; under the lock."""
        own = [row for row in rows if row.kind == MISSIONS]
        if own:
            self._with_missions().restore(own, self._registry.robots, now)
            for robot in self._registry.robots.values():
                self._look_at_latest(robot, robot.next_tick)

    def _mission_rows(self, now: Instant, *, at_once: bool) -> Iterable[Row]:
        """The rows of missions that are to be written now; under the lock."""
        if self._missions is None:
            return ()
        return self._missions.take_rows(self._registry.robots, now, at_once=at_once)

    def _follow_servers(self, now: Instant) -> None:
        """Have the missions know which action servers came, went or were restarted."""
        with self._watching:
            changes = self._watch.servers.take_changes()
        for change in changes:
            with self._lock:
                robot = self._registry.robots.get(change.server.robot)
                if robot is not None:
                    self._with_missions().follow_server(robot, change, now)
                    self._follow(robot, now)

    def offered(
        self, domain_id: Domain, topic: str, kind: str, type_hash: str, now: Instant
    ) -> bool:
        """Whether such a topic is read whose publishers offer this definition of its type."""
        with self._watching:
            return self._watch.offered(domain_id, topic, kind, type_hash, now)

    def refuse_watched(self, domain_id: Domain, topic: str, why: str, now: Instant) -> None:
        """Note why such a topic cannot be read."""
        with self._watching:
            self._watch.refuse(domain_id, topic, why, now)

    def receive_fields(
        self, domain_id: Domain, topic: str, kind: str, data: bytes, now: Instant
    ) -> float:
        """Take a message of a topic whose fields are components of a robot.

        Returns until when, monotonic, no other message of it is read.
        """
        self.record_watched(domain_id, topic, kind, data, now)
        if kind == GOALS_TYPE:
            self.receive_goals(domain_id, topic, data, now)
            return now.mono
        with self._watching:
            found = self._watch.see_fields(domain_id, topic, kind, data, now)
            due = self._watch.due(domain_id, topic)
        with self._lock:
            self._faults.advance(now)
            for name, statuses in found.items():
                robot = self._registry.robots.get(name)
                if robot is not None:
                    if not robot.up:
                        self._registry.mark_publishing(robot)
                    robot.receive_fields(truncate_statuses(statuses), now)
                    self._follow(robot, now)
        return due

    def update_offered(
        self, domain_id: Domain, types: Mapping[str, Sequence[str]], now: Instant
    ) -> dict[str, str]:
        """Take the types of what is published where nodes are not seen: in zenoh, in a recording.

        Returns those of the topics to be subscribed beside diagnostics.
        """
        self._watch_robots(domain_id, now)
        with self._watching:
            wanted = self._watch.wanted(domain_id, types, now)
            reports = list(self._watch.reports(domain_id, now))
        self._follow_servers(now)
        for report in reports:
            self._receive_report(report, now)
        return wanted

    def note_offered(self, domain_id: Domain, topics: Iterable[str], now: Instant) -> None:
        """Take the small topics that somebody publishes where nodes are not seen."""
        shown = [each for each in self._robots_of(domain_id) if each.is_shown_by_nodes(now)]
        with self._watching:
            self._watch.see_offered(domain_id, topics)
            present = self._watch.present(domain_id)
        for robot in shown:
            if robot.settings.name in present:
                self._note_seen(robot, now)

    def asked_topics(self, domain_id: Domain) -> frozenset[str]:
        """The names, or ends of names, of all small topics that are asked for in a domain."""
        found = [each for each in self.fleet.discoveries if domain_id in each.domain_ids]
        profiles = [each.profile for each in self.fleet.robots if each.domain_id == domain_id]
        profiles += [each.profile for each in found]
        return asked_names(profiles) | {end for each in found if (end := end_of_topic(each))}

    def define(self, kind: str, text: str) -> None:
        """Take the definition that a recording has of a type."""
        with self._watching:
            self._watch.types.define(kind, text)

    def definition(self, kind: str) -> str:
        """The definition of a type of messages that was received, with all that it uses.

        Raises:
            UnknownTypeError: nothing is known of it any more.
        """
        with self._watching:
            return self._watch.types.find(kind).text

    def note_watched(self, domain_id: Domain, rates: Mapping[str, float], now: Instant) -> None:
        """Take how many bytes per second such topics were in the last minute."""
        with self._watching:
            self._watch.note_watched(domain_id, rates, now)

    def update_links(
        self, domain_id: Domain, links: Mapping[str, LinkReading | None], now: Instant
    ) -> None:
        """Take what arrived of late on subscribed topics; None where one has several publishers."""
        readings: dict[str, list[LinkReading]] = {}
        with self._lock:
            for name, reading in links.items():
                for robot, _raw in self._registry.bindings.get(Topic(domain_id, name), ()):
                    found = readings.setdefault(robot.settings.name, [])
                    if reading is not None and not robot.shared:
                        found.append(reading)
            of_robots = {name: joined(each) if each else None for name, each in readings.items()}
            for name, reading in of_robots.items():
                self._registry.robots[name].update_link(reading)
        with self._watching:
            self._watch.see_links(of_robots, now)

    def accept_graph(self, robot: str, now: Instant) -> int:
        """Take what the ROS graph shows of a robot as expected; how many nodes are expected.

        Raises:
            LookupError: nothing of such a robot was ever seen in the graph.
        """
        with self._watching:
            return self._watch.accept(robot, now)

    def adopt(self, faults: Iterable[Fault], now: Instant) -> None:
        """Go on with faults whose alerts fire and which this process does not know.

        Those of robots that are not known (yet) are skipped. What makes components of what it saw
        before sees that as well: else it would say that all is well.
        """
        with self._lock:
            self._faults.report_fleet(now)  # before the first tick it is not known what it can do
            wanted = [each for each in faults if self._faults.engine.may_adopt(each, now)]
        of_graph = [each for each in wanted if _is_of(each, GROUP)]
        for domain_id in self.fleet.domain_ids if of_graph else ():
            self._watch_robots(domain_id, now)
        with self._watching:
            for fault in of_graph:
                robot, component = fault.identity.robot, fault.identity.component
                self._watch.adopt(robot, component, fault.message, now)
        with self._lock:
            for fault in wanted:
                if _is_of(fault, ACTIONS.group) and fault.identity.robot in self._registry.robots:
                    robot_state = self._registry.robots[fault.identity.robot]
                    self._with_missions().adopt(robot_state, fault, now)
            self._faults.adopt(wanted, now)

    def _receive_report(self, report: Report, now: Instant) -> None:
        """Update a robot from what the ROS graph shows of it: what is not among it is forgotten."""
        with self._lock:
            robot = self._registry.robots.get(report.robot)
            if robot is None:
                return
            for feed, statuses in report.by_feed():
                robot.measure(feed, truncate_statuses(statuses), now)
            names = {each.name for each in report.statuses} | report.held
            for component in [each for each in robot.components if is_of_graph(each.identity)]:
                if component.identity[0] not in names:
                    robot.forget(component, now)
            robot.network.expected_nodes = report.expected
            robot.set_reading(now, lossy=report.lossy, unread=report.unread)
            robot.network.watched, robot.network.logs = report.watched, report.logs
            for text in report.events:
                self._events.append(Event(now.wall, "graph", report.robot, message=text))
            self._follow(robot, now)

    @abstractmethod
    def _look_at_latest(self, robot: RobotState, due: float) -> None:
        """Have a robot looked at by then, monotonic."""

    @abstractmethod
    def _follow(self, robot: RobotState, now: Instant) -> None:
        """Have the faults follow what changed of a robot, and it looked at when that is due."""


def _is_of(fault: Fault, group: str) -> bool:
    """Whether it is the fault of a component that is made in this group."""
    return fault.identity.scope is Scope.COMPONENT and fault.identity.group == group
