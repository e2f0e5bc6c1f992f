"""The nouns that every room shares: a level, a status, an array, an instant.

Imports nothing of ours, and nothing of ROS: what a message means stays true whatever carried it.
"""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class Level(IntEnum):
    """A status level as diagnostic_msgs/DiagnosticStatus defines it.

    Its number is a name, not a rank: STALE (3) is not worse than ERROR (2).
    """

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Status(NamedTuple):
    """One diagnostic_msgs/DiagnosticStatus.

    ``level`` is the byte on the wire (0..255, not yet judged); ``values`` are the key-values in
    their order, duplicate keys included. All strings are valid Unicode (ROS replaces bad UTF-8).
    """

    level: int
    name: str
    message: str = ""
    hardware_id: str = ""
    values: tuple[tuple[str, str], ...] = ()


class Array(NamedTuple):
    """One diagnostic_msgs/DiagnosticArray.

    ``stamp`` is header.stamp in seconds since the epoch (0.0 where the publisher left it out);
    ``size`` is the length of the serialized message in bytes.
    """

    stamp: float
    statuses: tuple[Status, ...]
    size: int = 0


class Instant(NamedTuple):
    """A reading of both clocks at one moment, in seconds.

    Ages are differences of ``mono`` (never steps); ``wall`` (Unix time) is for people.
    """

    mono: float
    wall: float
