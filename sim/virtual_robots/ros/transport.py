"""The robots' publishers: nodes, DDS participants and domains, and the serialized messages."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from enum import Enum
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from virtual_robots.recording.cdr import encode_array, encode_status
from virtual_robots.ros.actions import ActionServers
from virtual_robots.ros.contexts import DomainError, check_domain_id, open_context, quiet_node
from virtual_robots.ros.messages import MessageTypes
from virtual_robots.simulation.outputs import (
    FieldMessage,
    GoalStep,
    Message,
    Output,
    Presence,
    Topic,
)

DRIVER_NODE = "virtual_robot_driver"
TYPES = {
    Topic.RAW: DiagnosticArray,
    Topic.AGGREGATED: DiagnosticArray,
    Topic.TOPLEVEL: DiagnosticStatus,
}


class Participants(Enum):
    """Who shares a DDS participant: the whole fleet, or each robot has its own, or its domain."""

    FLEET = "fleet"
    ROBOT = "robot"
    DOMAIN = "domain"


# With discovery on this machine only, Fast DDS tries the ports of this many participants
# (measured: of 60 robots 32 are found).
FOUND_ON_LOCALHOST = 32


def too_many_for_localhost(
    robots: int, participants: Participants, environment: Mapping[str, str]
) -> str:
    """Return a warning if some of the robots will not be discovered; empty otherwise."""
    local = environment.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == "LOCALHOST"
    if not local or participants is not Participants.ROBOT or robots < FOUND_ON_LOCALHOST:
        return ""
    return (
        f"with ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST only {FOUND_ON_LOCALHOST} DDS participants"
        f" find each other, so not all of {robots} robots will be discovered; set it to SUBNET"
    )


class Transport:
    """Publishes the outputs of a fleet.

    ``robots`` are all names that can appear; with DOMAIN the first has ``domain_id`` and each of
    the others the next one. Without ``aggregated`` they have their raw topic only: another program
    publishes the rest. Those ``without`` diagnostics have none of these topics. ``types`` are those
    of topics of their own; ``warn`` is called with a text when a goal cannot be sent. Raises
    DomainError if these are more domains than there are.
    """

    def __init__(
        self,
        robots: list[str],
        domain_id: int,
        participants: Participants,
        types: MessageTypes,
        warn: Callable[[str], None],
        *,
        aggregated: bool = True,
        without: Collection[str] = (),
    ) -> None:
        self._topics = tuple(Topic) if aggregated else (Topic.RAW,)
        self._types, self._warn = types, warn
        step = 1 if participants is Participants.DOMAIN else 0
        last = domain_id + step * (len(robots) - 1)
        try:
            check_domain_id(last)
        except DomainError as error:
            raise DomainError(
                f"{len(robots)} robots in a domain each, from {domain_id}, need domain {last}:"
                f" {error}; start lower or with fewer robots"
            ) from error
        self._domains = {name: domain_id + step * i for i, name in enumerate(robots)}
        self._shared: tuple[Context, Node] | None = None
        if participants is Participants.FLEET:
            self._shared = _open(domain_id, f"{DRIVER_NODE}s", None)
        self._own: dict[str, tuple[Context, Node]] = {}
        self._actions: dict[Node, ActionServers] = {}
        self._without = frozenset(without)
        self._present: set[str] = set()
        self._publishers: dict[tuple[str, str], Any] = {}  # by robot and topic

    def publish(self, output: Output, started: float) -> None:
        """Publish a message or change the graph; ``started``: Unix time of the fleet's start."""
        if isinstance(output, Message):
            self._publish(output, started)
        elif isinstance(output, FieldMessage):
            self._publish_fields(output)
        elif isinstance(output, GoalStep):
            node = self._node_of(output.robot)
            if node not in self._actions:
                self._actions[node] = ActionServers(node, self._warn)
            self._actions[node].take(output.robot, output.action, output.step)
        elif isinstance(output, Presence):
            change = self.add if output.present else self.remove
            change(output.robot)

    def add(self, robot: str) -> None:
        """Add the robot to the graph, if it is not there."""
        if robot in self._present:
            return
        self._present.add(robot)
        node = self._node_of(robot)
        # As upstream: reliable, volatile, and the last message only.
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        for topic in () if robot in self._without else self._topics:
            name = f"/{robot}/{topic.value}"
            self._publishers[robot, topic.value] = node.create_publisher(TYPES[topic], name, qos)

    def remove(self, robot: str) -> None:
        """Remove the robot from the graph at once, without waiting for its lease."""
        self._present.discard(robot)
        for key in [each for each in self._publishers if each[0] == robot]:
            publisher = self._publishers.pop(key)
            if self._shared is not None:
                self._shared[1].destroy_publisher(publisher)
        if self._shared is not None and self._shared[1] in self._actions:
            self._actions[self._shared[1]].remove(robot)
        if robot in self._own:
            self._close(*self._own.pop(robot))

    def close(self) -> None:
        """Remove all robots from the graph."""
        for context, node in self._own.values():
            self._close(context, node)
        if self._shared is not None:
            self._close(*self._shared)

    def _publish(self, message: Message, started: float) -> None:
        if message.topic is Topic.TOPLEVEL:
            data = encode_status(message.statuses[0])
        else:
            data = encode_array(message.statuses, started + message.stamp)
        self._publishers[message.robot, message.topic.value].publish(data)

    def _publish_fields(self, message: FieldMessage) -> None:
        kind, key = message.topic.type, (message.robot, message.topic.topic)
        if key not in self._publishers:
            kept = DurabilityPolicy.TRANSIENT_LOCAL if message.topic.latched else None
            qos = QoSProfile(depth=1, durability=kept or DurabilityPolicy.VOLATILE)
            node = self._node_of(message.robot)
            found = self._types.publisher_type(kind)
            self._publishers[key] = node.create_publisher(found, "/" + "/".join(key), qos)
        self._publishers[key].publish(self._types.encode(kind, message.fields))

    def _node_of(self, robot: str) -> Node:
        if self._shared is not None:
            return self._shared[1]
        if robot in self._own:
            return self._own[robot][1]
        self._own[robot] = _open(self._domains[robot], DRIVER_NODE, f"/{robot}")
        return self._own[robot][1]

    def _close(self, context: Context, node: Node) -> None:
        if node in self._actions:
            self._actions.pop(node).close()
        node.destroy_node()
        context.try_shutdown()


def _open(domain_id: int, name: str, namespace: str | None) -> tuple[Context, Node]:
    context = open_context(domain_id)
    return context, quiet_node(name, context, namespace)
