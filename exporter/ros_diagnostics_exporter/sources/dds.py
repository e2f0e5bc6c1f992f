"""What knows ROS: contexts, subscriptions, the graph; bytes -> Array.

One rclpy context and node for each DDS domain. Arrays are received as bytes; once a second each
domain looks at its graph and asks which topics are wanted.
"""

from __future__ import annotations

import logging
import os
from bisect import bisect_right
from collections.abc import Callable, Hashable, Iterator, Mapping
from functools import partial
from importlib import metadata
from time import monotonic
from typing import Any

from typing_extensions import override

from ros_diagnostics_exporter.extras import install_command
from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.model import Array, Endpoint, Instant, Status
from ros_diagnostics_exporter.sources.addresses import update_fast_dds
from ros_diagnostics_exporter.sources.link import Link
from ros_diagnostics_exporter.sources.receiver import Receiver
from ros_diagnostics_exporter.sources.reception import Count, Reception
from ros_diagnostics_exporter.sources.ros_environment import (
    MiddlewareMissingError,
    RosMissingError,
    check_middleware,
    ros_distribution,
)

try:
    check_middleware(os.environ)
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.context import Context
    from rclpy.node import Node
    from rclpy.parameter import Parameter
    from rclpy.qos import (
        DurabilityPolicy,
        HistoryPolicy,
        QoSProfile,
        ReliabilityPolicy,
    )
    from rclpy.serialization import deserialize_message

    from ros_diagnostics_exporter.sources.dds_endpoints import EndpointReader, Subscribed
    from ros_diagnostics_exporter.sources.dds_names import (
        Nodes,
        Topics,
        list_nodes,
        list_topics,
    )
    from ros_diagnostics_exporter.sources.dds_subscription import (
        Subscriber,
        Taken,
        publisher_name,
    )
    from ros_diagnostics_exporter.sources.dds_watch import Watcher
except ImportError as error:  # raised by check_ros before anything is started
    _IMPORT_ERROR: ImportError | None = error
else:
    _IMPORT_ERROR = None

log = logging.getLogger(__name__)

TYPE = "diagnostic_msgs/msg/DiagnosticArray"
NODE_NAME = "ros_diagnostics_exporter"
# Unsubscribed topics whose publishers are asked for at one look. Asking takes up to some
# milliseconds each where there are thousands; the others' turn comes at the next looks.
MAX_ASKED = 500
SELDOM = 5  # looks at the graph from one question about a topic with messages to the next
MOST_STRANGE = 30  # looks at a graph that has no publisher of messages, until it never will
LINKS = 5.0  # seconds between two looks at how messages arrive


def check_ros() -> None:
    """Raise RosMissingError, with the way out, where ROS cannot be imported."""
    if isinstance(_IMPORT_ERROR, MiddlewareMissingError):
        raise RosMissingError(str(_IMPORT_ERROR))
    if _IMPORT_ERROR is not None:
        raise RosMissingError(
            f"ROS 2 was not found ({_IMPORT_ERROR}): source it (source /opt/ros/jazzy/setup.bash), "
            f"or install it beside this package: {install_command('ros')}"
        )


def describe_ros() -> tuple[str, str]:
    """(distribution, middleware); "" where there is no ROS, or nothing names its distribution."""
    if _IMPORT_ERROR is not None:
        return "", ""
    packages = (each.metadata["Name"] or "" for each in metadata.distributions())
    distribution = ros_distribution(os.environ, packages)
    return distribution, rclpy.get_rmw_implementation_identifier()


def decode(data: bytes) -> Array:
    """One DiagnosticArray in any encoding of the middleware, by rclpy; `cdr` is faster.

    Raises:
        ValueError: the bytes are no such message.
    """
    try:
        message = deserialize_message(data, DiagnosticArray)
    except Exception as error:  # rclpy raises RMWError, which it does not export
        raise ValueError(f"{type(error).__name__}: {error}") from error
    stamp = message.header.stamp
    return Array(
        stamp.sec + stamp.nanosec * 1e-9,
        tuple(
            Status(
                status.level[0] if status.level else 255,
                status.name,
                status.message,
                status.hardware_id,
                tuple([(pair.key, pair.value) for pair in status.values]),
            )
            for status in message.status
        ),
        len(data),
        data,
    )


class DdsDomain(Reception):
    """One DDS domain: a context and a quiet node."""

    def __init__(
        self,
        domain: int,
        ros_arguments: tuple[str, ...],
        receiver: Receiver,
        count: Count,
        poll_interval: float,
    ) -> None:
        super().__init__(domain, receiver, count, poll_interval)
        self._ros_arguments = ros_arguments
        self._domain_id = domain
        self._subscriptions: dict[str, Subscribed] = {}
        self._known: dict[str, tuple[tuple[int, tuple[str, ...], str], Endpoint]] = {}
        self._looks = 0
        self._odd: list[str] = []  # of the look under way
        self._types: dict[str, tuple[str, ...]] = {}  # of the topics, at the last look
        self._other_types: dict[str, tuple[str, ...]] = {}  # of those that are no DiagnosticArray
        self._asked_last, self._asked_at = "", 0.0  # the last topic; when, monotonic
        self._links_at = 0.0  # next, monotonic
        self._publisher = ""  # of the last message
        self._strange = 1  # looks that did not have it, until one has
        self._endpoints = EndpointReader(domain, receiver, self._subscriptions.get)
        self._watcher = Watcher(domain, receiver)
        self._context: Context | None = None
        self._subscriber: Subscriber | None = None

    @override
    def join(self) -> None:
        check_ros()
        update_fast_dds()
        self._context = Context()
        rclpy.init(args=list(self._ros_arguments), context=self._context, domain_id=self._domain_id)
        self._subscriber = Subscriber(make_guest(NODE_NAME, self._context))

    @override
    def leave(self) -> None:
        if self._subscriber is not None:
            self._subscriber.node.destroy_node()
            self._subscriber.close()
        if self._context is not None:
            self._context.try_shutdown()

    @override
    def data(self, taken: Taken) -> bytes:
        return taken.data

    @override
    def publisher(self, taken: Taken) -> str:
        return taken.publisher if self._strange < MOST_STRANGE else ""

    @override
    def identity(self, taken: Taken) -> Hashable:
        known = taken.number is not None and taken.sent
        return (taken.number, taken.sent) if known else super().identity(taken)

    @override
    def measure(self, link: Link, taken: Taken) -> None:
        self._publisher = taken.publisher
        if taken.number is not None and taken.sent and taken.received:
            link.note(taken.number, taken.sent, taken.received)

    @override
    def decode(self, data: bytes) -> Array:
        return decode(data)

    # -- the graph ---------------------------------------------------------------------------

    @override
    def look(self) -> Iterator[None]:
        """Report what the graph shows, and subscribe what is wanted; in small pieces."""
        subscriber, now = self._joined, read_clocks()
        node = subscriber.node
        self._looks += 1
        self._odd = []
        found: Topics = []
        if listed := self.run_safely(lambda: found.extend(self._list_topics(node))):
            yield from self._read_topics(node, found, now)
        topics = {name: endpoint for name, (_state, endpoint) in self._known.items()}
        self._find_publisher(topics)
        yield from self._subscribe_wanted(topics)
        if not listed:
            return  # what is wanted is received all the same
        self.complete_look(now)
        self._report_links(topics, now)
        nodes = self._endpoints.names.complete(self._list_nodes(node), now.mono)
        self.odd = "; ".join(self._odd)
        if self.receiver.update_nodes(self._domain, nodes, now):
            yield from self._watcher.look(subscriber, dict(found), now)
            yield from self._endpoints.read(node, [name for name, _types in found], now)

    def _find_publisher(self, topics: Mapping[str, Endpoint]) -> None:
        """Look whether the graph has publishers by the names that messages have.

        With a middleware by which it has not, nobody would know which publishers are gone.
        """
        if self._publisher and 0 < self._strange < MOST_STRANGE:
            is_known = any(self._publisher in each.writers for each in topics.values())
            self._strange = 0 if is_known else self._strange + 1

    def _list_topics(self, node: Node) -> Topics:
        topics, unreadable = list_topics(node)
        if unreadable:
            self._note_odd(
                f"{len(unreadable)} topics have a name that is no UTF-8: {unreadable[0]}"
            )
        return topics

    def _list_nodes(self, node: Node) -> Nodes:
        nodes, unnamed = list_nodes(node)
        if unnamed:
            self._note_odd(f"{unnamed} nodes have no name, or none that is UTF-8")
        return nodes

    def _note_odd(self, what: str) -> None:
        """Note, and log, what somebody has in the domain that is left out."""
        self._odd.append(what)
        self.log_seldom("", what, "%s%s: left out: %s", what)

    def _read_topics(self, node: Node, found: Topics, now: Instant) -> Iterator[None]:
        """Report all topics, those that are due anew."""
        finders = self.receiver.finders(self._domain)
        types = {
            name: tuple(types)
            for name, types in found
            if TYPE in types or name in self.topics or any(e.fullmatch(name) for e in finders)
        }
        others = {name: tuple(of) for name, of in found if name not in types}
        if others != self._other_types:
            self.receiver.note_other_types(self._domain, others, now)
            self._other_types = others
        for name in self._to_be_asked(types):
            self.run_safely(partial(self._ask, node, name, types[name]))
            yield
        self._known = {name: self._known[name] for name in types if name in self._known}
        topics = {name: endpoint for name, (_state, endpoint) in self._known.items()}
        self.receiver.update_graph(self._domain, topics, now)
        self.is_same = types == self._types and types.keys() == self._known.keys()
        self._types = types

    def _subscribe_wanted(self, topics: Mapping[str, Endpoint]) -> Iterator[None]:
        """Subscribe what is wanted, and nothing else."""
        wanted = self.receiver.wanted_topics(self._domain)
        for name in self.topics.keys() - wanted.keys():
            self.unsubscribe(name)
            yield
        for name, shared in wanted.items():
            self.want(name, self._offer(name, topics), shared=shared)
            yield

    def _to_be_asked(self, types: Mapping[str, tuple[str, ...]]) -> list[str]:
        """The subscribed topics that are due, and as many others as one look may ask for, in turns.

        While messages arrive, somebody publishes: such topics are due at every fifth look only.
        """
        others = sorted(types.keys() - self.topics.keys())
        first = bisect_right(others, self._asked_last)
        chosen = (others[first:] + others[:first])[:MAX_ASKED]
        self._asked_last = chosen[-1] if chosen else ""
        due = [name for name in types if name in self.topics and self._is_due(name)]
        self._asked_at = monotonic()
        return due + chosen

    def _is_due(self, name: str) -> bool:
        return (
            self.topics[name].content.received_at < self._asked_at
            or name not in self._known
            or self._has_turn(name, SELDOM)
        )

    def _has_turn(self, name: str, looks: int) -> bool:
        """At one of so many looks, each topic at another one."""
        return (self._looks + hash(name)) % looks == 0

    def _ask(self, node: Node, name: str, types: tuple[str, ...]) -> None:
        """Ask for the publishers of a topic; in full only when their number or types changed.

        Asking for each publisher's offer is dear (a fleet has thousands), so one that is replaced
        between two looks by another, or joins others whose reliability differs, is found out at
        every tenth look only. The number of those that match costs nothing to ask for.
        """
        subscribed = self._subscriptions.get(name)
        matched = subscribed.matched if subscribed is not None else 0
        count = matched or node.count_publishers(name)
        refused = subscribed.refused if subscribed is not None and count > matched else ""
        state = count, types, refused
        known = self._known.get(name)
        again = self._has_turn(name, 2 * SELDOM)
        if known is not None and known[0] == state and not again:
            return
        offers = node.get_publishers_info_by_topic(name) if count else []
        others = sorted({offer.topic_type for offer in offers} - {TYPE})
        endpoint = Endpoint(
            publishers=sum(offer.topic_type == TYPE for offer in offers),
            wrong_type=", ".join(others),
            reliable=not any(
                offer.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT for offer in offers
            ),
            refused=refused,
            writers=frozenset(publisher_name(offer.endpoint_gid) for offer in offers),
        )
        self._known[name] = state, endpoint

    # -- what is seen of others -----------------------------------------------------------------

    def _report_links(self, topics: Mapping[str, Endpoint], now: Instant) -> None:
        """Report how messages arrive; of several publishers nobody knows whose number one is."""
        if now.mono < self._links_at:
            return
        self._links_at = now.mono + LINKS
        links = {}
        for name, topic in self.topics.items():
            link = topic.content.link
            if name in topics and topics[name].publishers == 1:
                links[name] = link.reading(now.wall)
            else:
                link.reset()
                links[name] = None
        self.receiver.update_links(self._domain, links, now)

    def _offer(self, name: str, topics: Mapping[str, Endpoint]) -> bool:
        """Whether to subscribe reliably: unless a publisher has ever offered only best effort."""
        known = self.topics.get(name)
        return (known is None or known.offer is True) and topics.get(name, Endpoint(0)).reliable

    @override
    def open(
        self, name: str, offer: bool, depth: int
    ) -> tuple[Callable[[], Any], Callable[[], object]]:
        node, profile = self._joined.node, quality(reliable=offer, depth=depth)
        subscription, take = self._joined.subscribe(DiagnosticArray, name, profile)
        subscribed = self._subscriptions[name] = Subscribed(subscription)

        def close() -> None:
            if self._subscriptions.get(name) is subscribed:  # else another one replaces it
                del self._subscriptions[name]
            subscribed.close()
            node.destroy_subscription(subscription)

        return take, close

    @property
    def _joined(self) -> Subscriber:
        if self._subscriber is None:
            raise RuntimeError("the domain is not joined")
        return self._subscriber


def quality(*, reliable: bool, depth: int) -> QoSProfile:
    """How diagnostics are subscribed; the middleware holds ``depth`` messages."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.VOLATILE,
    )


def make_guest(name: str, context: Context) -> Node:
    """A node without parameter and type description services and without /rosout."""
    return _make_node(
        name,
        context=context,
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter("start_type_description_service", value=False)],
    )


class _Nothing:
    """Stands for a publisher: what is published is nobody's."""

    def publish(self, message: object) -> None:
        """Publish nothing."""


def _make_node(*args: Any, **kwargs: Any) -> Node:
    """A node that publishes nothing: every other one of rclpy has /parameter_events."""

    class Guest(Node):  # type: ignore[misc]
        def create_publisher(self, *_args: object, **_kwargs: object) -> _Nothing:
            return _Nothing()

    return Guest(*args, **kwargs)
