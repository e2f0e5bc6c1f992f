"""The only file that knows ROS: contexts, subscriptions, the graph; bytes -> Array.

One rclpy context, node and thread for each DDS domain. Arrays are received as bytes, decoded here
and passed on; once a second each domain looks at its graph and asks which topics are wanted.

Nothing that one publisher does may slow what belongs to others. So a domain's thread works in
turns: a piece of the look at the graph; the bytes of all topics, which is cheap; then decoding, the
topics that have cost least first, for a bounded time. What a topic sends beyond its share is
dropped (`topic_queue`).
"""

from __future__ import annotations

import logging
import os
import sys
import threading
import time
from bisect import bisect_right
from collections.abc import Callable, Iterator, Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory, TemporaryFile
from typing import Protocol

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.decode.cdr import Decoder, is_cdr
from ros_diagnostics_exporter.decode.topic_queue import SHARE, SHARED, TopicQueue
from ros_diagnostics_exporter.loops import Loop
from ros_diagnostics_exporter.model import Array, Endpoint, Instant, Status, Topic
from ros_diagnostics_exporter.texts import one_line

RMW_VARIABLE = "RMW_IMPLEMENTATION"


class _MissingMiddlewareError(ImportError):
    """The middleware that the environment names is not installed; the text says what to do."""


def check_middleware(environment: Mapping[str, str]) -> None:
    """Raise an ImportError where ROS lacks the middleware: it would end the process with a riddle.

    Where nothing is known of the libraries' folders, nothing is said.
    """
    wanted = environment.get(RMW_VARIABLE, "")
    paths = environment.get("LD_LIBRARY_PATH", "").split(":")
    folders = [Path(sys.prefix, "lib"), *map(Path, filter(None, paths))]
    found = {path.stem.removeprefix("lib") for each in folders for path in each.glob("librmw_*.so")}
    if wanted and found and wanted not in found:
        raise _MissingMiddlewareError(
            f"{RMW_VARIABLE} is {wanted!r}, and there is no lib{wanted}.so in "
            f"{', '.join(map(str, folders))}: unset it, or install that middleware into ROS "
            "(pip has rmw_fastrtps_cpp only)"
        )


try:
    check_middleware(os.environ)
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from rclpy.context import Context
    from rclpy.event_handler import SubscriptionEventCallbacks
    from rclpy.node import Node
    from rclpy.parameter import Parameter
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
    from rclpy.serialization import deserialize_message
    from rclpy.subscription import Subscription
except ImportError as error:  # raised by check_ros before anything is started
    _IMPORT_ERROR: ImportError | None = error
else:
    _IMPORT_ERROR = None

log = logging.getLogger(__name__)

TYPE = "diagnostic_msgs/msg/DiagnosticArray"
NODE_NAME = "ros_diagnostics_exporter"
# Whole fleets publish at the same moment of the second; a shallow queue loses such bursts
# (ros/diagnostics#195).
DEPTH = 1000
# Seconds between two looks whether messages have arrived. The moment of receipt is known this well;
# asking 1,000 topics costs a millisecond.
TAKE_INTERVAL = 0.1
LOG_INTERVAL = 60.0  # seconds between two lines about the same trouble
MAX_MESSAGE = 4 << 20  # bytes of one message; a longer one is not decoded
# Bytes that the middleware may hold of one topic: a topic of large messages gets a shallower queue.
MAX_HISTORY = 64 << 20
# Seconds of one turn: for the look at the graph, for taking one topic's bytes, for decoding.
LOOK_TIME, DRAIN_TIME, DECODE_TIME = 0.05, 0.05, 0.25
# Unsubscribed topics whose publishers are asked for at one look. Asking takes up to some
# milliseconds each where there are thousands; the others' turn comes at the next looks.
MAX_ASKED = 500
SELDOM = 5  # looks at the graph from one question about a topic with messages to the next
# Asking for all topics costs tens of milliseconds of CPU where there are thousands. While they stay
# the same, at most this share of the time is spent on it: then looks are further apart than
# ``poll_interval``, up to five times as far.
LOOK_SHARE, MAX_STRETCH = 0.01, 5
PROFILES_VARIABLE = "FASTRTPS_DEFAULT_PROFILES_FILE"
OWN_PROFILES = "DEFAULT_FASTRTPS_PROFILES.xml"
MAX_ERROR = 200  # characters of why a domain could not be joined
LEAVE_TIME = 5.0  # seconds that domains are waited for when they are left


class RosMissingError(Exception):
    """rclpy or diagnostic_msgs cannot be imported; the text says what to do."""


class Receiver(Protocol):
    """What the listener reports to; all methods are called from its threads."""

    def receive(self, topic: Topic, array: Array, now: Instant) -> None:
        """Take one array."""

    def reject_undecodable(self, topic: Topic, error: str, now: Instant) -> None:
        """Note that a message could not be decoded."""

    def reject_dropped(self, topic: Topic, count: int) -> None:
        """Note that so many messages of a topic were dropped undecoded."""

    def update_graph(self, domain_id: int, endpoints: Mapping[str, Endpoint], now: Instant) -> None:
        """Take all topics of a domain, by name."""

    def note_other_types(
        self, domain_id: int, types: Mapping[str, tuple[str, ...]], now: Instant
    ) -> None:
        """Take the types of all topics of a domain that have no DiagnosticArray, by name."""

    def wanted_topics(self, domain_id: int) -> Mapping[str, bool]:
        """Name -> whether robots share it, for each topic to be subscribed."""

    def domain_joined(self, domain_id: int) -> None:
        """Note that a domain was joined."""

    def domain_failed(self, domain_id: int, error: str, now: Instant) -> None:
        """Note that a domain could not be joined."""


def check_ros() -> None:
    """Raise RosMissingError, with the way out, where ROS cannot be imported."""
    if isinstance(_IMPORT_ERROR, _MissingMiddlewareError):
        raise RosMissingError(str(_IMPORT_ERROR))
    if _IMPORT_ERROR is not None:
        raise RosMissingError(
            f"ROS 2 was not found ({_IMPORT_ERROR}): source it (source /opt/ros/jazzy/setup.bash), "
            "or install it with this package: pip install 'ros-diagnostics-exporter[ros]'"
        )


def use_profiles(environment: MutableMapping[str, str], folder: Path) -> None:
    """Have Fast DDS allocate less for each topic, unless the user has profiles of their own.

    To be called before a domain is joined: Fast DDS reads the file once, when it starts.

    Args:
        environment: Of this process; the file's path is added.
        folder: The working directory, where Fast DDS looks for a file, too.
    """
    if not environment.get(PROFILES_VARIABLE) and not (folder / OWN_PROFILES).exists():
        environment[PROFILES_VARIABLE] = str(Path(__file__).with_name("fastdds.xml"))


def use_log_folder(environment: MutableMapping[str, str]) -> TemporaryDirectory[str] | None:
    """Have rcl log to a temporary folder where it cannot make its own: it would join no domain.

    Args:
        environment: Of this process; ``ROS_LOG_DIR`` is set where that is so.

    Returns:
        The temporary folder, which is removed with this object; None where rcl's own can be used.
    """
    try:
        folder = _log_folder(environment)
        folder.mkdir(parents=True, exist_ok=True)
        with TemporaryFile(dir=folder):
            return None
    except OSError as error:
        made = TemporaryDirectory(prefix="ros-diagnostics-exporter-")
        log.warning("ROS logs to %s, because its own folder cannot be used: %s", made.name, error)
        environment["ROS_LOG_DIR"] = made.name
        return made


def _log_folder(environment: Mapping[str, str]) -> Path:
    """Where rcl will log; OSError where it knows no folder."""
    if folder := environment.get("ROS_LOG_DIR"):
        return Path(folder).expanduser()
    if home := environment.get("ROS_HOME"):
        return Path(home, "log").expanduser()
    if home := environment.get("HOME"):
        return Path(home, ".ros", "log")
    raise OSError("HOME is not set")


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


def read_clocks() -> Instant:
    """Both clocks, now."""
    return Instant(time.monotonic(), time.time())


class Listener:
    """An `ArraySource` that joins the domains and subscribes to what is wanted there."""

    name = "dds"

    def __init__(
        self,
        receiver: Receiver,
        poll_interval: float = 1.0,
        ros_arguments: tuple[str, ...] = (),
    ) -> None:
        """``ros_arguments`` are those from ``--ros-args`` on, as ROS' own tools take them."""
        check_ros()
        use_profiles(os.environ, Path())
        self._log_folder = use_log_folder(os.environ)
        self.ros_arguments = ros_arguments
        self._receiver = receiver
        self._poll_interval = poll_interval
        self._domains: dict[int, _Domain] = {}
        self._joining = threading.Lock()
        self._counting = threading.Lock()
        self.decode_seconds = 0.0
        self.ingest_seconds = 0.0

    def follow(self, fleet: Fleet) -> None:
        """Be in exactly the domains of this config; see `join`."""
        self.join(fleet.domain_ids)

    def join(self, domain_ids: tuple[int, ...]) -> None:
        """Be in exactly these domains.

        Each is joined by a thread of its own, which calls ``joined`` or ``failed``: this waits for
        none of them, and for those that are left at most ``LEAVE_TIME``. One that is still being
        joined, or left, stays as it is.
        """
        with self._joining:
            leaving = [self._domains[each] for each in self._domains.keys() - set(domain_ids)]
            for domain in leaving:
                domain.ask_to_stop()
            deadline = time.monotonic() + LEAVE_TIME
            for domain in leaving:
                domain.wait(max(0.0, deadline - time.monotonic()))
            domains = {each: domain for each, domain in self._domains.items() if domain.alive}
            for domain_id in domain_ids:
                if domain_id not in domains:
                    domains[domain_id] = _Domain(domain_id, self, self._receiver)
            self._domains = domains

    def count(self, decode_seconds: float, ingest_seconds: float) -> None:
        """Add to the CPU time spent; called by the domains' threads."""
        with self._counting:
            self.decode_seconds += decode_seconds
            self.ingest_seconds += ingest_seconds

    @property
    def domain_ids(self) -> tuple[int, ...]:
        """The domains that are joined."""
        return tuple(sorted(each for each, domain in self._domains.items() if domain.joined))

    @property
    def joining(self) -> tuple[int, ...]:
        """The domains that are being joined, which may take long."""
        return tuple(sorted(each for each, domain in self._domains.items() if domain.joining))

    @property
    def last_looks(self) -> Mapping[int, float]:
        """Joined domain -> Unix time when its graph was last looked at; 0 before that."""
        domains = self._domains
        return {each: domains[each].last_look for each in sorted(domains) if domains[each].joined}

    @property
    def loops(self) -> list[Loop]:
        """Those of the domains."""
        return [domain.loop for domain in self._domains.values()]

    @property
    def errors(self) -> Mapping[int, str]:
        """Why domains could not be joined at the last attempt, by domain."""
        return {
            each: domain.error for each, domain in sorted(self._domains.items()) if domain.error
        }

    def stalled(self, seconds: float) -> list[int]:
        """The joined domains whose thread has finished no turn for so many seconds."""
        since = time.monotonic() - seconds
        return [
            each
            for each, domain in sorted(self._domains.items())
            if domain.joined and domain.last_turn < since
        ]

    @property
    def poll_interval(self) -> float:
        """Seconds between two looks at a domain's graph."""
        return self._poll_interval

    def stop(self) -> None:
        """Leave all domains."""
        self.join(())


def _never_called(_data: object) -> None:
    """Stand in for a subscription's callback: messages are taken, not delivered."""


@dataclass(slots=True)
class _Content:
    """What is received on a topic, whichever subscription brings it."""

    queue: TopicQueue
    decoder: Decoder = field(default_factory=Decoder)
    received: bool = False  # since the last look at the graph


@dataclass(slots=True)
class _Subscription:
    """A subscribed topic; ``depth`` is how many messages the middleware holds of it.

    ``take`` returns (bytes, their origin), or None where nothing has arrived.
    """

    subscription: Subscription
    take: Callable[[type[DiagnosticArray], bool], tuple[bytes, object] | None]
    reliable: bool
    depth: int
    content: _Content


@dataclass(slots=True)
class _Spent:
    """CPU seconds of one turn."""

    decode: float = 0.0
    ingest: float = 0.0


class _Domain:
    """One DDS domain: a thread with a context and a quiet node, which it makes and destroys."""

    def __init__(self, domain_id: int, listener: Listener, receiver: Receiver) -> None:
        self._domain_id = domain_id
        self._listener = listener
        self._receiver = receiver
        self._topics: dict[str, _Subscription] = {}
        self._waiting: dict[str, _Content] = {}  # topics with messages to decode
        self._logged: dict[tuple[str, str], float] = {}
        self._known: dict[str, tuple[tuple[int, tuple[str, ...]], Endpoint]] = {}
        self._looks = 0
        self._look_at = 0.0
        self._types: dict[str, tuple[str, ...]] = {}  # of the topics, at the last look
        self._other_types: dict[str, tuple[str, ...]] = {}  # of those that are no DiagnosticArray
        self._look: Iterator[None] | None = None
        self._asked_last = ""
        self._context = Context()
        self._node: Node | None = None
        self.error = ""  # why it could not be joined
        self.last_look = 0.0
        self.last_turn = 0.0
        self.loop = Loop(f"domain-{domain_id}", TAKE_INTERVAL, self._turn, end=self._leave)
        self.loop.start()

    @property
    def alive(self) -> bool:
        """Whether the thread runs: it joins, works, or leaves."""
        return self.loop.alive and not self.error

    @property
    def joined(self) -> bool:
        """Whether messages are taken."""
        return self.alive and self._node is not None and not self.loop.stopping

    @property
    def joining(self) -> bool:
        """Whether the domain is not joined yet."""
        return self.alive and self._node is None and not self.loop.stopping

    def ask_to_stop(self) -> None:
        """Leave the domain soon."""
        self.loop.ask_to_stop()

    def wait(self, seconds: float) -> None:
        """Wait until the domain is left, at most so many seconds."""
        if not self.loop.stop(seconds):
            log.warning("DDS domain %d is not left yet: its thread still runs", self._domain_id)

    def _turn(self) -> None:
        """Join the domain at the first turn; take what has arrived at all others."""
        if self._node is not None:
            self._take(self._node)
            return
        try:
            node = self._join(self._context)
        except Exception as error:  # whatever the middleware raises; other domains go on
            log.exception("cannot join DDS domain %d", self._domain_id)
            self.error = one_line(str(error)).strip()[:MAX_ERROR] or type(error).__name__
            self.loop.ask_to_stop()  # from now on it may be joined anew
            self._receiver.domain_failed(self._domain_id, self.error, read_clocks())
            return
        self.last_turn = time.monotonic()
        self._node = node
        if not self.loop.stopping:
            self._receiver.domain_joined(self._domain_id)

    def _leave(self) -> None:
        if self._node is not None:
            self._node.destroy_node()
        self._context.try_shutdown()

    def _join(self, context: Context) -> Node:
        """A node without parameter and type description services and without /rosout."""
        arguments = list(self._listener.ros_arguments)
        rclpy.init(args=arguments, context=context, domain_id=self._domain_id)
        return rclpy.create_node(
            NODE_NAME,
            context=context,
            enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter("start_type_description_service", value=False)],
        )

    def _take(self, node: Node) -> None:
        """Look at the graph when that is due, and take what has arrived.

        Instead of rclpy's executors: they pass every subscription to the middleware before
        each single message, which for 100 robots costs more than all else together.
        """
        self._run_safely(partial(self._look_on, node))
        topics = iter(list(self._topics.items()))
        while not self._run_safely(partial(self._drain_all, node, topics)):
            pass  # the topics after the one that failed
        self._decode_waiting()
        self.last_turn = time.monotonic()

    def _run_safely(self, work: Callable[[], None]) -> bool:
        """Run one piece of work; a bug with one robot's messages must not stop the domain.

        Whether it was done without an error.
        """
        try:
            work()
        except Exception as error:
            self._log_seldom("", "error", "domain %d%s: internal error: %s", error)
            log.debug("domain %d", self._domain_id, exc_info=True)
            return False
        return True

    # -- the graph ---------------------------------------------------------------------------

    def _look_on(self, node: Node) -> None:
        """Go on with the look under way, or begin one that is due, for at most ``LOOK_TIME``."""
        begin = time.monotonic()
        if self._look is None:
            if begin < self._look_at:
                return
            self._look_at = begin + self._listener.poll_interval
            self._look = self._looking(node)
        for _ in self._look:
            if time.monotonic() - begin >= LOOK_TIME:
                return
        self._look = None

    def _looking(self, node: Node) -> Iterator[None]:
        """Report what the graph shows, and subscribe what is wanted; in small pieces."""
        now = read_clocks()
        self._looks += 1
        begin = time.thread_time()
        found = node.get_topic_names_and_types()
        cost = time.thread_time() - begin
        types = {
            name: tuple(types) for name, types in found if TYPE in types or name in self._topics
        }
        others = {name: tuple(of) for name, of in found if name not in types}
        if others != self._other_types:
            self._receiver.note_other_types(self._domain_id, others, now)
            self._other_types = others
        for name in self._to_be_asked(types):
            self._ask(node, name, types[name])
            yield
        self._known = {name: self._known[name] for name in types if name in self._known}
        topics = {name: endpoint for name, (_state, endpoint) in self._known.items()}
        self._receiver.update_graph(self._domain_id, topics, now)
        wanted = self._receiver.wanted_topics(self._domain_id)
        for name in self._topics.keys() - wanted.keys():
            self._unsubscribe(node, name)
            yield
        for name, shared in wanted.items():
            self._want(node, name, topics.get(name, Endpoint(0)), shared=shared)
            yield
        if types == self._types and types.keys() == self._known.keys():
            stretched = min(cost / LOOK_SHARE, MAX_STRETCH * self._listener.poll_interval)
            self._look_at = max(self._look_at, now.mono + stretched)
        self._types = types
        self.last_look = now.wall

    def _to_be_asked(self, types: Mapping[str, tuple[str, ...]]) -> list[str]:
        """The subscribed topics that are due, and as many others as one look may ask for, in turns.

        While messages arrive, somebody publishes: such topics are due at every fifth look only.
        """
        others = sorted(types.keys() - self._topics.keys())
        first = bisect_right(others, self._asked_last)
        chosen = (others[first:] + others[:first])[:MAX_ASKED]
        self._asked_last = chosen[-1] if chosen else ""
        due = []
        for name in types:
            if (topic := self._topics.get(name)) is not None:
                if (
                    not topic.content.received
                    or name not in self._known
                    or self._has_turn(name, SELDOM)
                ):
                    due.append(name)
                topic.content.received = False
        return due + chosen

    def _has_turn(self, name: str, looks: int) -> bool:
        """At one of so many looks, each topic at another one."""
        return (self._looks + hash(name)) % looks == 0

    def _ask(self, node: Node, name: str, types: tuple[str, ...]) -> None:
        """Ask for the publishers of a topic; in full only when their number or types changed.

        Asking for each publisher's offer is dear (a fleet has thousands), so one that is replaced
        between two looks by another, or joins others whose reliability differs, is found out at
        every tenth look only. The number of those that match costs nothing to ask for.
        """
        topic = self._topics.get(name)
        count = topic.subscription.get_publisher_count() if topic is not None else 0
        count = count or node.count_publishers(name)
        known = self._known.get(name)
        again = self._has_turn(name, 2 * SELDOM)
        if known is not None and known[0] == (count, types) and not again:
            return
        offers = node.get_publishers_info_by_topic(name) if count else []
        others = sorted({offer.topic_type for offer in offers} - {TYPE})
        endpoint = Endpoint(
            publishers=sum(offer.topic_type == TYPE for offer in offers),
            wrong_type=", ".join(others),
            reliable=not any(
                offer.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT for offer in offers
            ),
        )
        self._known[name] = (count, types), endpoint

    def _want(self, node: Node, name: str, endpoint: Endpoint, *, shared: bool) -> None:
        """Subscribe, reliably unless a publisher offers only best effort."""
        share = SHARED if shared else SHARE
        topic = self._topics.get(name)
        if topic is None:
            self._subscribe(node, name, endpoint.reliable, DEPTH, _Content(TopicQueue(share)))
            return
        topic.content.queue.share = share
        if topic.reliable and not endpoint.reliable:
            self._subscribe(node, name, endpoint.reliable, topic.depth, topic.content)

    def _subscribe(
        self,
        node: Node,
        name: str,
        reliable: bool,
        depth: int,
        content: _Content,
    ) -> None:
        """Subscribe anew; what waits in ``content`` stays."""
        if name in self._topics:
            node.destroy_subscription(self._topics.pop(name).subscription)
        subscription = node.create_subscription(
            DiagnosticArray,
            name,
            _never_called,
            QoSProfile(
                history=HistoryPolicy.KEEP_LAST,
                depth=depth,
                reliability=ReliabilityPolicy.RELIABLE
                if reliable
                else ReliabilityPolicy.BEST_EFFORT,
                durability=DurabilityPolicy.VOLATILE,
            ),
            raw=True,
            # Each event that rclpy would watch for is one more thing to wait for.
            event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False),
        )
        take = subscription.handle.take_message
        self._topics[name] = _Subscription(subscription, take, reliable, depth, content)

    def _unsubscribe(self, node: Node, name: str) -> None:
        node.destroy_subscription(self._topics.pop(name).subscription)
        self._waiting.pop(name, None)
        for key in [key for key in self._logged if key[0] == name]:
            del self._logged[key]

    # -- messages ----------------------------------------------------------------------------

    def _drain_all(self, node: Node, topics: Iterator[tuple[str, _Subscription]]) -> None:
        """Take the bytes of what has arrived on these topics.

        Most of the time that is nothing: asking costs a microsecond, so nothing else is done here.
        """
        for name, topic in topics:
            first = topic.take(DiagnosticArray, True)
            if first is not None:
                self._drain(node, name, topic, first[0])
            if self.loop.stopping:
                return

    def _drain(self, node: Node, name: str, topic: _Subscription, first: bytes) -> None:
        """Queue the first message and what else has arrived, for at most ``DRAIN_TIME``."""
        until = time.monotonic() + DRAIN_TIME
        largest = len(first)
        topic.content.received = True
        self._put(name, topic.content, first)
        while time.monotonic() < until:
            taken = topic.take(DiagnosticArray, True)
            if taken is None:
                break
            largest = max(largest, len(taken[0]))
            self._put(name, topic.content, taken[0])
        dropped = topic.content.queue.dropped()
        if dropped:
            self._receiver.reject_dropped(Topic(self._domain_id, name), dropped)
            self._log_seldom(
                name,
                "rate",
                "domain %d, %s: more arrives than is decoded, %d messages were dropped just now, "
                "the oldest first; counted as rate",
                dropped,
            )
        if largest * topic.depth > MAX_HISTORY:
            depth = max(1, MAX_HISTORY // largest)
            self._subscribe(node, name, topic.reliable, depth, topic.content)

    def _put(self, name: str, content: _Content, data: bytes) -> None:
        if len(data) <= MAX_MESSAGE:
            content.queue.put(data)
            self._waiting[name] = content
        else:
            error = f"{len(data)} bytes, more than {MAX_MESSAGE} are not decoded"
            self._undecodable(name, error, read_clocks())

    def _decode_waiting(self) -> None:
        """Decode what waits, the topics that have cost least first, for ``DECODE_TIME``."""
        begin = time.monotonic()
        spent = _Spent()
        due = [each for each in self._waiting.items() if each[1].queue.is_due(begin)]
        due.sort(key=lambda each: each[1].queue.cost(begin))
        for name, content in due:
            while content.queue.is_due(now := time.monotonic()):
                if self.loop.stopping or now - begin >= DECODE_TIME:
                    break
                self._run_safely(partial(self._receive, name, content, spent))
            if not content.queue:
                del self._waiting[name]
        self._listener.count(spent.decode, spent.ingest)

    def _receive(self, name: str, content: _Content, spent: _Spent) -> None:
        now = read_clocks()
        begin = time.thread_time()
        array = self._decode(name, content, now)
        decoded = time.thread_time()
        try:
            if array is not None:
                self._receiver.receive(Topic(self._domain_id, name), array, now)
        finally:
            end = time.thread_time()
            content.queue.spend(end - begin)
            spent.decode += decoded - begin
            spent.ingest += end - decoded

    def _decode(self, name: str, content: _Content, now: Instant) -> Array | None:
        data = content.queue.get()
        try:
            return content.decoder.decode(data) if is_cdr(data) else decode(data)
        except ValueError as error:
            self._undecodable(name, str(error), now)
            return None

    def _undecodable(self, name: str, error: str, now: Instant) -> None:
        self._log_seldom(
            name, "undecodable", "domain %d, %s: undecodable message dropped: %s", error
        )
        self._receiver.reject_undecodable(Topic(self._domain_id, name), error, now)

    def _log_seldom(self, name: str, kind: str, text: str, what: object) -> None:
        now = time.monotonic()
        if now - self._logged.get((name, kind), -LOG_INTERVAL) >= LOG_INTERVAL:
            self._logged[name, kind] = now
            log.warning(text, self._domain_id, name, what)
