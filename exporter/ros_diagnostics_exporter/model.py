"""The value types that all packages share.

Imports nothing else of the exporter and nothing of ROS.
"""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum, IntEnum
from typing import Final, Literal, NamedTuple


class Level(IntEnum):
    """A status level as diagnostic_msgs/DiagnosticStatus defines it.

    The number is no severity: STALE (3) is not worse than ERROR (2).
    """

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Part(str, Enum):
    """A part of the exposition, as ``/metrics?collect[]=`` names it."""

    FAULTS = "faults"  # what alerts on faults need
    ROBOTS = "robots"  # everything else about the fleet
    EXPORTER = "exporter"  # everything else about the exporter


ALL_PARTS = frozenset(Part)


class Status(NamedTuple):
    """One diagnostic_msgs/DiagnosticStatus.

    ``level`` is the byte as received (0..255, not validated); ``values`` are the key-values in
    their order, duplicate keys included, perhaps decoded anew at each reading (`decode.cdr`). All
    strings are valid Unicode (ROS replaces bad UTF-8).
    """

    level: int
    name: str
    message: str = ""
    hardware_id: str = ""
    values: Sequence[tuple[str, str]] = ()


class Array(NamedTuple):
    """One diagnostic_msgs/DiagnosticArray.

    ``stamp`` is header.stamp in seconds since the epoch (0.0 where the publisher left it out);
    ``size`` is the length of the serialized message in bytes, ``raw`` that message, ``publisher``
    who published it, the same as long as that publisher exists ("" where the source does not say).
    """

    stamp: float
    statuses: tuple[Status, ...]
    size: int = 0
    raw: bytes = b""
    publisher: str = ""


class Feed(NamedTuple):
    """One kind of statuses that a source beside ROS delivers of robots, such as a query's answers.

    Neither its arrays nor their absence show whether a robot is alive, and they are partial: a
    component is STALE ``stale_after`` seconds after it was last in one, which is no fault with
    ``planned_stale``. ``confirm_after`` is None where the robot's profile says it; ``group`` is the
    group of its components. What fails of an ``uplink`` makes robots unreachable that name the
    component's robot as theirs. What fails of a ``shadow`` is shown, and is no fault. ``numbers``:
    those in its key-values are series of their own; else only where the config has a rule for them.
    What is ``sent`` is what the robot itself sent: it is no measurement that may fail in its place.
    """

    name: str
    group: str
    stale_after: float
    confirm_after: float | None = None
    planned_stale: bool = False
    uplink: bool = False
    shadow: bool = False
    numbers: bool = True
    sent: bool = False


class Instant(NamedTuple):
    """Both clocks at one moment, in seconds.

    Ages are differences of ``mono``, which never steps; ``wall`` (Unix time) is for people.
    """

    mono: float
    wall: float


class Downtime(NamedTuple):
    """A downtime that a person planned, of a robot or of its components of one name ("": all).

    ``start`` and ``end`` are Unix times, the end exclusive.
    """

    robot: str
    component: str
    start: float
    end: float
    author: str
    comment: str

    def holds(self, wall: float) -> bool:
        """Whether it holds at a Unix time."""
        return self.start <= wall < self.end


ZENOH: Final = "zenoh"
Domain = int | Literal["zenoh"]  # a DDS domain, or what zenoh's routers connect


def place(domain: Domain) -> str:
    """A domain in words."""
    return f"domain {domain}" if isinstance(domain, int) else domain


class Topic(NamedTuple):
    """A topic of one domain; of zenoh, "/" and the key."""

    domain_id: Domain
    name: str


class Unclaimed(NamedTuple):
    """Topics of one robot that nobody monitors, and what to write below ``robots`` of fleet.yml."""

    domain_id: Domain
    topics: tuple[str, ...]
    entry: str

    def __str__(self) -> str:
        """One line, for people."""
        topics = " and ".join(self.topics)
        return f"{topics} in {place(self.domain_id)}; to monitor it, add to robots: - {self.entry}"


class Stream(NamedTuple):
    """What is kept together of what is received: messages of one topic and type.

    ``robot`` is whose they are on a topic of all nodes, and "" where a topic's are kept as one.
    """

    topic: Topic
    kind: str = "diagnostic_msgs/msg/DiagnosticArray"
    robot: str = ""


class Endpoint(NamedTuple):
    """What the ROS graph shows of one topic.

    ``publishers`` counts those of DiagnosticArray; ``wrong_type`` is another type that some
    publisher offers, "" where there is none; ``reliable``: every publisher offers reliable
    delivery; ``is_cut_off``: none is there, because what connected the last is gone; ``refused`` is
    the policy because of which none of them matches the subscription, "" where one does;
    ``writers`` are the publishers as `Array` names them, none where that is not known.
    """

    publishers: int
    wrong_type: str = ""
    reliable: bool = True
    is_cut_off: bool = False
    refused: str = ""
    writers: frozenset[str] = frozenset()

    @property
    def is_offered(self) -> bool:
        """Whether anybody publishes it, of whatever type."""
        return bool(self.publishers or self.wrong_type)


class Person(NamedTuple):
    """Who acts by a form: the user that has logged in, why, and from which address."""

    user: str
    comment: str
    address: str
