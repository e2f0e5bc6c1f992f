"""The small topics of one domain's robots that fleet.yml asks for: which are read, and how. Pure.

A topic is read at most once in an entry's ``every``; what comes between is not decoded.
"""

from __future__ import annotations

from collections.abc import Container, Iterable, Iterator, Mapping
from typing import NamedTuple

from ros_diagnostics_exporter.config.profiles import Profile
from ros_diagnostics_exporter.config.robots import Robot
from ros_diagnostics_exporter.config.topics import TopicEntry
from ros_diagnostics_exporter.decode.messages import (
    MessageTypes,
    UndecodableError,
    UnknownTypeError,
)
from ros_diagnostics_exporter.model import Domain, Instant, Status
from ros_diagnostics_exporter.sources.action_servers import STATUS
from ros_diagnostics_exporter.sources.topic_fields import NoFieldError, status_of

MAX_BYTES = 16 << 10  # of one message
REFUSED_FOR = 30.0  # seconds until a topic that could not be read is asked for again
UNSEEN = 60.0  # seconds for which nobody publishes a topic, until that is said
# What is large or fast, or read in another way.
REFUSED = {
    **dict.fromkeys(
        (
            "sensor_msgs/msg/Image",
            "sensor_msgs/msg/CompressedImage",
            "sensor_msgs/msg/PointCloud",
            "sensor_msgs/msg/PointCloud2",
            "sensor_msgs/msg/LaserScan",
            "sensor_msgs/msg/MultiEchoLaserScan",
            "tf2_msgs/msg/TFMessage",
        ),
        "too large or too fast a type: publish the fields that you judge on a small topic",
    ),
    "diagnostic_msgs/msg/DiagnosticArray": "diagnostics, which are read without an entry",
    "rcl_interfaces/msg/Log": "read by graph.watch.logs, without an entry",
    "rcl_interfaces/msg/ParameterEvent": "read by graph.watch.parameters, without an entry",
    "lifecycle_msgs/msg/TransitionEvent": "read by graph.watch.transitions, without an entry",
}
_UNPUBLISHED = "nobody publishes it: correct topic in fleet.yml, or start its publisher"


def asked_names(profiles: Iterable[Profile]) -> frozenset[str]:
    """The small topics that profiles name, as in fleet.yml, and how the status of actions ends."""
    listed = tuple(profiles)
    names = {entry.topic for each in listed for entry in each.topics}
    return frozenset(names | {STATUS for each in listed if each.actions})


def ends_of(names: Iterable[str]) -> tuple[str, ...]:
    """How the full name of a topic ends that one of these names may mean."""
    return tuple(f"/{name.removeprefix('/')}" for name in names)


class Reading(NamedTuple):
    """What became of a message for one entry: a status, or why there is none."""

    robot: str
    component: str
    status: Status | None
    why: str = ""


class _Reader:
    """One entry of one robot; ``due`` is when a message is read again, monotonic."""

    __slots__ = ("due", "entry", "every", "robot", "unseen")

    def __init__(self, robot: Robot, entry: TopicEntry) -> None:
        self.robot, self.entry, self.due = robot.name, entry, 0.0
        # Of a robot without diagnostics it may be the only sign of life.
        self.every = min(entry.every, robot.profile.stale_after / 2)
        self.unseen: float | None = None  # since when nobody publishes it, monotonic


class TopicEntries:
    """The entries of the robots of one domain, by the full names of their topics."""

    def __init__(self, robots: Iterable[Robot] = ()) -> None:
        self._readers: dict[str, list[_Reader]] = {}
        for robot in robots:
            for entry in robot.profile.topics:
                name = entry.name_in(robot.namespace, robot.zenoh or "")
                self._readers.setdefault(name, []).append(_Reader(robot, entry))

    def changed(self, former: TopicEntries) -> set[str]:
        """The topics that both ask for, by other entries."""
        return {
            name
            for name, readers in former._readers.items()
            if name in self._readers
            and [(each.robot, each.entry) for each in readers]
            != [(each.robot, each.entry) for each in self._readers[name]]
        }

    def robots(self, topic: str) -> Iterable[str]:
        """The robots that ask for a topic."""
        return dict.fromkeys(each.robot for each in self._readers.get(topic, ()))

    def components(self, robot: str, unread: Iterable[tuple[Domain, str]]) -> frozenset[str]:
        """The components of a robot that are not read: by domain, these, and those of topics."""
        found = {about for _domain, about in unread}
        for topic in found & self._readers.keys():
            found |= {each.entry.component for each in self._readers[topic] if each.robot == robot}
        return frozenset(found)

    def publishing(self, topics: Container[str]) -> set[str]:
        """The robots of which any of the topics that are asked for is among these."""
        found = (readers for name, readers in self._readers.items() if name in topics)
        return {each.robot for readers in found for each in readers}

    def refusal(self, topic: str, kind: str) -> str:
        """Why a topic of this type is not read; "" where it is."""
        robots = sorted(self.robots(topic))
        if len(robots) > 1:
            both = f"{', '.join(robots[:-1])} and {robots[-1]}"
            return f"{both} ask for it, and it can belong to one only: give each robot its topic"
        return f"{kind} is {REFUSED[kind]}" if robots and kind in REFUSED else ""

    def offer_refusal(self, kind: str, type_hash: str, types: MessageTypes) -> str:
        """Why what publishers offer of a type is not read; ``type_hash``: of their definition."""
        try:
            known = types.find(kind)
        except UnknownTypeError as error:
            return str(error)
        if not (known.hash and type_hash.startswith("RIHS")) or known.hash == type_hash:
            return ""
        package, _, name = kind.split("/")
        return (
            f"its publisher has another definition of {kind} than the one that is installed here: "
            f"put the robot's into msg/{package}/{name}.msg beside fleet.yml"
        )

    def unseen(
        self, topics: Container[str], present: Container[str], now: Instant
    ) -> Iterator[Reading]:
        """The entries whose topics nobody has published for long, though their robots are there."""
        for name, readers in self._readers.items():
            if name in topics:
                continue
            for each in readers:
                if each.robot not in present:
                    each.unseen = None
                    continue
                each.unseen = now.mono if each.unseen is None else each.unseen
                if now.mono - each.unseen >= UNSEEN:
                    yield self._reading(name, each, _UNPUBLISHED)

    def notes(self, topic: str, why: str) -> Iterator[Reading]:
        """That a topic is not read, for each of its entries; "": it may be."""
        for each in self._readers.get(topic, ()):
            each.unseen = None
            yield self._reading(topic, each, why)

    def _reading(self, topic: str, reader: _Reader, why: str) -> Reading:
        return Reading(reader.robot, reader.entry.component, None, why and f"{topic}: {why}")

    def due(self, topic: str) -> float:
        """When a topic is read again, monotonic."""
        return min((each.due for each in self._readers.get(topic, ())), default=0.0)

    def read(
        self, topic: str, kind: str, data: bytes, types: MessageTypes, now: Instant
    ) -> Iterator[Reading]:
        """What a message of a topic is for the entries that are due."""
        due = [each for each in self._readers.get(topic, ()) if now.mono >= each.due]
        if not due:
            return
        try:
            known = types.find(kind)
            message = known.decode(data)
        except (UnknownTypeError, UndecodableError) as error:
            yield from self.notes(topic, str(error))
            return
        for each in due:
            # A look may come a little earlier than the one before.
            each.due, each.unseen = now.mono + 0.9 * each.every, None
            try:
                status = status_of(each.entry, message, known.constants)
            except NoFieldError as error:
                yield self._reading(topic, each, str(error))
            else:
                yield Reading(each.robot, each.entry.component, status)


def by_robot(readings: Iterable[Reading]) -> Mapping[str, list[Status]]:
    """The statuses that were made, by robot."""
    found: dict[str, list[Status]] = {}
    for each in readings:
        if each.status is not None:
            found.setdefault(each.robot, []).append(each.status)
    return found
