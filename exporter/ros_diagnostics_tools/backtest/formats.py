"""What all formats of recordings share: rows in order of time, and what is wrong with a file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple, Protocol

from ros_diagnostics_exporter.model import Array

TYPE = "diagnostic_msgs/msg/DiagnosticArray"
ROS1_TYPE = "diagnostic_msgs/DiagnosticArray"
SHOWN = 300  # characters of a library's error about a damaged file


class RecordingError(Exception):
    """A file cannot be read as a recording; the text names it."""


class Ros1(bytes):
    """A message as ROS 1 serializes it; plain bytes are CDR."""

    __slots__ = ()


class Undecodable(str):
    """In place of a message of a text: where it is, and why it cannot be decoded."""

    __slots__ = ()


class Fields(NamedTuple):
    """A message of a small topic in CDR: its type, that type's definition ("": none is there)."""

    kind: str
    definition: str
    data: bytes


Wanted = Callable[[str], bool]  # whether a topic of another type than diagnostics is read, too
Content = bytes | Array | Undecodable | Fields
Row = tuple[float, str, Content]  # Unix time of receipt, topic, message


def nothing(_topic: str) -> bool:
    """Read no such topic."""
    return False


class Format(Protocol):
    """One opened file: when it begins and ends (Unix time), its topics, how many messages.

    ``others`` are the types of topics that hold no diagnostics; ``warnings`` say what could not be
    read, those about damage once all of `messages` were taken.
    """

    topics: set[str]
    others: dict[str, str]
    count: int
    begin: float
    end: float
    warnings: list[str]

    def messages(self) -> Iterator[Row]:
        """All of it in order of time."""

    def close(self) -> None:
        """Close the file."""


def shortened(error: Exception) -> str:
    """What a library says of a file."""
    return (str(error) or type(error).__name__)[:SHOWN]
