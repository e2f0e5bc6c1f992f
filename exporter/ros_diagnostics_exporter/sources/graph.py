"""What the ROS graph shows of all robots: to each what is in its namespace. Pure: no ROS."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import Any

from ros_diagnostics_exporter.config.fleet import Robot
from ros_diagnostics_exporter.config.missions import rule_for
from ros_diagnostics_exporter.decode.messages import MessageTypes
from ros_diagnostics_exporter.model import Domain, Instant, Status
from ros_diagnostics_exporter.sources.action_servers import (
    GOALS_TYPE,
    STATUS,
    ActionServer,
    ActionServers,
)
from ros_diagnostics_exporter.sources.graph_messages import (
    LOGS,
    PARAMETERS,
    Message,
    is_wanted,
    node_in,
    node_of,
    over_budget,
)
from ros_diagnostics_exporter.sources.graph_topics import TopicView
from ros_diagnostics_exporter.sources.link import LinkReading
from ros_diagnostics_exporter.sources.robot_graph import (
    GRAPH,
    WRITTEN,
    Learned,
    Report,
    RobotGraph,
)
from ros_diagnostics_exporter.sources.topic_entries import (
    MAX_BYTES,
    Reading,
    TopicEntries,
    by_robot,
)

GLOBAL = (LOGS, PARAMETERS)  # topics of every node
TRY_AGAIN = 3600.0  # seconds after which what was given up is subscribed again
CLAIMED = 3600.0  # ... that a robot has to come back after a start, until its row is deleted


class GraphWatch:
    """What is seen of all robots."""

    def __init__(self) -> None:
        self._robots: dict[str, RobotGraph] = {}
        self._restored: dict[str, Learned] = {}
        self._restored_at = 0.0
        self._owners: defaultdict[Domain, _Owners] = defaultdict(lambda: _Owners(()))
        self.folder: Path | None = None  # of definitions, beside fleet.yml
        self._types: MessageTypes | None = None  # None: none was needed yet
        self._entries: defaultdict[Domain, TopicEntries] = defaultdict(TopicEntries)
        self._nodes: dict[Domain, list[tuple[str, str]]] = {}
        self._wanted: dict[Domain, dict[str, str]] = {}  # topics beside diagnostics -> type
        self._given_up: dict[tuple[Domain, str], float] = {}  # topics, until when
        # To be subscribed anew, as other entries read them: what is kept for late joiners is sent.
        self._anew: dict[Domain, set[str]] = {}
        self._gone: set[str] = set()  # robots whose rows are to be deleted
        self._left: set[str] = set()  # ... of which nothing is to be said any more
        # Of action servers: the topics of which they were chosen, and those that were.
        self._chosen: dict[Domain, tuple[_Owners, list[str], dict[str, str]]] = {}

    @cached_property
    def servers(self) -> ActionServers:
        """The action servers of all robots: made for the first look at a graph."""
        return ActionServers()

    def set_robots(self, domain: Domain, robots: Iterable[Robot], now: Instant) -> None:
        """Take the robots of a domain as they are now; each has what is in its namespace."""
        robots = tuple(robots)
        if self._owners[domain].robots == robots:
            return
        owners = self._owners[domain] = _Owners(robots)
        self._nodes.pop(domain, None)  # they may be other robots' now
        former = self._entries[domain]
        entries = self._entries[domain] = TopicEntries(owners.by_name.values())
        self._anew.setdefault(domain, set()).update(entries.changed(former))
        self._drop_others()
        for name, settings in owners.by_name.items():
            graph, namespace = settings.profile.graph, settings.namespace
            if name in self._robots:
                self._robots[name].configure(graph, namespace, now)
                self._robots[name].forget_unread(now)
                continue
            made = self._robots[name] = RobotGraph(graph, namespace, now)
            self._gone.discard(name)
            if (learned := self._restored.pop(name, None)) is not None:
                made.restore(learned, now)

    def configure(self, domains: Container[Domain]) -> list[Domain]:
        """Drop the robots of all domains but these; returns those of which robots were set.

        Definitions of types are read again: somebody may have put others beside fleet.yml.
        """
        self._types = None
        for domain in [each for each in self._owners if each not in domains]:
            for known in (self._owners, self._nodes, self._wanted, self._entries):
                known.pop(domain, None)
            self._chosen.pop(domain, None)
            self.servers.choose(domain, {})
        self._drop_others()
        return list(self._owners)

    def _drop_others(self) -> None:
        """Drop the robots that no domain has any more."""
        names = {name for each in self._owners.values() for name in each.by_name}
        for name in self._robots.keys() - names:
            del self._robots[name]
            self._gone.add(name)
            self._left.add(name)

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
        self.servers.see_topics(domain, topics.items(), now.mono)
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
        wanted = {
            name: kind
            for name, kinds in types.items()
            for kind in kinds
            if kind != GOALS_TYPE
            and (domain, name) not in self._given_up
            and any(self._asking(domain, name, kind))
        }
        entries, anew = self._entries[domain], self._anew.pop(domain, ())
        for name, kind in list(wanted.items()):
            if name in anew:
                del wanted[name]
            elif why := entries.refusal(name, kind):
                del wanted[name]
                self._note(domain, entries.notes(name, why), now)
        publishing = entries.publishing(types)
        for name in self._owners[domain].by_name:
            self._robots[name].has_topics = name in publishing
        self._note(domain, entries.unseen(types, self.present(domain), now), now)
        goals = self._goal_topics(domain, types)
        found = self._wanted[domain] = wanted | goals if wanted else goals
        return found

    def _goal_topics(self, domain: Domain, types: Mapping[str, Sequence[str]]) -> dict[str, str]:
        """The topics of the action servers that are chosen; chosen anew where anything changed."""
        given_up, owners = self._given_up, self._owners[domain]
        topics = [
            name
            for name, kinds in types.items()
            if GOALS_TYPE in kinds and not (given_up and (domain, name) in given_up)
        ]
        if not topics and domain not in self._chosen:
            return {}
        known = self._chosen.get(domain)
        if known is None or known[:2] != (owners, topics):
            servers = {topic: each for topic in topics if (each := self._server(owners, topic))}
            chosen = dict.fromkeys(self.servers.choose(domain, servers), GOALS_TYPE)
            known = self._chosen[domain] = owners, topics, chosen
        return known[2]

    def _server(self, owners: _Owners, topic: str) -> ActionServer | None:
        """The server of a topic; None where it is of no robot, or the config ignores it."""
        robot = owners.by_name.get(owners.of(topic) or "")
        if robot is None or not topic.endswith(STATUS):
            return None
        action = self._robots[robot.name].action_of(topic)
        if not action:
            return None
        rule = rule_for(robot.profile.actions, robot.namespace, action)
        return ActionServer(robot.name, action, is_named=rule is not None)

    def _asking(self, domain: Domain, name: str, kind: str) -> Iterator[str]:
        """The robots that ask for a topic of this type."""
        owners = self._owners[domain]
        own = owners.of(name)
        for robot in owners.by_name if name in GLOBAL else [own] if own else ():
            if is_wanted(name, kind, self._robots[robot].settings.watch):
                yield robot
        yield from self._entries[domain].robots(name)

    @property
    def types(self) -> MessageTypes:
        """The types of messages that are known."""
        if self._types is None:
            self._types = MessageTypes(self.folder)
        return self._types

    def present(self, domain: Domain) -> set[str]:
        """The robots of which a node is there."""
        return {name for name in self._owners[domain].by_name if self._robots[name].is_there}

    def gone_nodes(self, domain: Domain) -> list[str]:
        """The full names of the nodes of a domain of which it is a problem that they are gone."""
        robots = (self._robots[name] for name in self._owners[domain].by_name)
        return [node for robot in robots for node in robot.gone_nodes]

    def see_offered(self, domain: Domain, topics: Iterable[str]) -> None:
        """Take what is published in a domain of which no nodes are seen."""
        offered = {self._owners[domain].of(each) for each in topics}
        for name in self._owners[domain].by_name:
            self._robots[name].is_offered = name in offered

    def _note(self, domain: Domain, readings: Iterable[Reading], now: Instant) -> None:
        """Have robots say why an entry of theirs has no status, or that it has one again."""
        for each in readings:
            why = each.why and f"{each.component}: {each.why}"
            self._robots[each.robot].note_unread((domain, each.component), why, now)

    def offered(self, domain: Domain, topic: str, kind: str, type_hash: str, now: Instant) -> bool:
        """Whether a topic is read whose publishers offer this definition of its type."""
        if kind == GOALS_TYPE:
            return True  # all distributions have the same
        entries = self._entries[domain]
        why = entries.offer_refusal(kind, type_hash, self.types)
        self.refuse(domain, topic, why, now)
        return not why

    def refuse(self, domain: Domain, topic: str, why: str, now: Instant) -> None:
        """Note why a small topic is not read; "": it is."""
        self._note(domain, self._entries[domain].notes(topic, why), now)

    def see_fields(
        self, domain: Domain, topic: str, kind: str, data: bytes, now: Instant
    ) -> Mapping[str, list[Status]]:
        """The statuses, by robot, that a serialized message of a small topic is for its entries."""
        entries = self._entries[domain]
        if len(data) > MAX_BYTES:
            why = f"{topic} is given up: {len(data)} bytes, of at most {MAX_BYTES} of a message"
            self._given_up[domain, topic] = now.mono + TRY_AGAIN
            for robot in entries.robots(topic):
                self._robots[robot].note_unread((domain, topic), why, now)
            return {}
        readings = list(entries.read(topic, kind, data, self.types, now))
        self._note(domain, readings, now)
        return by_robot(readings)

    def due(self, domain: Domain, topic: str) -> float:
        """When a small topic is read again, monotonic."""
        return self._entries[domain].due(topic)

    def owner(self, domain: Domain, topic: str, kind: str, data: bytes) -> str | None:
        """The robot that a serialized message of such a topic is of, if it asks for such."""
        if kind == GOALS_TYPE:
            server = self.servers.find(domain, topic)
            return server.robot if server is not None and server.is_named else None
        for asking in self._entries[domain].robots(topic):
            return asking
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
                    unread = self._entries[domain].components(name, robot.messages.given_up)
                    yield report._replace(unread=unread)

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

    def adopt(self, robot: str, component: str, text: str, now: Instant) -> None:
        """Go on with a problem of a robot that another process knew."""
        if robot in self._robots:
            self._robots[robot].adopt(component, text, now)

    # -- outliving the process ---------------------------------------------------------------

    def take_rows(
        self, known: Container[str], now: Instant
    ) -> Iterator[tuple[str, dict[str, object] | None]]:
        """By robot what is to be written now; None: to be deleted.

        What an earlier process wrote of a robot that is not ``known`` is deleted after a time.
        """
        if now.mono >= self._restored_at + CLAIMED:
            for name in [each for each in self._restored if each not in known]:
                del self._restored[name]
                self._gone.add(name)
        for name in self._gone:
            yield name, None
        self._gone = set()
        for name, robot in self._robots.items():
            if robot.met and now.mono >= robot.write_at:
                robot.write_at = now.mono + WRITTEN
                yield name, robot.learned(now)._asdict()

    def restore(self, rows: Mapping[str, Any], now: Instant) -> None:
        """Keep these rows until their robots are seen: each then goes on from its own."""
        self._restored_at = now.mono
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
