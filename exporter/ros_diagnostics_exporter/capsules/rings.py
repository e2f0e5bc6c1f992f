"""The last messages of each topic as they were received, compressed, in limited memory.

A message is appended as it comes; `compress` does the rest in a thread of its own.
"""

from __future__ import annotations

import threading
from collections import deque
from itertools import count

from ros_diagnostics_exporter.capsules.mcap import Chunk, OpenChunk
from ros_diagnostics_exporter.decode.cdr import is_cdr
from ros_diagnostics_exporter.model import Array, Instant, Topic

CHUNK = 16 << 10  # bytes of a chunk before it is compressed
WAITING = 16 << 20  # bytes that wait for `compress`; what is beyond is dropped
RING = 40 << 10  # compressed bytes of one topic for ``PER`` seconds; the oldest are dropped beyond
PER = 70.0


class Ring:
    """The last messages of one topic; ``channel`` is its number in every file."""

    __slots__ = ("_chunks", "_open", "channel")

    def __init__(self, channel: int) -> None:
        self.channel = channel
        self._chunks: deque[Chunk] = deque()
        self._open = OpenChunk(channel)

    def append(self, time: int, data: bytes, keep: float) -> None:
        """Append a message, and compress what a chunk is full of; ``keep`` is in seconds."""
        self._open.append(time, data)
        if len(self._open.content) >= CHUNK:
            self._chunks.append(self._open.compressed())
            self._open = OpenChunk(self.channel)
            self._drop(time - int(keep * 1e9), RING * max(1.0, keep / PER))

    def _drop(self, oldest: int, most: float) -> None:
        size = sum(len(each.data) for each in self._chunks)
        while len(self._chunks) > 1 and (size > most or self._chunks[0].end < oldest):
            size -= len(self._chunks.popleft().data)

    @property
    def size(self) -> int:
        """Bytes in memory."""
        return len(self._open.content) + sum(len(each.data) for each in self._chunks)

    def chunks(self, begin: int, end: int, before: float) -> list[Chunk]:
        """The chunks with what was received from ``begin`` to ``end`` (ns), and some before.

        Of a topic on which nothing was received of late, its last ``before`` seconds.
        """
        found = [*self._chunks, *([self._open.compressed()] if self._open.index else [])]
        if not found:
            return []
        begin = min(begin, found[-1].end - int(before * 1e9))
        return [each for each in found if each.end >= begin and each.begin <= end]


class Rings:
    """One for each topic. `receive` may be called from any thread, all else from one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[tuple[Topic, float, bytes]] = []
        self._waiting_bytes = 0
        self._rings: dict[Topic, Ring] = {}
        self._numbers = count()  # not how many there are: that of one forgotten would come again
        self.dropped = 0  # messages, because `compress` was late
        self.keep = PER  # seconds that are kept of each topic

    def receive(self, topic: Topic, array: Array, now: Instant) -> None:
        """Append a message."""
        with self._lock:
            self._waiting.append((topic, now.wall, array.raw))
            self._waiting_bytes += len(array.raw)
            if self._waiting_bytes > WAITING:
                self.dropped += len(self._waiting)
                self._waiting, self._waiting_bytes = [], 0

    def compress(self) -> None:
        """Take what waits into the rings."""
        with self._lock:
            waiting, self._waiting, self._waiting_bytes = self._waiting, [], 0
        for topic, wall, data in waiting:
            if not is_cdr(data):
                continue  # rclpy decoded it; the channels say CDR
            ring = self._rings.get(topic)
            if ring is None:
                ring = self._rings[topic] = Ring(next(self._numbers) % 65_535 + 1)
            ring.append(int(wall * 1e9), data, self.keep)

    def get(self, topic: Topic) -> Ring | None:
        """A topic's ring; None if nothing was received on it."""
        return self._rings.get(topic)

    def follow(self, topics: set[Topic]) -> None:
        """Forget the topics that no robot has any more."""
        for topic in self._rings.keys() - topics:
            del self._rings[topic]

    @property
    def size(self) -> int:
        """Bytes of messages in memory."""
        return self._waiting_bytes + sum(each.size for each in self._rings.values())
