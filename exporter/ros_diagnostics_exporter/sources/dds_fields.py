"""Small topics of any type whose fields fleet.yml asks for: subscribed, taken as bytes; by rclpy.

Imported by `dds_watch` alone. The middleware keeps the newest message of each topic, which is taken
once it is due: what comes between is never copied into Python.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Mapping
from typing import Any, NamedTuple

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

from ros_diagnostics_exporter.model import Domain, Instant
from ros_diagnostics_exporter.sources.dds_subscription import Subscriber, Taken
from ros_diagnostics_exporter.sources.dds_types import UnsupportedError, borrowed_type
from ros_diagnostics_exporter.sources.receiver import Receiver
from ros_diagnostics_exporter.sources.topic_entries import REFUSED_FOR
from ros_diagnostics_exporter.sources.watched_bytes import WatchedBytes

ASKED_AFTER = 60.0  # seconds without a message after which its publishers are asked for again
MAX_MISSED = 1000  # messages between two looks that are counted


class _Followed(NamedTuple):
    """A subscribed topic: its type, how it is subscribed, and what takes its next message."""

    kind: str
    profile: QoSProfile
    subscription: Any
    take: Callable[[], Taken | None]


class FieldTopics:
    """Those of one domain; ``counted`` counts what is received."""

    def __init__(self, domain: Domain, receiver: Receiver, counted: WatchedBytes) -> None:
        self._domain, self._receiver, self._counted = domain, receiver, counted
        self._topics: dict[str, _Followed] = {}
        self._due: dict[str, float] = {}  # when a topic is read, or asked for, again; monotonic
        self._numbers: dict[str, int] = {}  # of the last message
        self._ask_at: dict[str, float] = {}  # when a topic without messages is looked at again

    def look(
        self, subscriber: Subscriber, wanted: Mapping[str, str], now: Instant
    ) -> Iterator[None]:
        """Follow what is wanted, by name with its type, and take what is due; in small pieces."""
        node = subscriber.node
        for name, followed in list(self._topics.items()):
            if wanted.get(name) != followed.kind or self._is_offered_otherwise(node, name, now):
                node.destroy_subscription(self._topics.pop(name).subscription)
                yield
        for known in (self._due, self._numbers, self._ask_at):
            for name in known.keys() - wanted.keys():
                del known[name]
        for name, kind in wanted.items():
            if now.mono >= self._due.get(name, 0.0):
                if name in self._topics:
                    self._take(name, self._topics[name], now)
                else:
                    self._subscribe(subscriber, name, kind, now)
                yield

    def _is_offered_otherwise(self, node: Any, name: str, now: Instant) -> bool:
        """Whether nothing was received for a time, and the publishers are others now."""
        if now.mono < self._ask_at.setdefault(name, now.mono + ASKED_AFTER):
            return False
        self._ask_at[name] = now.mono + ASKED_AFTER
        offers = node.get_publishers_info_by_topic(name)
        return bool(offers) and _profile(offers) != self._topics[name].profile

    def _subscribe(self, subscriber: Subscriber, name: str, kind: str, now: Instant) -> None:
        """Subscribe a topic as its publishers offer it; without any it waits for one."""
        offers = subscriber.node.get_publishers_info_by_topic(name)
        if not offers:
            return
        hashes = {str(each.topic_type_hash) for each in offers}
        type_hash = hashes.pop() if len(hashes) == 1 else ""
        if not self._receiver.offered(self._domain, name, kind, type_hash, now):
            self._due[name] = now.mono + REFUSED_FOR
            return
        try:
            python_type = _installed_type(kind) or borrowed_type(kind)
        except UnsupportedError as error:
            self._receiver.refuse_watched(self._domain, name, str(error), now)
            self._due[name] = now.mono + REFUSED_FOR
            return
        profile = _profile(offers)
        subscribed = subscriber.subscribe(python_type, name, profile)
        self._topics[name] = _Followed(kind, profile, *subscribed)

    def _take(self, name: str, followed: _Followed, now: Instant) -> None:
        taken = followed.take()
        if taken is None:
            return
        data = taken.data
        self._ask_at[name] = now.mono + ASKED_AFTER
        number = taken.number or 0
        missed = number - self._numbers.get(name, number - 1)
        self._numbers[name] = number
        count = missed if 1 <= missed <= MAX_MISSED else 1
        self._counted.add(name, count * len(data))
        domain, kind = self._domain, followed.kind
        self._due[name] = self._receiver.receive_fields(domain, name, kind, data, now)


def _profile(offers: Any) -> QoSProfile:
    """What all publishers match: of what they keep for late joiners the last is sent at once."""
    profiles = [each.qos_profile for each in offers]
    kept = all(each.durability == DurabilityPolicy.TRANSIENT_LOCAL for each in profiles)
    reliable = all(each.reliability == ReliabilityPolicy.RELIABLE for each in profiles)
    # Else the next message has all that a lost one had.
    reliability = ReliabilityPolicy.RELIABLE if kept and reliable else ReliabilityPolicy.BEST_EFFORT
    durability = DurabilityPolicy.TRANSIENT_LOCAL if kept else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=1, reliability=reliability, durability=durability)


def _installed_type(kind: str) -> Any:
    """The class of an installed package; None where there is none."""
    package, _, name = kind.split("/")
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name, None)
    except ImportError:
        return None
