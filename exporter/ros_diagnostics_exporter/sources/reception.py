"""What is received in one domain: its thread, its subscribed topics, bytes -> Array.

Nothing that one publisher does may slow what belongs to others. So a domain's thread works in
turns: a piece of the look at the graph; the bytes of all topics, which is cheap; then decoding, the
topics that have cost least first, for a bounded time. What a topic sends beyond its share is
dropped (`TopicQueue`).
"""

from __future__ import annotations

import logging
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, field
from functools import partial
from math import inf
from typing import Any

from ros_diagnostics_exporter.config.fleet import Limits
from ros_diagnostics_exporter.decode.cdr import SHARE, SHARED, Decoder, TopicQueue, is_cdr
from ros_diagnostics_exporter.loops import Loop, read_clocks
from ros_diagnostics_exporter.model import Array, Domain, Instant, Topic, place
from ros_diagnostics_exporter.sources.addresses import local_addresses
from ros_diagnostics_exporter.sources.handover import OVERLAP, Handovers, Taking
from ros_diagnostics_exporter.sources.link import Link
from ros_diagnostics_exporter.sources.receiver import Receiver
from ros_diagnostics_exporter.texts import one_line

log = logging.getLogger(__name__)

# Whole fleets publish at the same moment of the second; a shallow queue loses such bursts
# (ros/diagnostics#195).
DEPTH = 1000
# Seconds between two looks whether messages have arrived. The moment of receipt is known this well;
# asking 1,000 topics costs a millisecond.
TAKE_INTERVAL = 0.1
NOT_LOOKED = 30.0  # ... without a look at the graph after which that is a fault
LOG_INTERVAL = 60.0  # seconds between two lines about the same trouble
# Bytes that the middleware may hold of one topic: a topic of large messages gets a shallower queue.
MAX_HISTORY = 64 << 20
# Seconds of one turn: for the look at the graph, for taking one topic's bytes, for decoding.
LOOK_TIME, DRAIN_TIME, DECODE_TIME = 0.05, 0.05, 0.25
# A graph of thousands costs a look a tenth of a second. While it stays the same, at most this share
# of the time is spent on looks: they are further apart than ``poll_interval``, up to five times.
LOOK_SHARE, MAX_STRETCH = 0.02, 5
MAX_ERROR = 200  # characters of why a domain could not be joined
Count = Callable[[float, float], None]  # takes CPU seconds of decoding, and of taking in


@dataclass(slots=True)
class Content:
    """What is received on a topic, whichever subscription brings it."""

    queue: TopicQueue
    decoder: Decoder = field(default_factory=Decoder)
    received_at: float = 0.0  # when bytes were last taken, monotonic
    link: Link = field(default_factory=Link)


@dataclass(slots=True)
class Subscription:
    """A subscribed topic; ``depth`` is how many messages the middleware holds of it.

    ``take`` returns what `Reception.data` makes bytes of, or None where nothing has arrived.
    ``offer`` is what is known of the publishers and decides how to subscribe.
    """

    take: Callable[[], Any]
    close: Callable[[], object]
    offer: object
    depth: int
    content: Content


@dataclass(slots=True)
class _Spent:
    """CPU seconds of one turn."""

    decode: float = 0.0
    ingest: float = 0.0


class Reception(ABC):
    """One domain: a thread that joins it, takes what arrives, and leaves it.

    ``settings`` are those of the config by which it is joined; a message of more than
    ``max_message`` bytes is not decoded.
    """

    def __init__(
        self,
        domain: Domain,
        receiver: Receiver,
        count: Count,
        poll_interval: float,
        settings: object = None,
    ) -> None:
        self.settings = settings
        self.poll_interval = poll_interval
        self.receiver = receiver
        self.max_message = Limits().message_bytes
        self.topics: dict[str, Subscription] = {}
        self._handovers = Handovers(self.identity)
        self.error = ""  # why it could not be joined
        self.look_error = ""  # the last one since the graph was looked at in full
        self.take_error = ""  # of the last turn's messages
        self.odd = ""  # what the graph has that cannot be read
        self._failed = ""  # the last piece of work
        self.last_look = 0.0  # Unix time
        self._looked = 0.0  # when the graph was last looked at in full, or joined, monotonic
        self.last_turn = 0.0
        self.joined_at = inf  # monotonic
        self.addresses: frozenset[str] = frozenset()  # of this machine when it was joined
        self.look_at = 0.0  # when the graph is looked at again, monotonic
        self.is_same = False  # what the look under way, or the last one, has found as before
        self._domain = domain
        self._count = count
        self._waiting: dict[str, Content] = {}  # topics with messages to decode
        self._logged: dict[tuple[str, str], float] = {}
        self._look: Iterator[None] | None = None
        self._look_cost = 0.0  # CPU seconds of that look
        self._is_open = False
        self.loop = Loop(f"domain-{domain}", TAKE_INTERVAL, self._turn, end=self.leave)

    # -- what each middleware does in its own way -----------------------------------------------

    @abstractmethod
    def join(self) -> None:
        """Join the domain; whatever is raised is why it could not be."""

    @abstractmethod
    def leave(self) -> None:
        """Leave the domain, also where it was not joined."""

    @abstractmethod
    def look(self) -> Iterator[None]:
        """Report what the graph shows, and subscribe what is wanted; in small pieces."""

    @abstractmethod
    def open(
        self, name: str, offer: Any, depth: int
    ) -> tuple[Callable[[], Any], Callable[[], object]]:
        """(take, close) of a new subscription; see `Subscription`."""

    @abstractmethod
    def data(self, taken: Any) -> bytes:
        """The bytes of what was taken."""

    def identity(self, taken: Any) -> Hashable:
        """What tells a message from the others of a few seconds."""
        return hash(self.data(taken))

    def publisher(self, taken: Any) -> str:  # noqa: ARG002 - of those that override
        """Who published what was taken; "" where the middleware does not say it."""
        return ""

    def measure(self, link: Link, taken: Any) -> None:  # noqa: ARG002 - of those that override
        """Note how what was taken arrived, and from whom, where the middleware says so."""
        return

    def decode(self, data: bytes) -> Array:
        """A message in another encoding than CDR; ValueError where there is none such."""
        raise ValueError(f"not a ROS message (CDR): it begins with {data[:4].hex() or 'nothing'}")

    def check(self) -> None:
        """Look whether it is still joined, at each turn; sets ``error``."""
        return

    # -- joined and left ------------------------------------------------------------------------

    @property
    def alive(self) -> bool:
        """Whether the thread runs: it joins, works, or leaves."""
        return self.loop.alive and not (self.error and self.loop.stopping)

    @property
    def joined(self) -> bool:
        """Whether messages are taken."""
        return self.alive and self._is_open and not (self.error or self.loop.stopping)

    @property
    def joining(self) -> bool:
        """Whether the domain is not joined yet."""
        return self.alive and not (self._is_open or self.error or self.loop.stopping)

    def wait(self, seconds: float) -> None:
        """Wait until the domain is left, at most so many seconds."""
        if not self.loop.stop(seconds):
            log.warning("%s is not left yet: its thread still runs", place(self._domain))

    def give_up(self, error: Exception) -> None:
        """Note why the domain could not be joined; it may be joined anew."""
        self.loop.ask_to_stop()
        log.error("cannot join %s", place(self._domain), exc_info=error)
        self.fail(str(error) or type(error).__name__)

    def fail(self, why: str) -> None:
        """Note that the domain is not joined."""
        self.error = one_line(why).strip()[:MAX_ERROR]
        self.receiver.domain_failed(self._domain, self.error, read_clocks())

    def _turn(self) -> None:
        """Join the domain at the first turn; take what has arrived at all others."""
        if self._is_open:
            self._take()
            return
        if time.monotonic() < self.look_at:
            return
        self.addresses = local_addresses()
        try:
            self.join()
        except Exception as error:  # noqa: BLE001 - whatever the middleware raises; others go on
            self.give_up(error)
            return
        self.last_turn = self._looked = self.joined_at = time.monotonic()
        self._is_open = True
        if not (self.loop.stopping or self.error):
            self.receiver.domain_joined(self._domain)

    def _take(self) -> None:
        """Look at the graph when that is due, and take what has arrived."""
        self.check()
        self._failed = ""
        self.run_safely(self._look_on)
        self.look_error, self._failed = self._failed or self.look_error, ""
        topics = iter(list(self.topics.items()))
        while not self.run_safely(partial(self._drain_all, topics)):
            pass  # the topics after the one that failed
        self._decode_waiting()
        self.run_safely(self._end_handovers)
        self.take_error = self._failed
        self.last_turn = time.monotonic()

    def run_safely(self, work: Callable[[], object]) -> bool:
        """Run one piece of work; a bug with one robot's messages must not stop the domain.

        Whether it was done without an error.
        """
        try:
            work()
        except Exception as error:
            self.loop.errors += 1
            self._failed = one_line(f"{error}")[:MAX_ERROR] or type(error).__name__
            self.log_seldom("", "error", "%s%s: internal error: %s", error)
            log.debug("%s", place(self._domain), exc_info=True)
            return False
        return True

    def complete_look(self, now: Instant) -> None:
        """Note that the graph was looked at in full."""
        self.last_look, self._looked, self.look_error = now.wall, now.mono, ""

    @property
    def trouble(self) -> str:
        """Why not all of the domain is received; "" where nothing is wrong."""
        if not self.joined:
            return f"it is not joined: {self.error or 'it is still being joined'}"
        if time.monotonic() - self._looked > NOT_LOOKED:
            why = self.look_error and f": {self.look_error}"
            return f"its ROS graph was not looked at for more than {NOT_LOOKED:.0f} s{why}"
        return self.take_error and f"its messages are not taken: {self.take_error}"

    def _look_on(self) -> None:
        """Go on with the look under way, or begin one that is due, for at most ``LOOK_TIME``."""
        begin, cpu = time.monotonic(), time.thread_time()
        if self._look is None:
            if begin < self.look_at:
                return
            self.look_at = begin + self.poll_interval
            self._look, self._look_cost, self.is_same = self.look(), 0.0, False
        for _ in self._look:
            if time.monotonic() - begin >= LOOK_TIME:
                break
        else:
            self._look = None
        self._look_cost += time.thread_time() - cpu
        if self._look is None and self.is_same:
            apart = min(self._look_cost / LOOK_SHARE, MAX_STRETCH * self.poll_interval)
            self.look_at = max(self.look_at, begin + apart)

    # -- topics ---------------------------------------------------------------------------------

    def want(self, name: str, offer: object, *, shared: bool) -> None:
        """Subscribe a topic, or have it follow what its publishers offer now."""
        share = SHARED if shared else SHARE
        topic = self.topics.get(name)
        if topic is None:
            self._subscribe(name, offer, DEPTH, Content(TopicQueue(share)))
            return
        topic.content.queue.share = share
        if topic.offer != offer:
            self._subscribe(name, offer, topic.depth, topic.content)

    def _subscribe(self, name: str, offer: object, depth: int, content: Content) -> None:
        """Subscribe, or anew; what waits in ``content`` stays."""
        new, old = Taking(*self.open(name, offer, depth)), self.topics.get(name)
        if old is not None:
            before = Taking(old.take, old.close)
            new = self._handovers.begin(name, before, new, time.monotonic() + OVERLAP)
        self.topics[name] = Subscription(*new, offer, depth, content)

    def unsubscribe(self, name: str) -> None:
        """Take no more of a topic."""
        self._handovers.forget(name)
        self.topics.pop(name).close()
        self._waiting.pop(name, None)
        for key in [key for key in self._logged if key[0] == name]:
            del self._logged[key]

    def _end_handovers(self) -> None:
        """End subscriptions that others have replaced."""
        for name, new in self._handovers.end(time.monotonic()).items():
            self.topics[name].take, self.topics[name].close = new

    # -- messages -------------------------------------------------------------------------------

    def _drain_all(self, topics: Iterator[tuple[str, Subscription]]) -> None:
        """Take the bytes of what has arrived on these topics.

        Most of the time that is nothing: asking costs a microsecond, so nothing else is done here.
        """
        for name, topic in topics:
            first = topic.take()
            if first is not None:
                self._drain(name, topic, first)
            if self.loop.stopping:
                return

    def _drain(self, name: str, topic: Subscription, taken: Any) -> None:
        """Queue the first message and what else has arrived, for at most ``DRAIN_TIME``."""
        topic.content.received_at = time.monotonic()
        until = topic.content.received_at + DRAIN_TIME
        largest = 0
        while taken is not None:
            self.measure(topic.content.link, taken)
            data = self.data(taken)
            largest = max(largest, len(data))
            self._put(name, topic.content, data, self.publisher(taken))
            taken = topic.take() if time.monotonic() < until else None
        dropped = topic.content.queue.dropped()
        if dropped:
            self.receiver.reject_dropped(Topic(self._domain, name), dropped)
            self.log_seldom(
                name,
                "rate",
                "%s, %s: more arrives than is decoded, %d messages were dropped just now, "
                "the oldest first; they are counted with the reason rate",
                dropped,
            )
        if largest * topic.depth > MAX_HISTORY:
            depth = max(1, MAX_HISTORY // largest)
            self._subscribe(name, topic.offer, depth, topic.content)

    def _put(self, name: str, content: Content, data: bytes, publisher: str) -> None:
        if len(data) <= self.max_message:
            content.queue.put(data, publisher)
            self._waiting[name] = content
        else:
            error = f"{len(data)} bytes, more than {self.max_message} are not decoded"
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
                self.run_safely(partial(self._receive, name, content, spent))
            if not content.queue:
                del self._waiting[name]
        self._count(spent.decode, spent.ingest)

    def _receive(self, name: str, content: Content, spent: _Spent) -> None:
        now = read_clocks()
        begin = time.thread_time()
        array = self._decode(name, content, now)
        decoded = time.thread_time()
        try:
            if array is not None:
                self.receiver.receive(Topic(self._domain, name), array, now)
        finally:
            end = time.thread_time()
            content.queue.spend(end - begin)
            spent.decode += decoded - begin
            spent.ingest += end - decoded

    def _decode(self, name: str, content: Content, now: Instant) -> Array | None:
        data, publisher = content.queue.get()
        try:
            return content.decoder.decode(data, publisher) if is_cdr(data) else self.decode(data)
        except ValueError as error:
            self._undecodable(name, str(error), now)
            return None

    def _undecodable(self, name: str, error: str, now: Instant) -> None:
        self.log_seldom(name, "undecodable", "%s, %s: undecodable message dropped: %s", error)
        self.receiver.reject_undecodable(Topic(self._domain, name), error, now)

    def log_seldom(self, name: str, kind: str, text: str, what: object) -> None:
        """Log a text with the domain, a topic and ``what``, at most once in ``LOG_INTERVAL``."""
        now = time.monotonic()
        if now - self._logged.get((name, kind), -LOG_INTERVAL) >= LOG_INTERVAL:
            self._logged[name, kind] = now
            log.warning(text, place(self._domain), name, what)
