"""Every robot of the fleet, behind one lock. All methods may be called from any thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from math import inf
from typing import Any, TypeVar

from typing_extensions import override

from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.faults.model import (
    DOWNTIMES,
    LEARNED,
    OTHERS,
    CapabilityView,
    ComponentName,
    End,
    Fault,
    Followed,
    Identity,
    ProblemView,
    Reason,
    Row,
)
from ros_diagnostics_exporter.faults.needs import NeedView
from ros_diagnostics_exporter.fleet.discovery import SharedTopic
from ros_diagnostics_exporter.fleet.fault_reports import FaultReports
from ros_diagnostics_exporter.fleet.unmatched import UnmatchedWatch, find_unmatched, known_robot
from ros_diagnostics_exporter.fleet.watched import WatchedFleet
from ros_diagnostics_exporter.model import (
    Array,
    Downtime,
    Feed,
    Instant,
    Status,
    Stream,
    Topic,
)
from ros_diagnostics_exporter.robots.limits import MAX_TEXT, truncate_statuses
from ros_diagnostics_exporter.robots.maintenance import holds
from ros_diagnostics_exporter.robots.missions import ACTIONS
from ros_diagnostics_exporter.robots.persisted import PersistedRobot
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.robots.updates import is_of_graph, query_of
from ros_diagnostics_exporter.sources.robot_graph import GROUP, SHADOW

Result = TypeVar("Result")
SLOW_TICK = 1.0  # seconds between two updates of what changes slowly: maintenance, forgetting
PASS_ON = 16  # robots between two chances of the threads that wait for the lock


class FleetState(WatchedFleet):
    """All that is known about the fleet."""

    def __init__(self, fleet: config.Fleet, now: Instant) -> None:
        super().__init__(fleet, now)
        self._turn = threading.Lock()  # of what must see no half of a reload
        self._slow_tick_at = now.mono
        self._holding: tuple[bool, ...] | None = None  # which downtimes do; None: not known
        self._downtimes: tuple[Downtime, ...] = ()  # that people planned
        self._downtimes_changed = False  # since their row was taken
        self._feeds = _feeds(fleet)
        self.unmatched = UnmatchedWatch()  # entries of the config that match nothing

    # -- from ROS: what `sources.reception.Receiver` asks for ---------------------------------

    def receive(self, topic: Topic, array: Array, now: Instant) -> None:
        """Update the robots whose array this is; ``topic`` is one of `wanted_topics`."""
        if self.recorder is not None:
            self.recorder(Stream(topic), array.raw, now)
        original = array
        if array.size > MAX_TEXT:  # else no text of it is longer than that
            statuses = truncate_statuses(array.statuses)  # without the lock: it looks at every text
            if statuses is not array.statuses:
                array = array._replace(statuses=tuple(statuses))
        with self._lock:
            if array is not original:
                self._registry.reject_long_text(topic)
            shared = self._registry.shared_topics.get(topic)
            if shared is not None:
                self._receive_shared(topic, shared, array, now)
                return
            for robot, raw in self._registry.bindings.get(topic, ()):
                if not robot.up:
                    self._registry.mark_publishing(robot)
                if robot.accepts(now, raw=raw):
                    self._receive(robot, array, now, raw=raw)

    def _receive(self, robot: RobotState, array: Array, now: Instant, *, raw: bool) -> None:
        if self._faults.due_at <= now.mono:  # of most messages nothing is
            self._faults.advance(now)
        robot.receive(array, now, raw=raw)
        self._follow(robot, now)

    def _receive_shared(
        self, topic: Topic, shared: SharedTopic, array: Array, now: Instant
    ) -> None:
        parts, unknown = shared.split(array.statuses)
        if unknown:
            self._registry.rejections.reject_statuses(topic, unknown)
        for name, statuses in parts.items():
            robot = self._registry.on_shared_topic(topic, name, now)
            if robot is not None:
                size = array.size * len(statuses) // max(1, len(array.statuses))
                part = Array(array.stamp, tuple(statuses), size, publisher=array.publisher)
                self._registry.mark_publishing(robot)
                self._receive(robot, part, now, raw=shared.settings.raw)

    # -- from other sources: what `sources.prometheus` asks for ----------------------------------

    def receive_answer(
        self, feed: Feed, statuses: Mapping[str, Sequence[Status]], now: Instant
    ) -> None:
        """Update the robots from an answer of a query, which has the statuses of each by name.

        One that it measured before and that is not among them has none now. Names of no robot are
        skipped.
        """
        for robot in self._sorted_robots():
            with self._lock:
                if self._feeds.get(feed.name) != feed:
                    return  # the config has dropped or changed it meanwhile
                own = statuses.get(robot.settings.name, ())
                is_measured = own or feed.name in robot.measured.answered
                if not is_measured or not self._is_known(robot):
                    continue
                self._faults.advance(now)
                robot.measure(feed, truncate_statuses(own), now)
                self._follow(robot, now)

    def addresses(self) -> dict[str, str]:
        """The robots' addresses by name, "" where a robot has none."""
        with self._lock:
            return {n: each.settings.address or "" for n, each in self._registry.robots.items()}

    # -- from time and people ----------------------------------------------------------------

    def tick(self, now: Instant) -> None:
        """Let time pass; to be called a few times a second.

        Looks at the robots that are due, and once a second at all of them. The lock is held for
        one robot at a time.
        """
        with self._turn:
            self._tick(now)

    def _tick(self, now: Instant) -> None:
        for robot in self._due(now):
            with self._lock:
                if not self._is_known(robot):
                    continue  # dropped: it is not silent
                robot.tick(now)
                if self._missions is not None:
                    self._missions.tick(robot, now)
                self._follow(robot, now)
        if slow := now.mono - self._slow_tick_at >= SLOW_TICK:
            self._slow_tick_at = now.mono
            self._tick_slowly(now)
        with self._lock:
            self._faults.tick(now, slow=slow)

    def _due(self, now: Instant) -> list[RobotState]:
        due: list[RobotState] = []
        with self._lock:
            self._faults.advance(now)  # by what was known before they are looked at
            while self._ticks.next < now.mono:
                due += self._ticks.pop()
            for robot in due:
                robot.look_at = inf
        return due

    @override
    def _follow(self, robot: RobotState, now: Instant) -> None:
        """Have the faults follow what changed of a robot, and it looked at when that is due."""
        self._faults.update(robot, now)
        if robot.settings.profile.modes is not None:
            self._with_missions().follow_mode(robot, now)
        if robot.next_tick < robot.look_at:
            self._look_at_latest(robot, robot.next_tick)

    @override
    def _look_at_latest(self, robot: RobotState, due: float) -> None:
        """Have a robot looked at by then, monotonic."""
        if due < robot.look_at:
            robot.look_at = due
            self._ticks.set(robot, due)

    def _tick_slowly(self, now: Instant) -> None:
        """Look at what changes slowly: maintenance, publishers of silent robots, absence."""
        holding = (
            *(holds(each, now.wall) for each in self.fleet.maintenance),
            *(each.holds(now.wall) for each in self._downtimes),
        )
        changed = holding != self._holding
        self._holding = holding
        for robot in self._sorted_robots():
            with self._lock:
                if not self._is_known(robot):
                    continue  # dropped meanwhile
                if not robot.up or robot.is_never_silent:
                    self._faults.update(robot, now)
                uplink = self._registry.robots.get(robot.settings.labels.get("uplink", ""))
                robot.network.uplink_up = uplink is None or not uplink.fails_as_uplink
                if changed:
                    robot.update_maintenance(self.fleet, now)
                self._registry.forget_absent(robot, now)

    def find_unmatched(self, now: Instant) -> None:
        """Look for entries of the config that match nothing; takes long, and holds no lock."""
        with self._turn:
            fleet, known = self.fleet, list(self.visit(known_robot))
        found = find_unmatched(fleet, known, now.wall)
        self.unmatched.update(found, now)

    def _is_known(self, robot: RobotState) -> bool:
        return self._registry.robots.get(robot.settings.name) is robot

    def configure(self, fleet: config.Fleet, now: Instant) -> None:
        """Apply another config; robots that it leaves unchanged keep all that is known.

        The robots follow it one by one: the lock is held for some of them at a time. Then what is
        watched of them in the ROS graph follows, and what of the config matches nothing.
        """
        with self._turn:
            steps = self._configure(fleet, now)
            while self._go_on(steps):
                time.sleep(0)  # else this thread takes the lock again before another wakes up
            self._configure_watch(now)
        self.find_unmatched(now)

    def _configure(self, fleet: config.Fleet, now: Instant) -> Iterator[None]:
        self.fleet = fleet
        self._faults.configure(fleet, now, is_over=False)
        self._feeds = _feeds(fleet)
        try:
            for robot in self._registry.configure(fleet, now):
                if robot is not None:
                    self._configure_robot(robot, now)
                yield
        finally:
            self._faults.configure(fleet, now, is_over=True)
        self._slow_tick_at = float("-inf")
        self._holding = None

    def _configure_robot(self, robot: RobotState, now: Instant) -> None:
        robot.follow_feeds(self._feeds, now)
        if self._missions is not None:
            self._missions.configure(robot, now)
        self._faults.configure_robot(robot, now)
        self._look_at_latest(robot, robot.next_tick)

    def _go_on(self, steps: Iterator[None]) -> bool:
        """Do some steps under the lock; whether there are more."""
        with self._lock:
            return len([*islice(steps, PASS_ON)]) == PASS_ON

    def plan(self, downtimes: Iterable[Downtime], now: Instant) -> None:
        """Follow the downtimes that people have planned, all of them."""
        planned = tuple(sorted(downtimes))
        if planned == self._downtimes:
            return
        with self._turn, self._lock:
            self._downtimes, self._downtimes_changed = planned, True
            by_robot: dict[str, tuple[Downtime, ...]] = {}
            for each in planned:
                by_robot[each.robot] = (*by_robot.get(each.robot, ()), each)
            self._registry.downtimes = by_robot
            for name, robot in self._registry.robots.items():
                robot.downtimes = by_robot.get(name, ())
                robot.update_maintenance(self.fleet, now)
            self._faults.tick(now, slow=True)

    def forget(self, name: str, component: str | None, now: Instant) -> int:
        """Forget a component by its name, or a robot with all of them; returns how many.

        Of a robot that is not known, what others still hold of it ends.

        Raises:
            LookupError: there is no such robot to have a component, or it has no such component.
        """
        with self._lock:
            robot = self._registry.robots.get(name)
            adopted = self._faults.forget(name, component, now)
            if robot is None:
                if component is None:
                    return 0
                raise LookupError(f"no robot {name!r}")
            found = [each for each in robot.components if component in (None, each.label)]
            if component is not None and not (found or adopted):
                raise LookupError(f"robot {name!r} has no component {component!r}")
            of_graph = [each.identity[0] for each in found if is_of_graph(each.identity)]
            for each in found:
                robot.forget(each, now)
                if query_of(each.identity) == ACTIONS.name:
                    self._with_missions().forget(robot, each.identity[0], now)
            if component is None and not robot.declared:
                self._registry.drop(robot, now)
            else:
                self._faults.update(robot, now)
        with self._watching:
            for watched in of_graph:
                self._watch.forget(name, watched, now)
        return len(found) + adopted

    def restore(self, persisted: Mapping[str, PersistedRobot], now: Instant) -> None:
        """Restore what an earlier process knew of the robots that the config still wants."""
        with self._lock:
            for name, known in persisted.items():
                robot = self._registry.find_again(name, known, now)
                if robot is not None:
                    robot.restore(known, now)
                    robot.follow_feeds(self._feeds, now)
                    if robot.up:  # without ROS: nothing else would have its faults know
                        self._look_at_latest(robot, now.mono)

    def restore_faults(self, rows: Iterable[Row], now: Instant) -> list[Row]:
        """Go on from the rows of an earlier process; to be called after `restore`.

        Returns those that cannot be restored: they refer to what is not among them.
        """
        rows = list(rows)
        for row in rows:
            if row.kind == DOWNTIMES and row.fields is not None:
                planned: Any = row.fields["planned"]
                self.plan([Downtime(*each) for each in planned], now)
        with self._watching:
            learned = {row.key[0]: row.fields for row in rows if row.kind == LEARNED and row.key}
            self._watch.restore(learned, now)
        with self._lock:
            self._restore_missions(rows, now)
            return self._faults.restore([row for row in rows if row.kind not in OTHERS], now)

    # -- queries -----------------------------------------------------------------------------

    def visit(
        self,
        function: Callable[[RobotState], Result],
        known: Callable[[RobotState], Result | None] = lambda _robot: None,
    ) -> Iterator[Result]:
        """``function`` of every robot, or what is ``known`` of it already, in the order of names.

        The lock is held for one robot at a time, not for ``known``, nor while a result is used.
        """
        for number, robot in enumerate(self._sorted_robots()):
            result = known(robot)
            if result is None:
                with self._lock:
                    result = function(robot)
                if number % PASS_ON == 0:
                    time.sleep(0)  # else this thread takes the lock before another wakes up
            yield result

    def _sorted_robots(self) -> list[RobotState]:
        with self._lock:
            return [robot for _name, robot in sorted(self._registry.robots.items())]

    def topics_of(self, name: str) -> tuple[Topic, ...]:
        """The topics on which a robot may be received."""
        with self._lock:
            robot = self._registry.robots.get(name)
            if robot is None:
                return ()
            settings = robot.settings
            return tuple(Topic(settings.domain_id, each) for each in settings.topics)

    def components_of(self, name: str) -> set[str] | None:
        """The names of a robot's components that were ever received; None: there is no robot."""
        with self._lock:
            robot = self._registry.robots.get(name)
            if robot is None:
                return None
            return {each.label for each in robot.components if each.level >= 0}

    def received(self) -> tuple[set[Topic], set[str]]:
        """The topics of diagnostics to be subscribed in all domains, and the robots."""
        with self._lock:
            domains = self.fleet.domain_ids
            wanted = {Topic(each, name) for each in domains for name in self.wanted_topics(each)}
            return wanted, set(self._registry.robots)

    def faults(self) -> list[Fault]:
        """All faults that last."""
        with self._lock:
            return list(self._faults.engine.faults())

    def served(self) -> tuple[list[Fault], list[End]]:
        """What is evidence for others: faults confirmed since the start, and what ended."""
        with self._lock:
            engine = self._faults.engine
            return list(engine.served()), list(engine.ends())

    def note_served(self, now: Instant) -> None:
        """Note that `served` was read by whoever holds the faults."""
        with self._lock:
            self._faults.engine.note_served(now)

    def judge(self, function: Callable[[FaultReports], Result]) -> Result:
        """``function`` of what judges the faults."""
        with self._lock:
            return function(self._faults)

    def members(self, fault: Fault) -> list[tuple[str, ComponentName]]:
        """The robots, or components of them, that a larger fault is about."""
        with self._lock:
            return list(self._faults.engine.members(fault.identity))

    def problems(self, now: Instant, robot: str | None = None) -> list[ProblemView]:
        """All problems of the fleet or of one robot, those not confirmed among them.

        Raises:
            LookupError: there is no such robot.
        """
        with self._lock:
            return self._faults.problems(now, robot)

    def followed(self, robot: RobotState) -> dict[ComponentName, Followed]:
        """What is kept of the components of a robot that is visited, in trouble now or before."""
        return self._faults.engine.followed(robot.settings.name)

    def faults_of(self, robot: RobotState) -> list[Identity]:
        """Which faults a robot that is visited has, with those of its parts."""
        return self._faults.engine.faults_of(robot.settings.name)

    def suppressed_components(self, robot: RobotState) -> dict[ComponentName, Reason]:
        """The components of a robot that is visited whose faults are due; another explains them."""
        return self._faults.suppressed_components(robot.settings.name)

    def capabilities(self, robot: RobotState) -> dict[str, CapabilityView]:
        """What a robot that is visited can do, each after those that it needs."""
        return self._faults.engine.capabilities(robot.settings.name)

    def needs(self, robot: str | None) -> dict[str, NeedView]:
        """What a robot, or (None) the fleet, can do, with how good all its parts are.

        Raises:
            LookupError: there is no such robot.
        """
        with self._lock:
            return self._faults.engine.needs(robot)

    def downtimes(self, robot: str) -> tuple[Downtime, ...]:
        """The downtimes of a robot and its components that people planned; some may lie ahead."""
        with self._lock:
            return self._registry.downtimes.get(robot, ())

    def take_fault_rows(self, now: Instant, *, at_once: bool = False) -> list[Row]:
        """The rows that changed since the last call, downtimes' too; `restore_faults` needs all.

        To be called now and then, also where nobody needs them; ``at_once``, also what may wait.
        """
        with self._watching:
            taken = self._watch.take_rows(self.robots, now)
            learned = [Row(LEARNED, (name,), each) for name, each in taken]
        with self._lock:
            missions = self._mission_rows(now, at_once=at_once)
            rows = [*self._faults.take_rows(now), *learned, *missions]
            if self._downtimes_changed:
                self._downtimes_changed = False
                planned: dict[str, object] = {"planned": list(map(list, self._downtimes))}
                rows.append(Row(DOWNTIMES, (), planned if self._downtimes else None))
            return rows

    def settled(self, now: Instant) -> bool:
        """Whether what was wrong before the start has been judged again."""
        with self._lock:
            return self._faults.engine.settled(now)

    def take_events(self) -> list[Event]:
        """The events since the last call, in the order in which they happened."""
        with self._lock:
            events = list(self._events)
            self._events.clear()
            return events

    @property
    def robots(self) -> Mapping[str, RobotState]:
        """The robots by name; other threads change them: read them with `visit`."""
        return self._registry.robots

    @property
    def rejected(self) -> Mapping[str, int]:
        """How often something that belongs to no known robot was rejected, by reason."""
        return self._registry.rejections.counts

    @property
    def robots_over_limit(self) -> list[str]:
        """The names of the robots that are rejected by a limit, sorted."""
        with self._lock:
            return sorted(self._registry.rejections.over_limit)


def _feeds(fleet: config.Fleet) -> dict[str, Feed]:
    """By name what delivers statuses beside ROS; of the graph as long as nothing else is known."""
    of_queries = {each.name: each.feed for each in fleet.queries}
    return {**of_queries, GROUP: SHADOW, ACTIONS.name: ACTIONS}
