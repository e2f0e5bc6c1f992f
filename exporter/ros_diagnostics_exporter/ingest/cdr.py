"""A serialized DiagnosticArray -> Array, without ROS.

The layout is that of the OMG's CDR (formal/02-06-51, 15.3): a header of four bytes that says the
order of bytes, numbers aligned to their size, strings with their length and a closing zero. rclpy's
deserialization costs twice as much and more, as its objects are copied into ours
(`./run bench ingest`).
"""

from __future__ import annotations

from collections.abc import Callable
from struct import Struct, error
from typing import NamedTuple

from ros_diagnostics_exporter.model import Array, Status

MAX_KEPT = 1 << 18  # bytes of a message that a decoder keeps

_Unpack = Callable[[bytes, int], tuple[int, ...]]
_LITTLE = Struct("<I").unpack_from, Struct("<iI").unpack_from
_BIG = Struct(">I").unpack_from, Struct(">iI").unpack_from


class _Decoded(NamedTuple):
    """A status, the bytes that it was decoded from, and where they began."""

    at: int
    raw: bytes
    status: Status


class Decoder:
    """Decodes the messages of one topic.

    A status whose bytes are those of the message before, at the same place in the list, is the same
    object again: most of what a robot publishes does not change from one message to the next.
    """

    __slots__ = ("_before",)

    def __init__(self) -> None:
        self._before: list[_Decoded] = []

    def decode(self, data: bytes) -> Array:
        """One serialized diagnostic_msgs/DiagnosticArray.

        Raises:
            ValueError: the bytes are no such message.
        """
        if not is_cdr(data):
            raise ValueError("does not begin as a serialized ROS 2 message does")
        number, stamp = _LITTLE if data[1] else _BIG
        try:
            seconds, nanoseconds = stamp(data, 4)
            _frame_id, at = _texts(data, 12, 1, number)
            decoded, at = self._statuses(data, at + 3 & -4, number)
        except (error, IndexError):
            at = len(data) + 1
        if at > len(data):
            raise ValueError("ends within a DiagnosticArray")
        self._before = decoded if len(data) <= MAX_KEPT else []
        statuses = tuple([each.status for each in decoded])
        return Array(seconds + nanoseconds * 1e-9, statuses, len(data))

    def _statuses(self, data: bytes, at: int, number: _Unpack) -> tuple[list[_Decoded], int]:
        """(the statuses at an offset, the offset behind them)."""
        (count,) = number(data, at)
        at += 4
        before = self._before
        decoded: list[_Decoded] = []
        for index in range(count):
            if index < len(before):
                known = before[index]
                # Its numbers are aligned again only at an offset that differs by a multiple of 4.
                if not (at - known.at) & 3 and data.startswith(known.raw, at):
                    decoded.append(known)
                    at += len(known.raw)
                    continue
            begin = at
            level = data[at]
            (name, message, hardware_id), at = _texts(data, at + 1, 3, number)
            at = at + 3 & -4
            (pairs,) = number(data, at)
            texts, at = _texts(data, at + 4, 2 * pairs, number)
            values = tuple(zip(texts[::2], texts[1::2], strict=True))
            status = Status(level, name, message, hardware_id, values)
            decoded.append(_Decoded(begin, data[begin:at], status))
        return decoded, at


def decode(data: bytes) -> Array:
    """One message, without those before it; raises as `Decoder.decode`."""
    return Decoder().decode(data)


def is_cdr(data: bytes) -> bool:
    """Whether the bytes begin as this encoding does; DDS knows others, which ROS does not use."""
    return len(data) >= 4 and data[0] == 0 and data[1] <= 1


def _texts(data: bytes, at: int, count: int, number: _Unpack) -> tuple[list[str], int]:
    """(so many texts from an offset on, each aligned; the offset behind them)."""
    texts = []
    for _ in range(count):
        at = (at + 3 & -4) + 4
        end = at + number(data, at - 4)[0]
        texts.append(data[at : end - 1].decode(errors="replace"))
        at = end
    if "\0" in "".join(texts):  # the first zero ends a text, as in ROS' own strings
        texts = [text.partition("\0")[0] for text in texts]
    return texts, at
