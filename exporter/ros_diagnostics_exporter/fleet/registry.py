"""Which robots are known, and which topic carries whose arrays.

Robots are added by the config, by discovery and by topics that they share; they are dropped by the
config and after a time. Protected by the lock of the State that holds it.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from collections.abc import Iterable, Iterator, Mapping
from math import inf

from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.fleet.discovery import (
    SharedTopic,
    found_robot,
    namespace_of,
    robot_name,
)
from ros_diagnostics_exporter.fleet.fault_reports import FaultReports
from ros_diagnostics_exporter.fleet.newcomers import NewcomerRate
from ros_diagnostics_exporter.fleet.unclaimed import UnclaimedWatch, beside
from ros_diagnostics_exporter.model import Domain, Downtime, Endpoint, Instant, Topic
from ros_diagnostics_exporter.robots.limits import SeriesLimit, truncate
from ros_diagnostics_exporter.robots.persisted import PersistedRobot
from ros_diagnostics_exporter.robots.rejections import (
    MAX_REJECTED,
    FleetRejectionReason,
    FleetRejections,
)
from ros_diagnostics_exporter.robots.robot import RobotState, accepts

NEWCOMERS_SHARE = 2  # they may have the half of all series
SERIES_OF_ROBOT = 24  # at least: robot_*, check_components of the check "all"
# Seconds that a discovered robot has to publish something before it may be replaced by another:
# monitors that publish once a minute exist (Autoware).
TIME_TO_PUBLISH = 90.0
MAX_ELSEWHERE = 100_000  # topics that are known to be of other exporters' robots
MAX_REPLACED = 10_000  # topics of replaced robots, so that these are tried again last
# Robots that are discovered before something was received of them. Those of a large fleet publish
# within a second or two, and the next ones are found then. Invented ones do not.
MOST_ANNOUNCED = 200


class RobotRegistry:
    """The robots by name, and their topics. What happens to them is appended to ``events``."""

    def __init__(
        self, fleet: config.Fleet, now: Instant, events: deque[Event], faults: FaultReports
    ) -> None:
        self.robots: dict[str, RobotState] = {}
        self.bindings: dict[Topic, list[tuple[RobotState, bool]]] = {}  # robot, is the topic raw
        self.shared_topics: dict[Topic, SharedTopic] = {}
        self.series = SeriesLimit(fleet.limits.series)
        self._newcomers_series = SeriesLimit(fleet.limits.series // NEWCOMERS_SHARE, self.series)
        self._newcomers = NewcomerRate(fleet.limits.new_robots, now)
        self._fleet = fleet
        self._events = events
        self._faults = faults
        self.rejections = FleetRejections()
        self._elsewhere: set[Topic] = set()  # that are of robots of other exporters
        self.unclaimed = UnclaimedWatch(fleet)
        # Discovered, and nothing received from them yet; the longest known first.
        self._not_publishing: OrderedDict[str, RobotState] = OrderedDict()
        self._replaced: OrderedDict[Topic, float] = OrderedDict()  # when, monotonic
        self.downtimes: dict[str, tuple[Downtime, ...]] = {}  # that people planned, by robot
        self._other_types: dict[Domain, Mapping[str, tuple[str, ...]]] = {}  # by domain and topic
        self._listened_since: dict[Domain, float] = {}  # monotonic; none: not yet
        self._configured = now.mono  # when fleet.yml last said whom to listen to
        for _robot in self.configure(fleet, now):
            pass

    def configure(self, fleet: config.Fleet, now: Instant) -> Iterator[RobotState | None]:
        """Apply another config, a robot at each step: what it leaves unchanged is not touched.

        Between two steps arrays may be received, and robots added and dropped. Yields the robot of
        the step, None for one that is not wanted.
        """
        self._fleet, self._configured = fleet, now.mono
        self._elsewhere = set() if fleet.shard is None else {*fleet.shard.elsewhere}
        self.unclaimed.configure(fleet)
        self.series.limit = fleet.limits.series
        self._newcomers_series.limit = fleet.limits.series // NEWCOMERS_SHARE
        self._newcomers.at_once = fleet.limits.new_robots
        self.rejections.reset()
        for domain_id, types in self._other_types.items():
            self._reject_types(domain_id, types.items(), now)
        self.shared_topics = {
            Topic(each.domain_id, each.topic): SharedTopic(each) for each in fleet.shared
        }
        declared = {settings.name: settings for settings in fleet.robots}
        for name, robot in list(self.robots.items()):
            if self.robots.get(name) is robot:
                yield self._configure(robot, declared.get(name), now)
        for settings in fleet.robots:
            self._drop_found(settings, now)
        for settings in fleet.robots:
            self._drop_found(settings, now)  # since the first step
            found = self.robots.get(settings.name)
            if found is None:
                yield self.add(settings, now, declared=True)
            elif not found.declared:  # discovered since the first step
                yield self._configure(found, settings, now)

    def _configure(
        self, robot: RobotState, settings: config.Robot | None, now: Instant
    ) -> RobotState | None:
        """Have a robot follow the config, which declares it with ``settings``; None: dropped."""
        name, is_declared = robot.settings.name, settings is not None
        settings = settings or self._rediscovered(name, robot)
        if settings is None:
            self.drop(robot, now)
            return None
        robot.declared, robot.shared = is_declared, self._is_shared(settings)
        if is_declared:
            self._not_publishing.pop(name, None)
        if (settings, self._fleet.limits) != (robot.settings, robot.limits):
            self._unbind(robot)
            robot.configure(settings, self._fleet.limits, now)
            self._bind(robot)
        return robot

    def _drop_found(self, settings: config.Robot, now: Instant) -> None:
        """Drop what was discovered, by another name, on a topic of a robot that is declared."""
        for topic in _topics(settings):
            for robot, _raw in list(self.bindings.get(topic, ())):
                is_other = robot.settings.name != settings.name
                if is_other and not (robot.declared or topic in self.shared_topics):
                    self.drop(robot, now)

    def _rediscovered(self, name: str, robot: RobotState) -> config.Robot | None:
        """The settings of a robot that the config does not declare; None if it is not wanted.

        One that it declared before is taken out by that, unless somebody publishes as it.
        """
        old = robot.settings
        if robot.declared and not (robot.up or robot.is_published):
            return None
        for topic in (old.topic_agg, old.topic_raw, old.topic):
            if topic is not None:
                at = Topic(old.domain_id, topic)
                settings = self._settings_by_topic(name, at, shared=robot.shared)
                if settings is not None:
                    return settings
        return None

    def _settings_by_topic(self, name: str, topic: Topic, *, shared: bool) -> config.Robot | None:
        """The settings of a robot on a topic; ``shared``: a status on a shared topic named it."""
        if not self._fleet.has(name):
            return None
        if topic in self.shared_topics:
            return self.shared_topics[topic].robot(name) if shared else None
        for discovery in self._fleet.discoveries:
            if robot_name(discovery, topic.name, topic.domain_id) == name:
                return found_robot(discovery, name, topic.name, topic.domain_id)
        return None

    def _is_shared(self, settings: config.Robot) -> bool:
        return any(topic in self.shared_topics for topic in _topics(settings))

    # -- added and dropped -------------------------------------------------------------------

    def add(
        self, settings: config.Robot, now: Instant, *, declared: bool, known: bool = False
    ) -> RobotState | None:
        """A new robot, ``known`` to an earlier process; None where a limit rejects it."""
        is_new = not (declared or known)
        series = self._newcomers_series if is_new and self._newcomers.limits(now) else self.series
        limit = self._limit(series)
        if limit is not None and self._replace_one(now, at_once=declared):
            limit = self._limit(series)
        if limit is None and is_new and not self._newcomers.take(now):
            limit = "new_robots"
        if limit is not None:
            self._reject(settings, limit, now)
            return None
        series.add(SERIES_OF_ROBOT)
        robot = RobotState(
            settings, self._fleet.limits, series, self._events, now, declared=declared
        )
        robot.shared = self._is_shared(settings)
        domain_since = self._listened_since.get(settings.domain_id, self._configured)
        robot.listened_since = max(domain_since, self._configured)
        if is_new:
            self._newcomers.note(robot, now)
        self.robots[settings.name] = robot
        if not declared:
            self._not_publishing[settings.name] = robot
        self.rejections.accept_robot(_topics(settings), settings.name)
        self._bind(robot)
        robot.downtimes = self.downtimes.get(settings.name, ())
        robot.update_maintenance(self._fleet, now)  # no scrape may show it without its downtime
        robot.record("known", now)
        self._faults.add(robot, now)
        robot.components.has_fault = lambda component: self._faults.has_fault(robot, component)
        return robot

    def drop(self, robot: RobotState, now: Instant) -> None:
        """Remove a robot, with all that is known about it."""
        robot.record("forgotten", now)
        self._faults.remove(robot, now)
        self._unbind(robot)
        for component in list(robot.components):
            robot.components.remove(component)
        robot.series.remove(SERIES_OF_ROBOT)
        self._not_publishing.pop(robot.settings.name, None)
        del self.robots[robot.settings.name]

    def forget_absent(self, robot: RobotState, now: Instant) -> None:
        """Forget what is long absent, was OK and has no problem: components, then the robot."""
        robot.components.rename_waiting()
        robot.forget_absent_components(now, lambda each: self._faults.keeps(robot, each))
        is_gone = robot.is_forgettable(now) and not self._faults.keeps(robot)
        if is_gone or (robot.is_forgettable_newcomer(now) and not self._faults.has_any(robot)):
            self.drop(robot, now)

    def mark_publishing(self, robot: RobotState) -> None:
        """Note that a robot publishes: no other replaces it any more."""
        self._not_publishing.pop(robot.settings.name, None)

    def _limit(self, series: SeriesLimit) -> FleetRejectionReason | None:
        """The limit that rejects one more robot with such series, if there is one."""
        if len(self.robots) >= self._fleet.limits.robots:
            return "robot_limit"
        return "series_limit" if series.exceeded_by(SERIES_OF_ROBOT) else None

    def _replace_one(self, now: Instant, *, at_once: bool) -> bool:
        """Drop the robot that has had the longest time to publish and never did, if there is one.

        Topics on which nobody ever publishes must not block robots for ever.
        """
        waiting = self._not_publishing.values()
        robot = next((each for each in waiting if not self._faults.keeps(each)), None)
        if robot is None or not (at_once or now.mono - robot.found_mono >= TIME_TO_PUBLISH):
            return False
        for topic in _topics(robot.settings):
            self._replaced.pop(topic, None)
            self._replaced[topic] = now.mono
        while len(self._replaced) > MAX_REPLACED:
            self._replaced.popitem(last=False)
        self.drop(robot, now)
        return True

    def discover(self, domain_id: Domain, endpoints: Mapping[str, Endpoint], now: Instant) -> None:
        """Add the robots whose topics a domain's graph shows and the config wants.

        Those that were replaced before come last.
        """
        self._newcomers.look(now)
        if domain_id not in self._listened_since:
            self._listen(domain_id, now)
        if self._must_wait(now):
            return  # else somebody who offers 20,000 topics has each look go through them all
        topics = (Topic(domain_id, name) for name, each in endpoints.items() if each.publishers)
        known = (self.bindings, self.shared_topics, self._elsewhere)
        new = [each for each in topics if not any(each in topics for topics in known)]
        new.sort(key=lambda topic: self._replaced.get(topic, -inf))
        any_type = [Topic(domain_id, name) for name, each in endpoints.items() if each.is_offered]
        self._add_found(new, any_type, now)
        if self._must_wait(now):
            return  # topics of robots that are found next are somebody's
        # A topic beside the one that its robot was found by is that robot's.
        others = (each for each in new if not any(of in self.bindings for of in beside(each)))
        self.unclaimed.update(domain_id, others)

    def _listen(self, domain_id: Domain, now: Instant) -> None:
        """Note that a domain is looked at, for the first time since it was joined."""
        self._listened_since[domain_id] = now.mono
        for robot in self.robots.values():
            if robot.settings.domain_id == domain_id:
                robot.listened_since = now.mono

    def lose(self, domain_id: Domain) -> None:
        """Note that a domain is not joined any more."""
        self._listened_since.pop(domain_id, None)

    def _add_found(self, arrays: Iterable[Topic], any_type: Iterable[Topic], now: Instant) -> None:
        """Add the robots of these topics, until as many are rejected as are known to be.

        Somebody may offer 100,000, and while they are looked at no robot is heard. ``arrays`` are
        topics of diagnostics, ``any_type`` all, by which robots without diagnostics are found.
        """
        left = MAX_REJECTED
        for discovery in self._fleet.discoveries:
            for topic in any_type if discovery.source is config.Source.NONE else arrays:
                if not left or self._must_wait(now):
                    return
                is_known = topic in self.bindings or topic in self._elsewhere
                if not is_known and not self._discover(discovery, topic, now):
                    left -= 1

    def _must_wait(self, now: Instant) -> bool:
        """Whether the next robots are found only once those before have published something."""
        if len(self._not_publishing) < MOST_ANNOUNCED:
            return False
        first = next(iter(self._not_publishing.values()))
        return now.mono - first.found_mono < TIME_TO_PUBLISH

    def _discover(self, discovery: config.Discovery, topic: Topic, now: Instant) -> bool:
        """Add a topic's robot where the config wants it; False where a limit rejects it."""
        name = robot_name(discovery, topic.name, topic.domain_id)
        if name is None:
            return True
        if not self._fleet.has(name):
            if len(self._elsewhere) > MAX_ELSEWHERE:
                self._elsewhere.clear()
            self._elsewhere.add(topic)
            return True
        known = self.robots.get(name)
        if known is not None and _is_at(known.settings, discovery, topic):
            return True
        if known is not None:
            self.rejections.reject_robot(topic, name, "duplicate_robot", now)
            return True
        if len(self._not_publishing) >= MOST_ANNOUNCED:
            self._replace_one(now, at_once=False)
        found = found_robot(discovery, name, topic.name, topic.domain_id)
        return self.add(found, now, declared=False) is not None

    def note_other_types(
        self, domain_id: Domain, types: Mapping[str, tuple[str, ...]], now: Instant
    ) -> None:
        """Reject topics that a discovery wants and that have another type than DiagnosticArray."""
        known = self._other_types.get(domain_id, {})
        self._other_types[domain_id] = types
        self._reject_types(domain_id, types.items() - known.items(), now)

    def _reject_types(
        self, domain_id: Domain, found: Iterable[tuple[str, tuple[str, ...]]], now: Instant
    ) -> None:
        for topic, types in found:
            for discovery in self._fleet.discoveries:
                name = robot_name(discovery, topic, domain_id)
                is_own = name is not None and self._fleet.has(name)
                if name is not None and is_own and discovery.source is not config.Source.NONE:
                    why = f"the topic has another type, {', '.join(types):.200}"
                    at = Topic(domain_id, topic)
                    self.rejections.reject_robot(at, name, "wrong_type", now, why)

    def find_again(self, name: str, known: PersistedRobot, now: Instant) -> RobotState | None:
        """A robot that an earlier process knew, if the config still wants it.

        One that never published anything is skipped; it would be discovered again.
        """
        robot = self.robots.get(name)
        if robot is None and known.last_seen:
            settings = self._settings_of(name, known)
            if settings is not None:
                robot = self.add(settings, now, declared=False, known=True)
            if robot is not None:
                self.mark_publishing(robot)
        return robot

    def _settings_of(self, name: str, known: PersistedRobot) -> config.Robot | None:
        """Those of a robot that is not declared.

        One that was is taken out by that, and discovered again if anybody publishes as it.
        """
        if known.origin == "declared":
            return None
        shared = known.origin == "shared"
        # By which of its two topics it was discovered is not persisted.
        for topic in (known.topic, *config.topics_of(known.topic, config.Source.AUTO)):
            at = Topic(known.domain_id, topic or "")
            settings = self._settings_by_topic(name, at, shared=shared)
            if settings is not None:
                is_free = shared or not self.bindings.keys() & _topics(settings).keys()
                return settings if is_free else None
        return None

    def on_shared_topic(self, topic: Topic, name: str, now: Instant) -> RobotState | None:
        """The robot that a status on a shared topic names, added if it is new."""
        name = truncate(name, self._fleet.limits.label_length)
        robot = self.robots.get(name)
        if robot is None:
            if not self._fleet.has(name):
                return None
            return self.add(self.shared_topics[topic].robot(name), now, declared=False)
        if topic not in _topics(robot.settings):
            self.rejections.reject_robot(topic, name, "duplicate_robot", now)
            return None
        return robot

    def reject_long_text(self, topic: Topic) -> None:
        """Count an array with truncated texts."""
        if topic in self.shared_topics:  # the truncated text might have named the robot
            self.rejections.reject_long_text(topic)
        else:
            for robot, _raw in self.bindings.get(topic, ()):
                robot.reject("label_length", topic.name)

    def _reject(self, settings: config.Robot, limit: FleetRejectionReason, now: Instant) -> None:
        topic = Topic(settings.domain_id, settings.topic_agg or settings.topic_raw or "")
        self.rejections.reject_robot(topic, settings.name, limit, now)

    # -- topics ------------------------------------------------------------------------------

    def _bind(self, robot: RobotState) -> None:
        for topic, raw in _topics(robot.settings).items():
            self.bindings.setdefault(topic, []).append((robot, raw))

    def _unbind(self, robot: RobotState) -> None:
        for name in (robot.settings.topic_agg, robot.settings.topic_raw):
            topic = Topic(robot.settings.domain_id, name or "")
            bound = self.bindings.get(topic, [])
            bound[:] = [entry for entry in bound if entry[0] is not robot]
            if topic in self.bindings and not bound:
                del self.bindings[topic]

    def wanted_topics(self, domain_id: Domain) -> Iterator[tuple[str, bool]]:
        """(name, whether robots share it) of a domain's topics to be subscribed."""
        for topic, bound in self.bindings.items():
            own = topic.domain_id == domain_id and topic not in self.shared_topics
            if own and any(robot.wants(raw=raw) for robot, raw in bound):
                yield topic.name, False
        yield from ((each.name, True) for each in self.shared_topics if each.domain_id == domain_id)


def _is_at(settings: config.Robot, discovery: config.Discovery, topic: Topic) -> bool:
    """Whether a robot is the one behind any topic of it that a discovery looks for."""
    is_any = discovery.source is config.Source.NONE
    at = topic.domain_id, namespace_of(discovery, topic.name)
    return is_any and (settings.domain_id, settings.namespace) == at


def _topics(settings: config.Robot) -> dict[Topic, bool]:
    """The topics whose arrays are, or may be, the robot's, and whether they are raw."""
    return {
        Topic(settings.domain_id, topic): raw
        for topic, raw in ((settings.topic_agg, False), (settings.topic_raw, True))
        if topic is not None and accepts(settings.source, raw=raw)
    }
