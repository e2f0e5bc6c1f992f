"""Which robots there are, and which topic brings whose arrays.

Robots come by the config, by discovery and by topics that they share, and go by the config and by
time. Guarded by the lock of the State that holds it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.diagnostics import Instant
from ros_diagnostics_exporter.state.bounds import Budget, bounded
from ros_diagnostics_exporter.state.discovery import found_robot, robot_name
from ros_diagnostics_exporter.state.network import Endpoint, Topic
from ros_diagnostics_exporter.state.reasons import FleetRejection
from ros_diagnostics_exporter.state.refusals import Refusals
from ros_diagnostics_exporter.state.remembered import RememberedRobot
from ros_diagnostics_exporter.state.robot import Changed, Robot
from ros_diagnostics_exporter.state.shared import Splitter

SERIES_OF_ROBOT = 20  # at least: robot_*, check_components of the check "all"


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
            if (settings, fleet.limits) != (robot.settings, robot.limits):
                self._unbind(robot)
                robot.configure(settings, fleet.limits, now)
                self._bind(robot)
        for settings in declared.values():
            self.add(settings, declared=True)

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

    def add(self, settings: config.Robot, *, declared: bool) -> Robot | None:
        """A new robot; None, said and counted once, where there is no room for it."""
        if len(self.robots) >= self._fleet.limits.robots:
            self._shut_out(settings, "robot_limit", "the limit of robots is reached")
            return None
        if not self.budget.take(SERIES_OF_ROBOT):
            self._shut_out(settings, "series_limit", "the limit of series is reached")
            return None
        robot = Robot(settings, self._fleet.limits, self.budget, self._changed, declared=declared)
        self.robots[settings.name] = robot
        self.refusals.shut_out.discard(settings.name)
        self._bind(robot)
        self._told("known", robot)
        return robot

    def drop(self, robot: Robot) -> None:
        """Take a robot out, with all that is known about it."""
        self._told("forgotten", robot)
        self._unbind(robot)
        robot.members.remove_all()
        self.budget.give(SERIES_OF_ROBOT)
        del self.robots[robot.settings.name]

    def discover(self, domain_id: int, endpoints: Mapping[str, Endpoint]) -> None:
        """Add the robots whose topics a domain's graph shows and the config wants."""
        for discovery in self._fleet.discoveries:
            for name, endpoint in endpoints.items():
                topic = Topic(domain_id, name)
                if endpoint.publishers and topic not in self.bindings:
                    self._discover(discovery, topic)

    def _discover(self, discovery: config.Discovery, topic: Topic) -> None:
        if topic in self.splitters:
            return
        name = robot_name(discovery, topic.name, topic.domain_id)
        if name is None:
            return
        if name in self.robots:
            self.refusals.robot(topic, name, "duplicate_robot", "that name is taken")
        else:
            found = found_robot(discovery, name, topic.name, topic.domain_id)
            self.add(found, declared=False)

    def find_again(self, name: str, known: RememberedRobot) -> Robot | None:
        """A robot that a former process knew, if the config still wants it."""
        robot = self.robots.get(name)
        if robot is None:
            settings = self._settings_by_topic(name, Topic(known.domain_id, known.topic))
            robot = None if settings is None else self.add(settings, declared=False)
        return robot

    def on_shared_topic(self, topic: Topic, name: str) -> Robot | None:
        """The robot that a status on a shared topic names, made if it is new."""
        name = bounded(name, self._fleet.limits.label_length)
        robot = self.robots.get(name)
        if robot is None:
            return self.add(self.splitters[topic].robot(name), declared=False)
        if not any(each is robot for each, _raw in self.bindings.get(topic, ())):
            self.refusals.robot(topic, name, "duplicate_robot", "that name is taken")
            return None
        return robot

    def refuse_long(self, topic: Topic) -> None:
        """Count an array whose texts had to be cut, and say it once."""
        if topic in self.splitters:  # whose they are, the cut text might have said
            self.refusals.long(topic)
        else:
            for robot, _raw in self.bindings.get(topic, ()):
                robot.refuse("label_length", topic.name)

    def _shut_out(self, settings: config.Robot, reason: FleetRejection, why: str) -> None:
        topic = Topic(settings.domain_id, settings.topic_agg or settings.topic_raw or "")
        if self.refusals.robot(topic, settings.name, reason, why):
            self.refusals.shut_out.add(settings.name)

    # -- topics ------------------------------------------------------------------------------

    def _bind(self, robot: Robot) -> None:
        settings = robot.settings
        for topic, raw in ((settings.topic_agg, False), (settings.topic_raw, True)):
            if topic is not None and takes(settings.source, raw=raw):
                bound = self.bindings.setdefault(Topic(settings.domain_id, topic), [])
                bound.append((robot, raw))

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


def takes(source: config.Source, *, raw: bool) -> bool:
    """Whether arrays of this kind of topic are, or with ``auto`` may be, taken in."""
    return source is not (config.Source.AGG if raw else config.Source.RAW)
