"""Robots with many nodes and topics, of which only the diagnostics are ever published."""

from __future__ import annotations

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_msgs.msg import String

from bench.actors.pace import ticks
from bench.actors.publishing import topic_of
from bench.robots import aggregated_array
from support.ros_publisher import message


def publish_graph(domain_id: int, robots: range, topics: int, nodes: int, seconds: float) -> None:
    """Be robots with so many nodes each, on which ``topics`` are spread; an array once a second.

    Each topic is published by one node and subscribed by the next.
    """
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    kept: list[object] = []
    senders = []
    for robot in robots:
        made = [_node(context, topic_of(robot).rpartition("/")[0], each) for each in range(nodes)]
        senders.append(made[0].create_publisher(DiagnosticArray, topic_of(robot), 10))
        for topic in range(topics - 1):
            kept.append(made[topic % nodes].create_publisher(String, f"topic_{topic}", 1))
            kept.append(_subscribe(made[(topic + 1) % nodes], f"topic_{topic}"))
        kept += made
    array = message(aggregated_array(0).statuses)
    print(f"{len(kept)} nodes and endpoints", flush=True)
    for tick, _late in ticks(len(senders), seconds):
        senders[tick % len(senders)].publish(array)


def _node(context: Context, namespace: str, number: int) -> Node:
    return rclpy.create_node(
        f"node_{chr(ord('a') + number)}",
        namespace=namespace,
        context=context,
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter("start_type_description_service", value=False)],
    )


def _subscribe(node: Node, topic: str) -> object:
    return node.create_subscription(String, topic, lambda _message: None, 1)
