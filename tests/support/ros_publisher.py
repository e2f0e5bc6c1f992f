"""Publishes arrays on real topics, from the test process itself."""

import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from ros_diagnostics_exporter.model import Status
from testbed.polling import until


def message(statuses: Sequence[Status]) -> DiagnosticArray:
    return DiagnosticArray(
        status=[
            DiagnosticStatus(
                level=bytes([status.level]),
                name=status.name,
                message=status.message,
                hardware_id=status.hardware_id,
                values=[KeyValue(key=key, value=value) for key, value in status.values],
            )
            for status in statuses
        ]
    )


class Publisher:
    """A node of its own in one domain; topics are made as they are used."""

    def __init__(self, domain_id: int) -> None:
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain_id)
        self._node = rclpy.create_node("robots", context=self._context)
        self._publishers = {}

    def offer(
        self,
        topic: str,
        *,
        reliable: bool = True,
        latched: bool = False,
        kind=DiagnosticArray,
        depth: int = 1000,
    ):
        """A publisher that a subscription has matched."""
        profile = QoSProfile(
            depth=depth,
            reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        self._publishers[topic] = self._node.create_publisher(kind, topic, profile)
        return self._publishers[topic]

    def listeners(self, topic: str) -> int:
        return self._publishers[topic].get_subscription_count()

    def wait_for_listeners(self) -> None:
        for topic in self._publishers:
            until(lambda each=topic: self.listeners(each), f"{topic} is subscribed")

    def wait_for_acknowledgements(self) -> None:
        """Until every subscription has what was sent: a publisher that ends drops the rest."""
        second = Duration(seconds=1)
        for topic, sent in self._publishers.items():
            until(lambda each=sent: each.wait_for_all_acked(second), f"{topic} is acknowledged")

    def send(self, topic: str, *statuses: Status) -> None:
        self._publishers[topic].publish(message(statuses))

    def send_bytes(self, topic: str, data: bytes) -> None:
        self._publishers[topic].publish(data)

    def withdraw(self, topic: str) -> None:
        self._node.destroy_publisher(self._publishers.pop(topic))

    def close(self) -> None:
        self._node.destroy_node()
        self._context.try_shutdown()


@contextmanager
def publisher(domain_id: int) -> Iterator[Publisher]:
    """A publisher that is gone at the end."""
    made = Publisher(domain_id)
    try:
        yield made
    finally:
        made.close()


@contextmanager
def repeating(send: Callable[[int], object], period: float) -> Iterator[None]:
    """Call ``send`` with 1, 2, 3, ... every ``period`` seconds, in a thread of its own."""
    stop = threading.Event()

    def work() -> None:
        turn = 0
        while not stop.wait(period):
            turn += 1
            send(turn)

    thread = threading.Thread(target=work)
    thread.start()
    try:
        yield
    finally:
        stop.set()
        thread.join()
