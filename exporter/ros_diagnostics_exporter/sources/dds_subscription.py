"""Subscriptions of which messages are taken as bytes; by rclpy, without its executors and events.

Imported once it is known that there is ROS.
"""

from __future__ import annotations

import ctypes
import sys
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any, NamedTuple

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from ros_diagnostics_exporter.sources.dds_names import Allocator, default_allocator

_RCL = ctypes.CDLL("librcl.so")
_NOTHING = 401  # RCL_RET_SUBSCRIPTION_TAKE_FAILED
_NO_NUMBER = 2**64 - 1
_GID = 16  # bytes of a publisher's name
_KEPT = 1 << 20  # bytes of the largest message for which memory is kept


class Taken(NamedTuple):
    """A message, its number and publisher, and when it was sent and received (Unix time in ns)."""

    data: bytes
    number: int | None
    sent: int
    received: int
    publisher: str


class _Serialized(ctypes.Structure):  # rcutils_uint8_array_t
    _fields_ = (
        ("data", ctypes.c_void_p),
        ("length", ctypes.c_size_t),
        ("capacity", ctypes.c_size_t),
        ("allocator", Allocator),
    )


class _Info(ctypes.Structure):  # rmw_message_info_t
    _fields_ = (
        ("sent", ctypes.c_int64),
        ("received", ctypes.c_int64),
        ("number", ctypes.c_uint64),
        ("received_as", ctypes.c_uint64),
        ("middleware", ctypes.c_void_p),
        ("publisher", ctypes.c_uint8 * _GID),
        ("is_local", ctypes.c_bool),
    )


class Subscriber:
    """Subscribes topics of a node and takes their messages, in one thread.

    By rcl: rclpy leaves out who sent a message. Its executors pass every subscription to the
    middleware before each single message, which for 100 robots costs more than all else together.
    """

    def __init__(self, node: Node) -> None:
        self.node = node
        self._message, self._info = _Serialized(allocator=default_allocator()), _Info()

    def subscribe(
        self, kind: Any, topic: str, profile: QoSProfile
    ) -> tuple[Subscription, Callable[[], Taken | None]]:
        """A subscription of messages of the class ``kind``, and what takes its next one.

        That returns None where nothing has arrived; to be called while there is the subscription.
        """
        subscription = self.node.create_subscription(
            kind,
            topic,
            _never_called,
            profile,
            raw=True,
            # Each event that rclpy would watch for is one more thing to wait for.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        pointer = ctypes.c_void_p(subscription.handle.pointer)
        arguments = pointer, ctypes.byref(self._message), ctypes.byref(self._info), None
        take = partial(_RCL.rcl_take_serialized_message, *arguments)
        return subscription, partial(self._take, take)

    def _take(self, take: Callable[[], int]) -> Taken | None:
        code = take()
        if code == _NOTHING:
            return None
        if code:
            ctypes.CDLL("librcutils.so").rcutils_reset_error()
            raise RuntimeError(f"the middleware cannot take a message: error {code}")
        message, info = self._message, self._info
        data = ctypes.string_at(message.data, message.length)
        if message.capacity > _KEPT:
            self.close()
        number = None if info.number == _NO_NUMBER else info.number
        return Taken(data, number, info.sent, info.received, publisher_name(info.publisher))

    def close(self) -> None:
        """Free the memory that is kept."""
        ctypes.CDLL("librcutils.so").rcutils_uint8_array_fini(ctypes.byref(self._message))


def _never_called(_data: object) -> None:
    """Stand in for a subscription's callback: messages are taken, not delivered."""


def publisher_name(gid: Iterable[int]) -> str:
    """The name of a publisher by its number in the middleware, the same object each time."""
    return sys.intern(bytes(gid).hex())
