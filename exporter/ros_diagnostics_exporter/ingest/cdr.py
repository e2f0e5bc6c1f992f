"""A serialized DiagnosticArray -> Array, without ROS.

The layout is that of the OMG's CDR (formal/02-06-51, 15.3): a header of four bytes that says the
order of bytes, numbers aligned to their size, strings with their length and a closing zero. rclpy's
deserialization costs twice as much and more, as its objects are copied into ours
(`./run bench ingest`).
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from struct import Struct, error
from typing import NamedTuple

from ros_diagnostics_exporter.model import Array, Status

MAX_KEPT = 1 << 18  # bytes of a message that a decoder keeps
MAX_CACHED = 256  # bytes of a name or key that is cached, which limits the cache

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
            _frame_id, at = _text(data, 12, number)
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
            ((name, message),), at = _pairs(data, at + 1, 1, number)
            hardware_id, at = _text(data, at, number)
            at = at + 3 & -4
            values, at = _pairs(data, at + 4, number(data, at)[0], number)
            status = Status(level, name, message, hardware_id, values)
            decoded.append(_Decoded(begin, data[begin:at], status))
        return decoded, at


def decode(data: bytes) -> Array:
    """One message, without those before it; raises as `Decoder.decode`."""
    return Decoder().decode(data)


def is_cdr(data: bytes) -> bool:
    """Whether the bytes begin as this encoding does; DDS knows others, which ROS does not use."""
    return len(data) >= 4 and data[0] == 0 and data[1] <= 1


def _text(data: bytes, at: int, number: _Unpack) -> tuple[str, int]:
    """(the text at an offset, which is aligned first; the offset behind it)."""
    at = (at + 3 & -4) + 4
    end = at + number(data, at - 4)[0]
    return _until_zero(data[at : end - 1]), end


def _pairs(
    data: bytes, at: int, count: int, number: _Unpack
) -> tuple[tuple[tuple[str, str], ...], int]:
    """(so many names with a text each from an offset on; the offset behind them)."""
    names, texts = [], []
    for _ in range(count):
        at = (at + 3 & -4) + 4
        end = at + number(data, at - 4)[0]
        name = data[at : end - 1]
        names.append(_cached(name) if len(name) <= MAX_CACHED else _until_zero(name))
        at = (end + 3 & -4) + 4
        end = at + number(data, at - 4)[0]
        texts.append(data[at : end - 1].decode(errors="replace"))
        at = end
    if "\0" in "".join(texts):
        texts = [text.partition("\0")[0] for text in texts]
    return tuple(zip(names, texts, strict=True)), at


def _until_zero(raw: bytes) -> str:
    """The first zero ends a text, as in ROS' own strings."""
    return raw.decode(errors="replace").partition("\0")[0]


# A fleet's robots have the same names and keys: each is decoded, and stored, once.
_cached = lru_cache(maxsize=65_536)(_until_zero)
