"""Subscriptions of which messages are taken as bytes; by rclpy, without its executors and events.

Imported once it is known that there is ROS.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription


def subscribe_bytes(
    node: Node, kind: Any, topic: str, profile: QoSProfile
) -> tuple[Subscription, Callable[[], Any]]:
    """A subscription, and what takes its next message; None where there is none.

    What is taken are the bytes, and what the middleware knows of the message. ``kind`` is the class
    of the messages.
    """
    subscription = node.create_subscription(
        kind,
        topic,
        _never_called,
        profile,
        raw=True,
        # Each event that rclpy would watch for is one more thing to wait for.
        event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
    )
    # Instead of rclpy's executors: they pass every subscription to the middleware before each
    # single message, which for 100 robots costs more than all else together.
    return subscription, partial(subscription.handle.take_message, kind, True)


def _never_called(_data: object) -> None:
    """Stand in for a subscription's callback: messages are taken, not delivered."""
