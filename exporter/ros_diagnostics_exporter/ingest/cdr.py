"""A recorded DiagnosticArray -> Array, without ROS.

The layout is that of the OMG's CDR (formal/02-06-51, 15.3): a header of four bytes that says the
order of bytes, numbers aligned to their size, strings with their length and a closing zero.
`ros.decode` does the same with rclpy, for what arrives over DDS.
"""

from __future__ import annotations

from collections.abc import Callable
from struct import Struct, error

from ros_diagnostics_exporter.model import Array, Status

_Unpack = Callable[[bytes, int], tuple[int, ...]]
_LITTLE = Struct("<I").unpack_from, Struct("<iI").unpack_from
_BIG = Struct(">I").unpack_from, Struct(">iI").unpack_from


def decode(data: bytes) -> Array:
    """One serialized diagnostic_msgs/DiagnosticArray.

    Raises:
        ValueError: the bytes are no such message.
    """
    if len(data) < 4 or data[0] != 0 or data[1] > 1:
        raise ValueError("does not begin as a serialized ROS 2 message does")
    number, stamp = _LITTLE if data[1] else _BIG
    try:
        seconds, nanoseconds = stamp(data, 4)
        _frame_id, at = _texts(data, 12, 1, number)
        statuses, at = _statuses(data, at + 3 & -4, number)
    except (error, IndexError):
        at = len(data) + 1
    if at > len(data):
        raise ValueError("ends within a DiagnosticArray")
    return Array(seconds + nanoseconds * 1e-9, tuple(statuses), len(data))


def _statuses(data: bytes, at: int, number: _Unpack) -> tuple[list[Status], int]:
    """(the statuses at an offset, the offset behind them)."""
    (count,) = number(data, at)
    at += 4
    statuses = []
    for _ in range(count):
        level = data[at]
        (name, message, hardware_id), at = _texts(data, at + 1, 3, number)
        at = at + 3 & -4
        (pairs,) = number(data, at)
        texts, at = _texts(data, at + 4, 2 * pairs, number)
        values = tuple(zip(texts[::2], texts[1::2], strict=True))
        statuses.append(Status(level, name, message, hardware_id, values))
    return statuses, at


def _texts(data: bytes, at: int, count: int, number: _Unpack) -> tuple[list[str], int]:
    """(so many texts from an offset on, each aligned; the offset behind them)."""
    texts = []
    for _ in range(count):
        at = (at + 3 & -4) + 4
        end = at + number(data, at - 4)[0]
        texts.append(data[at : end - 1].decode(errors="replace"))
        at = end
    return texts, at
