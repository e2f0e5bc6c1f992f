"""Which robots there are, and which topic brings whose arrays.

Robots come by the config, by discovery and by topics that they share, and go by the config and by
time. Guarded by the lock of the State that holds it.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping

from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.state.bounds import Budget, bounded
from ros_diagnostics_exporter.state.discovery import found_robot, robot_name
from ros_diagnostics_exporter.state.network import Endpoint, Topic
from ros_diagnostics_exporter.state.persisted import RememberedRobot
from ros_diagnostics_exporter.state.reasons import FleetRejection
from ros_diagnostics_exporter.state.rejections import Refusals
from ros_diagnostics_exporter.state.robot import Changed, Robot
from ros_diagnostics_exporter.state.shared import Splitter

SERIES_OF_ROBOT = 20  # at least: robot_*, check_components of the check "all"
# Seconds that a discovered robot has to publish something before it may have to give way: monitors
# that publish once a minute exist (Autoware).
TIME_TO_PUBLISH = 90.0
MOST_TRIED = 10_000  # topics of robots that gave way, so that those wait longer that had their turn


class Roster:
    """The robots by name, and their topics.

    ``told`` hears ("known" or "forgotten", robot).
    """

    def __init__(
        self,
        fleet: config.Fleet,
        now: Instant,
        changed: Changed,
        told: Callable[[str, Robot], None],
    ) -> None:
        self.robots: dict[str, Robot] = {}
        self.bindings: dict[Topic, list[tuple[Robot, bool]]] = {}  # robot, is the topic raw
        self.splitters: dict[Topic, Splitter] = {}
        self.budget = Budget(fleet.limits.series)
        self._fleet = fleet
        self._changed = changed
        self._told = told
        self.refusals = Refusals()
        # Discovered, and nothing received of them since; the first is the one that waits longest.
        self._unproven: OrderedDict[str, Robot] = OrderedDict()
        self._tried: OrderedDict[Topic, float] = OrderedDict()  # when they gave way, monotonic
        self.configure(fleet, now)

    def configure(self, fleet: config.Fleet, now: Instant) -> None:
        """Follow another config: what it leaves unchanged is not touched."""
        self._fleet = fleet
        self.budget.limit = fleet.limits.series
        self.refusals.start_over()
        self.splitters = {
            Topic(each.domain_id, each.topic): Splitter(each) for each in fleet.shared
        }
        declared = {settings.name: settings for settings in fleet.robots}
        for name, robot in list(self.robots.items()):
            settings = declared.pop(name, None)
            is_declared = settings is not None
            settings = settings or self._rediscovered(name, robot)
            if settings is None:
                self.drop(robot)
                continue
            robot.declared = is_declared
            if is_declared:
                self._unproven.pop(name, None)
            if (settings, fleet.limits) != (robot.settings, robot.limits):
                self._unbind(robot)
                robot.configure(settings, fleet.limits, now)
                self._bind(robot)
        for settings in declared.values():
            self.add(settings, now, declared=True)

    def _rediscovered(self, name: str, robot: Robot) -> config.Robot | None:
        """What the config makes of a robot that it does not declare; None: it is not wanted."""
        old = robot.settings
        for topic in (old.topic_agg, old.topic_raw):
            if topic is not None:
                settings = self._settings_by_topic(name, Topic(old.domain_id, topic))
                if settings is not None:
                    return settings
        return None

    def _settings_by_topic(self, name: str, topic: Topic) -> config.Robot | None:
        if topic in self.splitters:
            return self.splitters[topic].robot(name)
        for discovery in self._fleet.discoveries:
            if robot_name(discovery, topic.name, topic.domain_id) == name:
                return found_robot(discovery, name, topic.name, topic.domain_id)
        return None

    # -- come and go -------------------------------------------------------------------------

    def add(self, settings: config.Robot, now: Instant, *, declared: bool) -> Robot | None:
        """A new robot; None, logged and counted, where the limits leave no place for it."""
        limit = self._limit()
        if limit is not None and self._make_place(now, at_once=declared):
            limit = self._limit()
        if limit is not None:
            self._shut_out(settings, limit, now)
            return None
        self.budget.take(SERIES_OF_ROBOT)
        robot = Robot(
            settings, self._fleet.limits, self.budget, self._changed, now, declared=declared
        )
        self.robots[settings.name] = robot
        if not declared:
            self._unproven[settings.name] = robot
        self.refusals.admitted(_topics(settings), settings.name)
        self._bind(robot)
        self._told("known", robot)
        return robot

    def drop(self, robot: Robot) -> None:
        """Take a robot out, with all that is known about it."""
        self._told("forgotten", robot)
        self._unbind(robot)
        robot.members.remove_all()
        self.budget.give(SERIES_OF_ROBOT)
        self._unproven.pop(robot.settings.name, None)
        del self.robots[robot.settings.name]

    def received(self, robot: Robot) -> None:
        """Note that a robot publishes: it gives way to no other any more."""
        self._unproven.pop(robot.settings.name, None)

    def _limit(self) -> FleetRejection | None:
        """The limit that leaves no place for one more robot."""
        if len(self.robots) >= self._fleet.limits.robots:
            return "robot_limit"
        return "series_limit" if self.budget.lacks(SERIES_OF_ROBOT) else None

    def _make_place(self, now: Instant, *, at_once: bool) -> bool:
        """Drop the robot that has had the longest time to publish and never did, if there is one.

        Topics that somebody only announces must not keep out robots for ever.
        """
        robot = next(iter(self._unproven.values()), None)
        if robot is None or not (at_once or now.mono - robot.found_mono >= TIME_TO_PUBLISH):
            return False
        for topic in _topics(robot.settings):
            self._tried.pop(topic, None)
            self._tried[topic] = now.mono
        while len(self._tried) > MOST_TRIED:
            self._tried.popitem(last=False)
        self.drop(robot)
        return True

    def discover(self, domain_id: int, endpoints: Mapping[str, Endpoint], now: Instant) -> None:
        """Add the robots whose topics a domain's graph shows and the config wants.

        Those that gave way to others come last.
        """
        topics = (Topic(domain_id, name) for name, each in endpoints.items() if each.publishers)
        new = [each for each in topics if each not in self.bindings and each not in self.splitters]
        new.sort(key=lambda topic: self._tried.get(topic, 0.0))
        for discovery in self._fleet.discoveries:
            for topic in new:
                if topic not in self.bindings:
                    self._discover(discovery, topic, now)

    def _discover(self, discovery: config.Discovery, topic: Topic, now: Instant) -> None:
        name = robot_name(discovery, topic.name, topic.domain_id)
        if name is None:
            return
        if name in self.robots:
            self.refusals.robot(topic, name, "duplicate_robot", now)
        else:
            found = found_robot(discovery, name, topic.name, topic.domain_id)
            self.add(found, now, declared=False)

    def find_again(self, name: str, known: RememberedRobot, now: Instant) -> Robot | None:
        """A robot that a former process knew, if the config still wants it.

        One that never published anything is no loss, and would be found by its topic.
        """
        robot = self.robots.get(name)
        if robot is None and known.last_seen:
            settings = self._settings_of(name, known)
            robot = None if settings is None else self.add(settings, now, declared=False)
            if robot is not None:
                self.received(robot)
        return robot

    def _settings_of(self, name: str, known: RememberedRobot) -> config.Robot | None:
        # Which of its two topics it was discovered by is not known any more.
        for topic in (known.topic, *config.topics_of(known.topic, config.Source.AUTO)):
            settings = self._settings_by_topic(name, Topic(known.domain_id, topic or ""))
            if settings is not None:
                return settings
        return None

    def on_shared_topic(self, topic: Topic, name: str, now: Instant) -> Robot | None:
        """The robot that a status on a shared topic names, made if it is new."""
        name = bounded(name, self._fleet.limits.label_length)
        robot = self.robots.get(name)
        if robot is None:
            return self.add(self.splitters[topic].robot(name), now, declared=False)
        if topic not in _topics(robot.settings):
            self.refusals.robot(topic, name, "duplicate_robot", now)
            return None
        return robot

    def refuse_long(self, topic: Topic) -> None:
        """Count an array whose texts had to be cut, and say it once."""
        if topic in self.splitters:  # whose they are, the cut text might have said
            self.refusals.long(topic)
        else:
            for robot, _raw in self.bindings.get(topic, ()):
                robot.refuse("label_length", topic.name)

    def _shut_out(self, settings: config.Robot, limit: FleetRejection, now: Instant) -> None:
        topic = Topic(settings.domain_id, settings.topic_agg or settings.topic_raw or "")
        self.refusals.robot(topic, settings.name, limit, now)

    # -- topics ------------------------------------------------------------------------------

    def _bind(self, robot: Robot) -> None:
        for topic, raw in _topics(robot.settings).items():
            self.bindings.setdefault(topic, []).append((robot, raw))

    def _unbind(self, robot: Robot) -> None:
        for name in (robot.settings.topic_agg, robot.settings.topic_raw):
            topic = Topic(robot.settings.domain_id, name or "")
            bound = self.bindings.get(topic, [])
            bound[:] = [entry for entry in bound if entry[0] is not robot]
            if topic in self.bindings and not bound:
                del self.bindings[topic]

    def wanted(self, domain_id: int) -> Iterator[Topic]:
        """The topics of a domain that bring something which is taken in."""
        for topic, bound in self.bindings.items():
            of_interest = topic.domain_id == domain_id and topic not in self.splitters
            if of_interest and any(takes(robot.source, raw=raw) for robot, raw in bound):
                yield topic
        yield from (topic for topic in self.splitters if topic.domain_id == domain_id)


def _topics(settings: config.Robot) -> dict[Topic, bool]:
    """The topics whose arrays are, or may be, the robot's, and whether they are raw."""
    return {
        Topic(settings.domain_id, topic): raw
        for topic, raw in ((settings.topic_agg, False), (settings.topic_raw, True))
        if topic is not None and takes(settings.source, raw=raw)
    }


def takes(source: config.Source, *, raw: bool) -> bool:
    """Whether arrays of this kind of topic are, or with ``auto`` may be, taken in."""
    return source is not (config.Source.AGG if raw else config.Source.RAW)
