"""A serialized DiagnosticArray -> Array, without ROS; and the queues of what waits for that.

The layout is that of the OMG's CDR (formal/02-06-51, 15.3): a header of four bytes that says the
order of bytes, numbers aligned to their size, strings with their length and a closing zero. rclpy's
deserialization costs twice as much and more, as its objects are copied into ours
(`./run bench ingest`).

Taking a message's bytes is cheap, decoding them is expensive. So a topic's messages are queued
as bytes, of which the oldest are dropped beyond a limit, and a topic that has used its share of CPU
time is decoded later. Pure: knows no ROS and no clock.
"""

from __future__ import annotations

import sys
from array import array
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from functools import lru_cache
from struct import Struct, error
from typing import NamedTuple, overload

from ros_diagnostics_exporter.model import Array, Status

MAX_KEPT = 1 << 18  # bytes of a message that a decoder keeps
MAX_CACHED = 256  # bytes of a name or key that is cached, which limits the cache

_Unpack = Callable[[bytes, int], tuple[int, ...]]
_LITTLE = Struct("<I").unpack_from, Struct("<iI").unpack_from
_BIG = Struct(">I").unpack_from, Struct(">iI").unpack_from


class KeyValues(Sequence[tuple[str, str]]):
    """The key-values of a serialized status, decoded at each reading.

    A robot sends ten times and more before anybody reads them, and their texts take several times
    the memory of the bytes. Equal to the tuple of the same key-values.
    """

    __slots__ = ("_at", "_count", "_number", "_raw", "_shift")

    def __init__(self, raw: bytes, at: int, shift: int, count: int, number: _Unpack) -> None:
        """``raw`` is the status, in which they begin ``at``, aligned with ``shift`` before it."""
        self._raw, self._at, self._shift = raw, at, shift
        self._count = count
        self._number = number

    @property
    def size(self) -> int:
        """Bytes: no text is longer."""
        return len(self._raw) - self._at

    def _decode(self) -> tuple[tuple[str, str], ...]:
        return _pairs(self._raw, self._at, self._count, self._number, self._shift)[0]

    def __len__(self) -> int:
        return self._count

    def __iter__(self) -> Iterator[tuple[str, str]]:
        return iter(self._decode())

    @overload
    def __getitem__(self, index: int) -> tuple[str, str]: ...
    @overload
    def __getitem__(self, index: slice) -> tuple[tuple[str, str], ...]: ...
    def __getitem__(self, index: int | slice) -> object:
        return self._decode()[index]

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, (tuple, KeyValues)):
            return NotImplemented
        return other is self or (len(other) == self._count and tuple(other) == self._decode())

    def __hash__(self) -> int:
        return hash(self._decode())

    def __repr__(self) -> str:
        return repr(self._decode())


class _Decoded(NamedTuple):
    """A status, the bytes that it was decoded from, and where they began.

    ``head`` is how many of them are before its key-values.
    """

    at: int
    head: int
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

    def decode(self, data: bytes, publisher: str = "") -> Array:
        """One serialized diagnostic_msgs/DiagnosticArray of a publisher.

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
        return Array(seconds + nanoseconds * 1e-9, statuses, len(data), data, publisher)

    def _statuses(self, data: bytes, at: int, number: _Unpack) -> tuple[list[_Decoded], int]:
        """(the statuses at an offset, the offset behind them)."""
        (count,) = number(data, at)
        at += 4
        before = self._before
        decoded: list[_Decoded] = []
        words: Sequence[int] = ()
        for index in range(count):
            begin, head = at, 0
            if index < len(before):
                known = before[index]
                # Its numbers are aligned again only at an offset that differs by a multiple of 4.
                if not (at - known.at) & 3 and data.startswith(known.raw, at):
                    decoded.append(known)
                    at += len(known.raw)
                    continue
                # Of most only the key-values change.
                if not (at - known.at) & 3 and data.startswith(known.raw[: known.head], at):
                    head = known.head
            if head:
                level, name, message, hardware_id, _values = known.status
                at += head
            else:
                level = data[at]
                ((name, message),), at = _pairs(data, at + 1, 1, number)
                hardware_id, at = _text(data, at, number)
                head = at - begin
            words = words or _words(data)
            values_at = (at + 3 & -4) + 4
            pairs = words[values_at // 4 - 1]
            at = _behind(words, values_at, 2 * pairs) if pairs else values_at
            raw = data[begin:at]
            values = KeyValues(raw, values_at - begin, begin & 3, pairs, number) if pairs else ()
            status = Status(level, name, message, hardware_id, values)
            decoded.append(_Decoded(begin, head, raw, status))
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
    return _until_zero(data[at : end - 1]) if end - at > 1 else "", end


def _words(data: bytes) -> Sequence[int]:
    """All numbers that a message may have where one begins, which is at each fourth byte."""
    words = array("I", data[: len(data) & -4])
    if data[1] != (sys.byteorder == "little"):
        words.byteswap()
    return words


def _behind(words: Sequence[int], at: int, count: int) -> int:
    """The offset behind so many texts, at least one, from an offset on.

    Only their lengths are looked at: a third of what decoding costs, where every value changed.
    """
    word = at // 4
    for _ in range(count - 1):
        word += words[word] + 7 >> 2
    return 4 * word + 4 + words[word]


def _pairs(
    data: bytes, at: int, count: int, number: _Unpack, shift: int = 0
) -> tuple[tuple[tuple[str, str], ...], int]:
    """(so many names with a text each from an offset on; the offset behind them).

    ``shift`` is where the data begins in the message, to whose begin they are aligned.
    """
    names, texts = [], []
    for _ in range(count):
        at = (at + shift + 3 & -4) - shift + 4
        end = at + number(data, at - 4)[0]
        name = data[at : end - 1]
        names.append(_cached(name) if len(name) <= MAX_CACHED else _until_zero(name))
        at = (end + shift + 3 & -4) - shift + 4
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


# -- what waits to be decoded --------------------------------------------------------------------


# 1,000 small arrays are a whole fleet on one shared topic, or two seconds of 50 drivers at 10 Hz.
MAX_MESSAGES = 1_000
MAX_BYTES = 4 << 20
# CPU seconds that one topic may use in a second: of a robot, and of a topic that robots share.
# 50 drivers that publish at 10 Hz on one topic need 0.06, 1,000 robots on a shared one 0.4.
SHARE, SHARED = 0.25, 0.75
# CPU seconds that a byte costs, roughly: to know a large message from a small one beforehand.
COST_OF_BYTE = 1e-7


class TopicQueue:
    """The messages of one topic that wait to be decoded.

    ``share`` is the CPU time, in seconds for each second, that the topic may use. A topic that has
    used nothing may use a second's share at once.
    """

    __slots__ = ("_at", "_bytes", "_debt", "_dropped", "_messages", "share")

    def __init__(self, share: float = SHARE) -> None:
        self.share = share
        self._messages: deque[tuple[bytes, str]] = deque()
        self._bytes = 0
        self._debt = 0.0
        self._at = 0.0
        self._dropped = 0

    def __len__(self) -> int:
        """How many messages wait."""
        return len(self._messages)

    def put(self, message: bytes, publisher: str = "") -> None:
        """Append a message of a publisher.

        What is beyond the limits goes, the oldest first, never the newest.
        """
        self._messages.append((message, publisher))
        self._bytes += len(message)
        while len(self._messages) > MAX_MESSAGES or (
            self._bytes > MAX_BYTES and len(self._messages) > 1
        ):
            self._bytes -= len(self._messages.popleft()[0])
            self._dropped += 1

    def get(self) -> tuple[bytes, str]:
        """Remove and return the oldest message, and its publisher.

        Raises:
            IndexError: none waits.
        """
        message, publisher = self._messages.popleft()
        self._bytes -= len(message)
        return message, publisher

    def dropped(self) -> int:
        """How many messages were dropped since this was asked last."""
        dropped, self._dropped = self._dropped, 0
        return dropped

    def spend(self, seconds: float) -> None:
        """Charge the CPU time that a message has cost.

        At most three seconds' share is owed: one message must not silence its robot for long.
        """
        self._debt = min(self._debt + seconds, 3 * self.share)

    def is_due(self, now: float) -> bool:
        """Whether a message waits and the share allows it; ``now`` is monotonic, in seconds."""
        return bool(self._messages) and self._pay(now) < self.share

    def cost(self, now: float) -> float:
        """What the topic has used of late and what waits will cost, in CPU seconds."""
        return self._pay(now) + self._bytes * COST_OF_BYTE

    def _pay(self, now: float) -> float:
        self._debt = max(0.0, self._debt - (now - self._at) * self.share)
        self._at = now
        return self._debt
