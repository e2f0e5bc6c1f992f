"""Topics beside diagnostics that fleet.yml asks for: subscribed, taken, counted; by rclpy.

Imported by `dds` alone, once it knows that there is ROS.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from action_msgs.msg import GoalStatusArray
from lifecycle_msgs.msg import TransitionEvent
from rcl_interfaces.msg import Log as RosLog
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message

from ros_diagnostics_exporter.model import Domain, Instant
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE
from ros_diagnostics_exporter.sources.dds_fields import FieldTopics
from ros_diagnostics_exporter.sources.dds_subscription import Subscriber, Taken
from ros_diagnostics_exporter.sources.graph_messages import (
    LOG_TYPE,
    PARAMETERS_TYPE,
    TRANSITION_TYPE,
    Log,
    Message,
    Parameters,
    Transition,
)
from ros_diagnostics_exporter.sources.receiver import Receiver
from ros_diagnostics_exporter.sources.watched_bytes import WatchedBytes

KINDS = {
    LOG_TYPE: RosLog,
    PARAMETERS_TYPE: ParameterEvent,
    TRANSITION_TYPE: TransitionEvent,
    GOALS_TYPE: GoalStatusArray,
}

log = logging.getLogger(__name__)

DEPTH = 200  # messages of one topic that the middleware holds between two looks
LEVEL_AT, ERROR = 12, 40  # of a Log in CDR: behind 4 bytes of header and the stamp; the least
GOALS_DEPTH = 10  # ... of the goals of one action: each list has all that its server keeps
MAX_VALUE = 80  # characters of a parameter


class Watcher:
    """What is subscribed in one domain; looked at about once a second."""

    def __init__(self, domain: Domain, receiver: Receiver) -> None:
        self._domain, self._receiver = domain, receiver
        # Name -> type, subscription, what takes its next message.
        self._topics: dict[str, tuple[str, Any, Callable[[], Taken | None]]] = {}
        self._bytes = WatchedBytes()
        self._fields = FieldTopics(domain, receiver, self._bytes)
        self._looked_at = 0.0  # monotonic

    def look(
        self, subscriber: Subscriber, types: Mapping[str, Sequence[str]], now: Instant
    ) -> Iterator[None]:
        """Follow what is wanted, and take what has arrived; in small pieces."""
        all_wanted = self._receiver.watched_topics(self._domain, types, now)
        wanted = {name: kind for name, kind in all_wanted.items() if kind in KINDS}
        others = {name: kind for name, kind in all_wanted.items() if kind not in KINDS}
        for name in self._topics.keys() - wanted.keys():
            subscriber.node.destroy_subscription(self._topics.pop(name)[1])
        for name in wanted.keys() - self._topics.keys():
            kind = wanted[name]
            subscribed = subscriber.subscribe(KINDS[kind], name, _profile(kind))
            self._topics[name] = kind, *subscribed
            yield
        for name, (kind, _subscription, take) in self._topics.items():
            self._take(name, kind, take, now)
            yield
        self._looked_at = now.mono
        yield from self._fields.look(subscriber, others, now)
        self._count(now)

    def _take(self, name: str, kind: str, take: Callable[[], Taken | None], now: Instant) -> None:
        for _ in range(DEPTH):
            taken = take()
            if taken is None:
                break
            data = taken.data
            self._bytes.add(name, len(data))
            self._receiver.record_watched(self._domain, name, kind, data, now)
            if kind == GOALS_TYPE:
                received = self._received(taken, now)
                self._receiver.receive_goals(self._domain, name, data, received)
            elif kind != LOG_TYPE or (len(data) > LEVEL_AT and data[LEVEL_AT] >= ERROR):
                self._receive(name, kind, data, now)

    def _receive(self, name: str, kind: str, data: bytes, now: Instant) -> None:
        try:
            message = _read(deserialize_message(data, KINDS[kind]))
        except Exception as error:  # noqa: BLE001 - rclpy raises RMWError, which it does not export
            log.debug("%s: undecodable: %s", name, error)
            return
        self._receiver.receive_watched(self._domain, name, message, now)

    def _received(self, taken: Taken, now: Instant) -> Instant:
        """When a message was, which the middleware knows: between the last look and this one."""
        waited = now.wall - taken.received * 1e-9 if taken.received else 0.0
        waited = min(max(0.0, waited), now.mono - self._looked_at)
        return Instant(now.mono - waited, now.wall - waited)

    def _count(self, now: Instant) -> None:
        """Report once a minute how much is received."""
        rates = self._bytes.rates(now.mono)
        if rates is not None:
            self._receiver.note_watched(self._domain, rates, now)


def _profile(kind: str) -> QoSProfile:
    if kind == GOALS_TYPE:  # the last list is kept for who joins late
        return QoSProfile(depth=GOALS_DEPTH, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    return QoSProfile(depth=DEPTH)


def _read(message: Any) -> Message:
    """What of a message of ROS is of interest."""
    if isinstance(message, RosLog):
        return Log(message.name, message.msg)
    if isinstance(message, TransitionEvent):
        return Transition(message.start_state.label, message.goal_state.label)
    changed = [
        (each.name, str(parameter_value_to_python(each.value))[:MAX_VALUE])
        for each in message.changed_parameters
    ]
    deleted = [(each.name, None) for each in message.deleted_parameters]
    return Parameters(message.node, (*changed, *deleted))
