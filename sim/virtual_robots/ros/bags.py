"""Recordings on ROS topics: playback and recording of serialized messages.

recording/bags.py reads and writes the files.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Mapping
from fnmatch import fnmatchcase
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy

from virtual_robots.recording.bags import ARRAY, STATUS, Recorded
from virtual_robots.ros.contexts import quiet_node

MESSAGE_TYPES = {ARRAY: DiagnosticArray, STATUS: DiagnosticStatus}
# Queue depth: larger than a robot's, so that no recorded message is lost here.
QUEUE_DEPTH = 1000
FIND_TOPICS_EVERY = 0.5
CHECK_SUBSCRIBERS_EVERY = 0.05


class Playback:
    """Publishers for the topics of recorded messages.

    ``topics`` are recorded topic -> type; ``renamed`` gives the topic to publish a recorded one on.
    """

    def __init__(
        self, context: Context, topics: Mapping[str, str], renamed: Callable[[str], str]
    ) -> None:
        self._node = quiet_node("virtual_robots_replay", context)
        self._publishers = {
            topic: self._node.create_publisher(
                MESSAGE_TYPES[kind], renamed(topic), QoSProfile(depth=QUEUE_DEPTH)
            )
            for topic, kind in topics.items()
        }

    def wait_for_subscribers(self, seconds: float, stop: threading.Event) -> bool:
        """Wait until each topic has one; False if that took longer or ``stop`` was set."""
        end = time.monotonic() + seconds
        while not all(p.get_subscription_count() for p in self._publishers.values()):
            if time.monotonic() >= end or stop.wait(CHECK_SUBSCRIBERS_EVERY):
                return False
        return True

    def play(self, messages: Iterable[Recorded], rate: float, stop: threading.Event) -> int:
        """Publish the messages with their recorded intervals, ``rate`` times as fast.

        Returns how many were published before they ended or ``stop`` was set.
        """
        started, first, count = time.monotonic(), None, 0
        for message in messages:
            first = message.at if first is None else first
            due = started + (message.at - first) / 1e9 / rate
            if stop.wait(max(0.0, due - time.monotonic())):
                break
            self._publishers[message.topic].publish(message.data)
            count += 1
        return count

    def close(self) -> None:
        """Leave the graph, when the last messages have arrived (or after some seconds)."""
        for publisher in self._publishers.values():
            publisher.wait_for_all_acked(Duration(seconds=5))
        self._node.destroy_node()


class Recorder:
    """Calls ``write`` with each diagnostic message of a domain on topics that match ``patterns``.

    Topics that appear later are found too. A subscription is reliable if all its publishers are,
    as in ros2 bag.
    """

    def __init__(
        self, context: Context, patterns: Iterable[str], write: Callable[[Recorded], None]
    ) -> None:
        self._node = quiet_node("virtual_robots_record", context)
        self._patterns = list(patterns)
        self._write = write
        self._topics: dict[str, Any] = {}
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self._node)
        self._node.create_timer(FIND_TOPICS_EVERY, self._find_topics)
        self._find_topics()

    def record(self, stop: threading.Event, until: float = float("inf")) -> None:
        """Record until ``stop`` is set or ``until`` seconds have passed."""
        end = time.monotonic() + until
        while not stop.is_set() and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=min(0.2, max(0.0, end - time.monotonic())))

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()

    def _find_topics(self) -> None:
        for topic, kinds in self._node.get_topic_names_and_types():
            kind = kinds[0]
            wanted = any(fnmatchcase(topic, pattern) for pattern in self._patterns)
            if wanted and kind in MESSAGE_TYPES and topic not in self._topics:
                self._topics[topic] = self._subscribe(topic, kind)

    def _subscribe(self, topic: str, kind: str) -> Any:
        def on_message(data: bytes) -> None:
            self._write(Recorded(time.time_ns(), topic, kind, data))

        offered = self._node.get_publishers_info_by_topic(topic)
        reliable = all(p.qos_profile.reliability == ReliabilityPolicy.RELIABLE for p in offered)
        reliability = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        qos = QoSProfile(depth=QUEUE_DEPTH, reliability=reliability)
        return self._node.create_subscription(MESSAGE_TYPES[kind], topic, on_message, qos, raw=True)
