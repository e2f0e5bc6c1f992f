"""The endpoints of all topics of a domain, read by turns, and which of them cannot match; by rclpy.

Imported by `dds` alone, once it knows that there is ROS.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from time import thread_time
from typing import Any

from rclpy.event_handler import QoSSubscriptionEventType
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import (
    QoSCompatibility,
    QoSPolicyKind,
    QoSProfile,
    qos_check_compatible,
    qos_policy_name_from_kind,
)
from rclpy.subscription import Subscription

from ros_diagnostics_exporter.config.robots import MESSAGE_TYPE
from ros_diagnostics_exporter.model import Domain, Instant
from ros_diagnostics_exporter.sources.endpoint_names import NO_NODE, EndpointNames
from ros_diagnostics_exporter.sources.graph_topics import UNKNOWN, US, Mismatch, Peer, TopicView
from ros_diagnostics_exporter.sources.receiver import Receiver

# All topics' endpoints are read by turns, each at most once in so many seconds, and on average at
# most this share of the time is spent on it: the more topics there are, the longer a round takes.
ROUND, ROUND_SHARE = 20.0, 0.02
MAX_READ = 100  # topics of one look
MAX_ENDPOINTS = 50  # publishers, or subscribers, of a topic; more are every robot's, as of /tf
MAX_MISMATCHES = 10  # of one topic that are named
MAX_MATCHES = 1000  # of two QoS that are kept
GLOBAL = ("/rosout", "/parameter_events")  # topics of every node
ASKED_BEFORE = 3  # times that a subscription matches too few, before the middleware is asked why


class Subscribed:
    """A subscription, and what the middleware says of the publishers that it does not match."""

    def __init__(self, subscription: Subscription) -> None:
        self._subscription = subscription
        self._event: Any = None
        self._asked = 0

    @property
    def matched(self) -> int:
        """How many publishers it matches."""
        return int(self._subscription.get_publisher_count())

    @property
    def refused(self) -> str:
        """The policy because of which it last did not match a publisher; "" where there is none."""
        # Not at once, while publishers are matched: what arrives while it is made may be lost.
        self._asked += 1
        if self._event is None and self._asked < ASKED_BEFORE:
            return ""
        if self._event is None:
            with self._subscription.handle:
                self._event = rclpy_implementation.EventHandle(
                    self._subscription.handle,
                    QoSSubscriptionEventType.RCL_SUBSCRIPTION_REQUESTED_INCOMPATIBLE_QOS,
                )
        with self._event:
            status = self._event.take_event()
        if status is None or not status.total_count:
            return ""
        kind = QoSPolicyKind(int(status.last_policy_kind))
        if kind is QoSPolicyKind.INVALID:
            return "a policy that ROS has no name for, as ownership or data representation"
        return str(qos_policy_name_from_kind(kind))

    def close(self) -> None:
        """Ask no more."""
        if self._event is not None:
            self._event.destroy_when_not_in_use()


class EndpointReader:
    """Reports the endpoints of one domain; ``subscribed`` has our own subscriptions by topic."""

    def __init__(
        self, domain: Domain, receiver: Receiver, subscribed: Callable[[str], Subscribed | None]
    ) -> None:
        self._domain, self._receiver, self._subscribed = domain, receiver, subscribed
        self.names = EndpointNames()
        self._read: OrderedDict[str, float] = OrderedDict()  # topics, when; the oldest first
        self._read_at = 0.0  # next, monotonic
        self._matches: dict[tuple[Any, ...], str] = {}  # why two QoS cannot match; "": they do

    def read(self, node: Any, names: Sequence[str], now: Instant) -> Iterator[None]:
        """Report the endpoints of the topics that are due, those never read first."""
        if now.mono < self._read_at:
            return
        cost, begin = 0.0, thread_time()
        views = {name: TopicView((), ()) for name in self._read.keys() - set(names)}
        for name in views:
            del self._read[name]
            self.names.named(name, ())
        for name in set(names).difference(self._read, GLOBAL):
            self._read[name] = float("-inf")
            self._read.move_to_end(name, last=False)
        for _ in range(min(MAX_READ, len(self._read))):
            name, at = next(iter(self._read.items()))
            if now.mono - at < ROUND:
                break
            self._read[name] = now.mono
            self._read.move_to_end(name)
            if (view := self._view(node, name)) is not None:
                views[name] = view
            cost += thread_time() - begin
            yield
            begin = thread_time()
        self._receiver.update_endpoints(self._domain, views, now)
        cost += thread_time() - begin
        self._read_at = now.mono + cost / ROUND_SHARE

    def _view(self, node: Any, name: str) -> TopicView | None:
        """All endpoints of a topic; None where they are too many, or cannot be read."""
        if max(node.count_publishers(name), node.count_subscribers(name)) > MAX_ENDPOINTS:
            self.names.named(name, ())
            return None
        try:
            publishers = node.get_publishers_info_by_topic(name)
            subscribers = node.get_subscriptions_info_by_topic(name)
        except UnicodeDecodeError:  # the name of a node: of this topic nothing can be judged
            self.names.named(name, ())
            return None
        peers = self.names.named(name, map(_peer, (*publishers, *subscribers)))
        offering, asking = peers[: len(publishers)], peers[len(publishers) :]
        mismatches = (
            Mismatch(publisher.node, subscriber.node, why)
            for publisher, one in zip(offering, publishers, strict=True)
            for subscriber, other in zip(asking, subscribers, strict=True)
            if (why := self._why_no_match(one, other))
        )
        unknown = any(each.node.endswith(NO_NODE) for each in peers)
        offers = [
            peer.node
            for peer, of in zip(offering, publishers, strict=True)
            if of.topic_type == MESSAGE_TYPE
        ]
        return TopicView(
            tuple(offering),
            tuple(asking),
            (
                *self._refusals(name, offers),
                *islice(mismatches, MAX_MISMATCHES),
                *((UNKNOWN,) if unknown else ()),
            ),
        )

    def _refusals(self, name: str, offers: Sequence[str]) -> Iterator[Mismatch]:
        """That our own subscription matches not all publishers, by their nodes, and why.

        Of several publishers nobody knows which.
        """
        subscribed = self._subscribed(name)
        if subscribed is not None and subscribed.matched < len(offers) and subscribed.refused:
            which = "one of " if subscribed.matched else ""
            yield Mismatch(which + ", ".join(sorted(set(offers))), US, f"by {subscribed.refused}")

    def _why_no_match(self, one: Any, other: Any) -> str:
        """Why a subscriber receives nothing of a publisher; "" where it does."""
        if one.topic_type != other.topic_type:
            return f"the types differ, {one.topic_type} and {other.topic_type}"
        key = _qos(one.qos_profile), _qos(other.qos_profile)
        if key not in self._matches:
            if len(self._matches) >= MAX_MATCHES:
                self._matches.clear()
            result, why = qos_check_compatible(one.qos_profile, other.qos_profile)
            is_wrong = result == QoSCompatibility.ERROR
            self._matches[key] = why.removeprefix("ERROR: ").strip("; ") if is_wrong else ""
        return self._matches[key]


def _peer(endpoint: Any) -> Peer:
    name = f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"
    return Peer(name, bytes(endpoint.endpoint_gid).hex())


def _qos(profile: QoSProfile) -> tuple[Any, ...]:
    """What of a profile decides whether it matches another."""
    return (
        profile.reliability,
        profile.durability,
        profile.deadline.nanoseconds,
        profile.liveliness,
        profile.liveliness_lease_duration.nanoseconds,
    )
