"""The source of what the ROS graph shows and no driver reports. Pure: no ROS, no clock, no lock.

What belongs to a robot is what is in its namespace. Of each robot it makes statuses: of a node or
topic from its first trouble until an hour after the last, so that robots without any have none.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import inf
from typing import Annotated, Any, NamedTuple

from pydantic import Field

from ros_diagnostics_exporter.config.fleet import Robot
from ros_diagnostics_exporter.config.graph import Graph
from ros_diagnostics_exporter.model import Domain, Feed, Instant, Level, Status
from ros_diagnostics_exporter.sources.graph_messages import (
    LOGS,
    PARAMETERS,
    Battery,
    Message,
    Messages,
    MessagesLearned,
    Parameters,
    is_asked_for,
    is_wanted,
    node_in,
    node_of,
    over_budget,
)
from ros_diagnostics_exporter.sources.graph_nodes import Nodes
from ros_diagnostics_exporter.sources.graph_topics import (
    Mismatch,
    Seconds,
    TopicLearned,
    Topics,
    TopicView,
)
from ros_diagnostics_exporter.sources.link import LinkReading

GROUP = "ROS graph"
FRESH = 120.0  # seconds after which what is not reported again is STALE, which is no fault
REPORT = 30.0  # ... between two reports in which nothing has changed
GRAPH = Feed(GROUP, GROUP, FRESH, planned_stale=True)
SHADOW = GRAPH._replace(shadow=True)
SHADOW_TIME = 7 * 86_400.0  # seconds for which a robot is known until its silent faults are faults
HELD = 120.0  # ... after a start, until what is no problem any more is well
UNREAD = 900.0  # ... more after which a topic that was not read again is not there any more
KEPT = 3600.0  # seconds for which a status is made after its trouble
WRITTEN = 3600.0  # ... between two writes of what was learned
SOON = 10.0  # ... after a message that a later process should know, until it is written
LINK = "link"
LEAST_MESSAGES = 20  # that are expected, until a loss is judged
MOST_KNOWN = 1000  # nodes, or topics, of one robot
TRY_AGAIN = 3600.0  # seconds after which what was given up is subscribed again

# Tools and helpers, and names that have the number of a process or something random in them.
IGNORED = re.compile(
    r".*/((_|rviz|rqt|launch_ros_|ros2cli|rosbag2|transform_listener_impl_)[^/]*"
    r"|ros_diagnostics_exporter|[^/]*[0-9]{4,}[^/]*|[^/]*_(?=[0-9a-f]*[0-9])[0-9a-f]{6,})"
)
GLOBAL = (LOGS, PARAMETERS)  # topics of every node
_NO_TOPIC = re.compile(r".*/(rosout|parameter_events|_action/.*)")  # every node's, an action's
_Name = Annotated[str, Field(max_length=256)]
_Accepted = tuple[_Name, tuple[_Name, _Name, Annotated[str, Field(max_length=1000)]]]


class Learned(NamedTuple):
    """What a later process should know of one robot.

    ``known`` is the Unix time since when it is, ``nodes`` are seconds by name; ``shown`` are the
    components that are or were a problem, ``accepted`` mismatches that a person knows, by topic.
    """

    known: Annotated[float, Field(ge=-1e11, le=1e11, allow_inf_nan=False)]
    nodes: Annotated[dict[_Name, Seconds], Field(max_length=MOST_KNOWN)]
    topics: Annotated[dict[_Name, TopicLearned], Field(max_length=MOST_KNOWN)]
    shown: Annotated[list[_Name], Field(max_length=2 * MOST_KNOWN)]
    accepted: Annotated[list[_Accepted], Field(max_length=MOST_KNOWN)]
    messages: MessagesLearned


class Report(NamedTuple):
    """All statuses of one robot, and what happened.

    ``held`` are components of which nothing is known yet, or any more; so many nodes are
    ``expected``; ``lossy``: too many messages are lost. ``logs`` are those of the last minute, and
    ``watched`` the bytes per second of what is subscribed beside diagnostics, None: nothing is.
    Of a robot that is not watched any more, ``expected`` is None, and nothing is wrong.
    """

    robot: str
    feed: Feed
    statuses: tuple[Status, ...]
    held: frozenset[str]
    expected: int | None
    lossy: bool
    events: tuple[str, ...] = ()
    logs: tuple[str, ...] = ()
    watched: float | None = None

    def by_feed(self) -> Iterator[tuple[Feed, tuple[Status, ...]]]:
        """The statuses: what fleet.yml asks for is nothing learned, and so never a shadow."""
        yield GRAPH, tuple(each for each in self.statuses if is_asked_for(each.name))
        yield self.feed, tuple(each for each in self.statuses if not is_asked_for(each.name))


class RobotGraph:
    """What is seen of one robot."""

    def __init__(self, settings: Graph, namespace: str, now: Instant) -> None:
        self.settings = settings
        self.namespace = namespace
        self.known = now.wall
        self.lossy = False
        self.report_at = self.write_at = now.mono
        self.met = False  # whether any of its nodes was ever there
        self._nodes = Nodes()
        self._topics = Topics()
        self.messages = Messages()
        self.watched: float | None = None
        self._link: LinkReading | None = None
        self._problems: dict[str, tuple[int, str]] = {}
        self._well: dict[str, float] = {}  # since when what had trouble has none, monotonic
        self._held: set[str] = set()  # of an earlier process, and nothing is known yet
        self._held_until = inf

    def follow(self, settings: Graph, namespace: str) -> None:
        """Go on by another config."""
        self.settings, self.namespace = settings, namespace

    # -- seen --------------------------------------------------------------------------------

    def see_nodes(self, names: Iterable[str], now: Instant) -> None:
        """Take the full names of all its nodes; one that several have is there as often."""
        found = Counter(each for each in map(self._own, names) if each)
        if found and not self.met:
            self.met, self.known = True, now.wall
        self._nodes.update(found, now)
        self.report_at = now.mono

    def see_topic(self, name: str, view: TopicView, now: Instant) -> None:
        """Take one of its topics."""
        own = self._own(name)
        if own and not _NO_TOPIC.fullmatch(name):
            self._topics.update(own, view.without(self._is_ignored), now)
            self._nodes.note_processes(self._processes(view))
            self.report_at = now.mono

    def _processes(self, view: TopicView) -> Iterator[tuple[str, str]]:
        for each in (*view.publishers, *view.subscribers):
            if own := self._own(each.node):
                yield own, each.process

    def see_message(self, node: str, message: Message, now: Instant) -> None:
        """Take a message of one of its nodes, by its full name."""
        if own := self._own(node):
            if self.messages.note(own, message, self.settings.watch, now):
                self.report_at = now.mono
            if not isinstance(message, Battery | Parameters):
                self.write_at = min(self.write_at, now.mono + SOON)

    def see_link(self, reading: LinkReading | None, now: Instant) -> None:
        """Take what arrived of late."""
        self._link = reading
        if self._judge_link():
            self.report_at = now.mono

    def _own(self, name: str) -> str:
        """A name in the robot's namespace; "" where it does not count."""
        return "" if self._is_ignored(name) else name.removeprefix(self.namespace).removeprefix("/")

    def _is_ignored(self, name: str) -> bool:
        if IGNORED.fullmatch(name):
            return True
        own = name.removeprefix(self.namespace).removeprefix("/")
        return any(each.fullmatch(name) or each.fullmatch(own) for each in self.settings.ignore)

    # -- judged ------------------------------------------------------------------------------

    def report(self, robot: str, now: Instant) -> Report | None:
        """What is to be said of it now; None where nothing is there of which anything is known."""
        self.report_at = now.mono + REPORT
        if not (self._nodes.there or self._link):
            return None
        problems = {name: each for name, each in self._problems.items() if name != LINK}
        if self._nodes.there and not self.lossy:
            problems = self._judge(now)
            self.report_at = min(self.report_at, self._nodes.due, self.messages.due(now))
        if self.lossy and self._link is not None:
            lost = f"{100 * self._link.loss:.0f} % of its messages are lost"
            problems[LINK] = int(Level.ERROR), lost
        self._take(problems, now)
        self._release(now)
        for name in [name for name, since in self._well.items() if now.mono - since > KEPT]:
            del self._well[name]
        parts = (self._nodes, self._topics, self.messages)
        events = tuple(each for part in parts for each in part.take_events())
        batteries, mute = self.messages.batteries(self.settings.watch, now)
        statuses, held = (*self._statuses(), *batteries), frozenset(self._held | mute)
        expected, logs = self._nodes.expected, self.messages.recent(now)
        feed, watched = self._feed(now), self.watched
        lossy = self.lossy and not feed.shadow  # of a shadow's link nobody is notified
        return Report(robot, feed, statuses, held, expected, lossy, events, logs, watched)

    def _release(self, now: Instant) -> None:
        """Once what it is about is known again, what is held and is no problem is well."""
        if self._held and self._held_until == inf:
            self._held_until = now.mono + HELD
        if now.mono >= self._held_until:
            is_late = now.mono >= self._held_until + UNREAD
            known = {each for each in self._held if is_late or self._topics.is_known(each)}
            self._well |= dict.fromkeys(known, now.mono)
            self._held -= known

    def _judge(self, now: Instant) -> dict[str, tuple[int, str]]:
        learn_after = self.settings.learn_after
        expected = filter(None, map(self._own, self.settings.expect))
        problems = self._nodes.judge(learn_after, expected, now)
        problems |= self.messages.judge(self.settings.watch, now)
        return problems | self._topics.judge(learn_after, self._there_since)

    def _there_since(self, node: str) -> float:
        """Since when a node is there, by its full name; of those of others nobody knows."""
        own = node.startswith(f"{self.namespace}/")
        return self._nodes.there_since(self._own(node)) if own else inf

    def _take(self, problems: dict[str, tuple[int, str]], now: Instant) -> None:
        for name in self._problems.keys() - problems.keys():
            self._well[name] = now.mono
        for name in problems:
            self._well.pop(name, None)
            self._held.discard(name)
        if problems.keys() != self._problems.keys():
            self.write_at = now.mono
        self._problems = problems

    def _judge_link(self) -> bool:
        """Faulty above ``max_loss``, well again below half of it; whether that changed."""
        link, before = self._link, self.lossy
        if link is not None and link.expected >= LEAST_MESSAGES:
            self.lossy = link.loss > self.settings.max_loss * (0.5 if before else 1.0)
        return self.lossy != before

    def _feed(self, now: Instant) -> Feed:
        mode = self.settings.mode
        young = mode == "auto" and now.wall - self.known < SHADOW_TIME
        return SHADOW if young or mode == "shadow" else GRAPH

    def _statuses(self) -> Iterator[Status]:
        for name, (level, text) in sorted(self._problems.items()):
            yield Status(level, name, text)
        for name in sorted(self._well.keys() - self._problems.keys()):
            yield Status(int(Level.OK), name, "OK")

    # -- by a person -----------------------------------------------------------------------------

    def accept(self, now: Instant) -> int:
        """Take what is there as expected, and be no shadow any more; how many nodes are expected.

        What is faulty now is well.
        """
        self._nodes.accept(self.settings.learn_after)
        self._topics.accept(self.settings.learn_after)
        self.messages.accept()
        self.known = min(self.known, now.wall - SHADOW_TIME)
        self.report_at = self.write_at = now.mono
        return self._nodes.expected

    def forget(self, component: str, now: Instant) -> None:
        """Expect no more what a component is about."""
        self._nodes.forget(component)
        self._topics.forget(component, self.settings.learn_after)
        self.messages.forget(component)
        self._problems.pop(component, None)
        self._well.pop(component, None)
        self._held.discard(component)
        self.report_at = self.write_at = now.mono

    # -- outliving the process ---------------------------------------------------------------

    def learned(self, now: Instant) -> Learned:
        """What a later process should know."""
        shown = sorted(self._problems.keys() | self._well.keys() | self._held)
        accepted: list[Any] = self._topics.accepted()  # a Mismatch is a tuple of texts
        nodes, topics = self._nodes.learned(now), self._topics.learned(shown)
        return Learned(self.known, nodes, topics, shown, accepted, self.messages.learned(now))

    def restore(self, learned: Learned, now: Instant) -> None:
        """Go on from what an earlier process knew."""
        self.met, self.known = True, min(learned.known, now.wall)
        self._nodes.restore(learned.nodes, now)
        topics = {name: TopicLearned(*each) for name, each in learned.topics.items()}
        accepted = [(name, Mismatch(*each)) for name, each in learned.accepted]
        self._topics.restore(topics, accepted)
        self.messages.restore(MessagesLearned(*learned.messages), now)
        self._held = set(learned.shown)


class GraphWatch:
    """What is seen of all robots."""

    def __init__(self) -> None:
        self._robots: dict[str, RobotGraph] = {}
        self._restored: dict[str, Learned] = {}
        self._owners: dict[Domain, _Owners] = {}
        self._nodes: dict[Domain, list[tuple[str, str]]] = {}
        self._wanted: dict[Domain, dict[str, str]] = {}  # topics beside diagnostics -> type
        self._given_up: dict[tuple[Domain, str], float] = {}  # topics, until when
        self._gone: set[str] = set()  # robots whose rows are to be deleted
        self._left: set[str] = set()  # ... of which nothing is to be said any more

    def follow(self, domain: Domain, robots: Iterable[Robot], now: Instant) -> None:
        """Take the robots of a domain as they are now; each has what is in its namespace."""
        robots, former = tuple(robots), self._owners.get(domain)
        if former is not None and former.robots == robots:
            return
        owners = self._owners[domain] = _Owners(robots)
        self._nodes.pop(domain, None)  # they may be other robots' now
        names = {name for each in self._owners.values() for name in each.by_name}
        for name in [name for name in self._robots if name not in names]:
            del self._robots[name]
            self._gone.add(name)
            self._left.add(name)
        for name, settings in owners.by_name.items():
            graph, namespace = settings.profile.graph, settings.namespace
            if name in self._robots:
                self._robots[name].follow(graph, namespace)
                continue
            made = self._robots[name] = RobotGraph(graph, namespace, now)
            self._gone.discard(name)
            if (learned := self._restored.pop(name, None)) is not None:
                made.restore(learned, now)

    def watches(self, domain: Domain) -> bool:
        """Whether any robot of a domain is watched."""
        return bool(self._owners[domain].by_name)

    def see_nodes(self, domain: Domain, nodes: list[tuple[str, str]], now: Instant) -> None:
        """Take the name and namespace of all nodes of a domain."""
        if self._nodes.get(domain) == nodes:
            return
        self._nodes[domain] = nodes
        owners = self._owners[domain]
        found: dict[str, list[str]] = {name: [] for name in owners.by_name}
        for name, namespace in nodes:
            full = f"{namespace.rstrip('/')}/{name}"
            if (robot := owners.of(full)) is not None:
                found[robot].append(full)
        for robot, names in found.items():
            self._robots[robot].see_nodes(names, now)

    def see_topics(self, domain: Domain, topics: Mapping[str, TopicView], now: Instant) -> None:
        """Take some topics of a domain."""
        for name, view in topics.items():
            if (robot := self._owners[domain].of(name)) is not None:
                self._robots[robot].see_topic(name, view, now)

    # -- messages that fleet.yml asks for ------------------------------------------------------

    def wanted(
        self, domain: Domain, types: Mapping[str, Sequence[str]], now: Instant
    ) -> dict[str, str]:
        """The topics of a domain to be subscribed beside diagnostics, with their types."""
        for key, until in list(self._given_up.items()):
            if now.mono >= until:
                del self._given_up[key]
                for robot in self._robots.values():
                    robot.messages.given_up.pop(key, None)
        wanted = self._wanted[domain] = {
            name: kind
            for name, kinds in types.items()
            for kind in kinds
            if (domain, name) not in self._given_up and any(self._asking(domain, name, kind))
        }
        return wanted

    def _asking(self, domain: Domain, name: str, kind: str) -> Iterator[str]:
        """The robots that ask for a topic of this type."""
        owners = self._owners[domain]
        own = owners.of(name)
        for robot in owners.by_name if name in GLOBAL else [own] if own else ():
            if is_wanted(name, kind, self._robots[robot].settings.watch):
                yield robot

    def owner(self, domain: Domain, topic: str, kind: str, data: bytes) -> str | None:
        """The robot that a serialized message of such a topic is of, if it asks for such."""
        robot = self._owners[domain].of(node_in(topic, kind, data))
        if robot is not None and is_wanted(topic, kind, self._robots[robot].settings.watch):
            return robot
        return None

    def see_message(self, domain: Domain, topic: str, message: Message, now: Instant) -> None:
        """Take a message of such a topic."""
        node = node_of(topic, message)
        robot = self._owners[domain].of(node)
        if robot is not None:
            self._robots[robot].see_message(node, message, now)

    def note_watched(self, domain: Domain, rates: Mapping[str, float], now: Instant) -> None:
        """Take how many bytes per second such topics are; give up what is beyond the budget."""
        asking = {
            topic: [*self._asking(domain, topic, kind)]
            for topic, kind in self._wanted.get(domain, {}).items()
        }
        shares: dict[str, dict[str, float]] = {}
        for topic, robots in asking.items():
            for name in robots:
                shares.setdefault(name, {})[topic] = rates.get(topic, 0.0) / len(robots)
        for name in self._owners[domain].by_name:
            robot, own = self._robots[name], shares.get(name, {})
            if not own and robot.watched is None:
                continue
            robot.watched, robot.report_at = sum(own.values()), now.mono
            most = robot.settings.watch.bytes_per_second
            for topic in over_budget(own, most):
                self._given_up[domain, topic] = now.mono + TRY_AGAIN
                why = f"{topic} is given up: {own[topic]:.0f} B/s of at most {most}"
                for each in asking[topic]:
                    self._robots[each].messages.given_up[domain, topic] = why

    def see_links(self, readings: Mapping[str, LinkReading | None], now: Instant) -> None:
        """Take what arrived of late of some robots, by name."""
        for robot, reading in readings.items():
            if robot in self._robots:
                self._robots[robot].see_link(reading, now)

    def reports(self, domain: Domain, now: Instant) -> Iterator[Report]:
        """What is to be said now of the robots of a domain."""
        while self._left:
            yield Report(self._left.pop(), GRAPH, (), frozenset(), None, lossy=False)
        for name in self._owners[domain].by_name:
            robot = self._robots[name]
            if now.mono >= robot.report_at:
                report = robot.report(name, now)
                if report is not None:
                    yield report

    # -- by a person -----------------------------------------------------------------------------

    def accept(self, robot: str, now: Instant) -> int:
        """Take what is there of a robot as expected; how many nodes are expected.

        Raises:
            LookupError: nothing of such a robot was ever seen in the graph.
        """
        if robot not in self._robots or not self._robots[robot].met:
            raise LookupError(f"nothing of robot {robot!r} was seen in the ROS graph")
        return self._robots[robot].accept(now)

    def forget(self, robot: str, component: str, now: Instant) -> None:
        """Expect no more what a component of a robot is about."""
        if robot in self._robots:
            self._robots[robot].forget(component, now)

    # -- outliving the process ---------------------------------------------------------------

    def take_rows(self, now: Instant) -> Iterator[tuple[str, dict[str, object] | None]]:
        """By robot what is to be written now; None: to be deleted."""
        for name in self._gone:
            yield name, None
        self._gone = set()
        for name, robot in self._robots.items():
            if robot.met and now.mono >= robot.write_at:
                robot.write_at = now.mono + WRITTEN
                yield name, robot.learned(now)._asdict()

    def restore(self, rows: Mapping[str, Any]) -> None:
        """Go on from these rows; those of robots that are not wanted are deleted."""
        self._restored = {name: Learned(**fields) for name, fields in rows.items()}


class _Owners:
    """Which robot of a domain a name belongs to: the one with the longest namespace of it.

    What is in the namespace of several, or of one that is not watched, is of none.
    """

    def __init__(self, robots: tuple[Robot, ...]) -> None:
        self.robots = robots
        taken = Counter(each.namespace for each in robots)
        self.by_name = {
            each.name: each
            for each in robots
            if taken[each.namespace] == 1 and each.profile.graph.mode != "off"
        }
        self._by_namespace = {
            each.namespace: each.name if each.name in self.by_name else None for each in robots
        }

    def of(self, name: str) -> str | None:
        """The robot that a node or topic belongs to."""
        while name:
            name = name.rpartition("/")[0]
            if name in self._by_namespace:
                return self._by_namespace[name]
        return None
