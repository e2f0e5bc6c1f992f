"""A serialized DiagnosticArray -> Array, without ROS.

The layout is that of the OMG's CDR (formal/02-06-51, 15.3): a header of four bytes that says the
order of bytes, numbers aligned to their size, strings with their length and a closing zero. rclpy's
deserialization costs 1.7 times as much, as its objects are copied into ours (`./run bench ingest`).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from struct import Struct, error, unpack_from
from typing import NamedTuple

from ros_diagnostics_exporter.model import Array, Status

MAX_KEPT = 1 << 18  # bytes of a message that a decoder keeps

_Words = Sequence[int]
_STAMP = Struct(">iI").unpack_from, Struct("<iI").unpack_from  # by the second byte of a message
_NATIVE = int(sys.byteorder == "little")


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
        words = _words(data)
        try:
            seconds, nanoseconds = _STAMP[data[1]](data, 4)
            _frame_id, at = _texts(data, 12, 1, words)
            decoded, at = self._statuses(data, at + 3 & -4, words)
        except (error, IndexError):
            at = len(data) + 1
        if at > len(data):
            raise ValueError("ends within a DiagnosticArray")
        self._before = decoded if len(data) <= MAX_KEPT else []
        statuses = tuple([each.status for each in decoded])
        return Array(seconds + nanoseconds * 1e-9, statuses, len(data))

    def _statuses(self, data: bytes, at: int, words: _Words) -> tuple[list[_Decoded], int]:
        """(the statuses at an offset, the offset behind them)."""
        count = words[at >> 2]
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
            (name, message, hardware_id), at = _texts(data, at + 1, 3, words)
            at = at + 7 & -4
            texts, at = _texts(data, at, 2 * words[(at >> 2) - 1], words)
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


def _words(data: bytes) -> _Words:
    """All of it as numbers of four bytes, for those that are numbers: faster than one by one."""
    count = len(data) >> 2
    if data[1] == _NATIVE:
        return memoryview(data)[: 4 * count].cast("I")
    return unpack_from(f"{'<' if data[1] else '>'}{count}I", data)


def _texts(data: bytes, at: int, count: int, words: _Words) -> tuple[list[str], int]:
    """(so many texts from an offset on, each aligned; the offset behind them)."""
    texts = []
    for _ in range(count):
        at = at + 7 & -4  # behind the length
        end = at + words[(at >> 2) - 1]
        texts.append(data[at : end - 1].decode("utf-8", "replace"))
        at = end
    if "\0" in "".join(texts):  # the first zero ends a text, as in ROS' own strings
        texts = [text.partition("\0")[0] for text in texts]
    return texts, at
