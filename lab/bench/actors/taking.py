"""A subscriber that takes a fleet's arrays as bytes and does nothing with them."""

from __future__ import annotations

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.event_handler import SubscriptionEventCallbacks

from bench.actors.pace import ticks
from bench.actors.publishing import topic_of

RATE = 10  # times a second that all topics are looked at, as the exporter does
DEPTH = 1000


def take_fleet(domain_id: int, robots: int, seconds: float) -> None:
    """Take what the fleet sends, and print once a second how many arrays that were."""
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    node = rclpy.create_node("taker", context=context, start_parameter_services=False)
    subscriptions = [
        node.create_subscription(
            DiagnosticArray,
            topic_of(robot),
            lambda _data: None,
            DEPTH,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        for robot in range(robots)
    ]
    taken = 0
    for tick, _late in ticks(RATE, seconds):
        for subscription in subscriptions:
            with subscription.handle:
                while subscription.handle.take_message(DiagnosticArray, True) is not None:
                    taken += 1
        if tick % RATE == 0:
            print(f"{taken} arrays taken", flush=True)
    node.destroy_node()
    context.try_shutdown()
