"""A program: a second participant of a domain, which says what it finds of some topics and nodes.

    python -m ros_diagnostics_exporter.sources.dds_second DOMAIN SECONDS WANTED... [--ros-args ...]

WANTED is a topic, or "node " and the full name of a node. It prints each topic of which a message
arrives and each node that is there, and ends when all are, or after so many seconds.
It is a process of its own because what is wrong with one participant may be wrong with all that
share its process: Cyclone DDS has one network in it for each domain, Fast DDS one shared memory.
"""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Sequence

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.node import Node

from ros_diagnostics_exporter.sources.dds import NODE_NAME, make_guest, quality
from ros_diagnostics_exporter.sources.dds_names import list_nodes
from ros_diagnostics_exporter.sources.dds_subscription import Subscriber
from ros_diagnostics_exporter.sources.graph_nodes import NODE
from ros_diagnostics_exporter.sources.ros_environment import split_arguments

JOINED = 30  # seconds in which it has to join; it is ended where that hangs


def main(arguments: Sequence[str]) -> None:
    """Print the topics that are received, and the nodes that are there."""
    (domain_id, seconds, *wanted), for_ros = split_arguments(arguments)
    signal.alarm(JOINED + int(float(seconds)))  # also where the exporter is gone
    context = Context()
    rclpy.init(args=list(for_ros), context=context, domain_id=int(domain_id))
    node = make_guest(f"_{NODE_NAME}_second", context)  # hidden, as tools are
    left = {each for each in wanted if each.startswith(NODE)}
    topics = (each for each in wanted if each not in left)
    subscriber, profile = Subscriber(node), quality(reliable=False, depth=1)
    takes = {each: subscriber.subscribe(DiagnosticArray, each, profile) for each in topics}
    until = time.monotonic() + float(seconds)
    while (left or takes) and time.monotonic() < until:
        found = {topic for topic, (_kept, take) in takes.items() if take() is not None}
        found |= left & _nodes(node) if left else set()
        sys.stdout.writelines(f"{each}\n" for each in sorted(found))
        sys.stdout.flush()
        left -= found
        takes = {topic: each for topic, each in takes.items() if topic not in found}
        time.sleep(0.1)
    node.destroy_node()
    context.try_shutdown()


def _nodes(node: Node) -> set[str]:
    """The nodes of the domain, as they are asked for."""
    named, _unnamed = list_nodes(node)
    return {f"{NODE}{namespace.rstrip('/')}/{name}" for name, namespace in named}


if __name__ == "__main__":
    main(sys.argv[1:])
