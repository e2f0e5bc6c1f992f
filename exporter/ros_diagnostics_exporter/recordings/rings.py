"""The last messages of each stream as they were received, compressed, in limited memory.

A message is appended as it comes; `compress` does the rest in a thread of its own.
"""

from __future__ import annotations

import threading
from collections import Counter, deque

from ros_diagnostics_exporter.decode.cdr import is_cdr
from ros_diagnostics_exporter.model import Instant, Stream, Topic
from ros_diagnostics_exporter.recordings.mcap import Chunk, OpenChunk

CHUNK = 16 << 10  # bytes of a chunk before it is compressed
QUOTA = 1 << 20  # bytes of one stream that wait for `compress`; what is beyond is dropped
WAITING = 16 << 20  # ... of all streams; where more waits, each may have `LEAST`
LEAST = 32 << 10
MAX_LOST = 1_000  # messages of one stream that are known to be missing
RING = 40 << 10  # compressed bytes of one topic for ``PER`` seconds; the oldest are dropped beyond
PLAIN = 16 << 20  # ... and decompressed, as they are when they are written
PER = 70.0
SPAN = 10 * 10**9  # ns from the first message of a chunk to the last, where few are received


class Ring:
    """The last messages of one topic."""

    __slots__ = ("_chunks", "_open", "lost")

    def __init__(self) -> None:
        self.lost: deque[int] = deque(maxlen=MAX_LOST)  # when messages came that are missing, ns
        self._chunks: deque[Chunk] = deque()
        self._open = OpenChunk()

    def append(self, time: int, data: bytes, keep: float) -> None:
        """Append a message, and compress what a chunk is full of; ``keep`` is in seconds."""
        if self._open.content and not 0 <= time - self._open.begin < SPAN:
            self._close(time, keep)
        self._open.append(time, data)
        if len(self._open.content) >= CHUNK:
            self._close(time, keep)

    def _close(self, time: int, keep: float) -> None:
        self._chunks.append(self._open.compressed())
        self._open = OpenChunk()
        self._drop(time - int(keep * 1e9), max(1.0, keep / PER))

    def _drop(self, oldest: int, times: float) -> None:
        """Drop what is older than that, or beyond so many times the limits."""
        size = sum(len(each.data) for each in self._chunks)
        plain = sum(each.size for each in self._chunks)
        while self._chunks and (
            size > RING * times or plain > PLAIN * times or self._chunks[0].end < oldest
        ):
            dropped = self._chunks.popleft()
            if not self._chunks and dropped.end >= oldest:
                self.lost.append(dropped.end)  # one that is larger than the ring
            size, plain = size - len(dropped.data), plain - dropped.size

    @property
    def size(self) -> int:
        """Bytes in memory."""
        return len(self._open.content) + sum(len(each.data) for each in self._chunks)

    def chunks(self, begin: int, end: int, before: int | None = None) -> list[Chunk]:
        """The chunks with what was received from ``begin`` to ``end`` (ns), and some before.

        With ``before``, of a stream of which nothing was received of late its last so many ns.
        """
        found = [*self._chunks, *([self._open.compressed()] if self._open.content else [])]
        if found and before is not None:
            begin = min(begin, found[-1].end - before)
        return [each for each in found if each.end >= begin and each.begin <= end]


class Rings:
    """One for each stream. `receive` may be called from any thread, all else from one."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._waiting: list[tuple[Stream, int, bytes]] = []  # without bytes: it was dropped
        self._bytes = Counter[Stream]()  # that wait
        self._all_bytes = 0  # of these
        self._rings: dict[Stream, Ring] = {}
        self.dropped = 0  # messages that were more than may wait
        self.keep = PER  # seconds that are kept of each stream

    def receive(self, stream: Stream, data: bytes, now: Instant) -> None:
        """Append a message; beyond its share one of a stream is dropped, and of no other."""
        with self._lock:
            waiting = self._bytes[stream] + len(data)
            share = LEAST if self._all_bytes + len(data) > WAITING else QUOTA
            if waiting > share:
                self.dropped += 1
                data = b""
            self._bytes[stream] += len(data)
            self._all_bytes += len(data)
            self._waiting.append((stream, int(now.wall * 1e9), data))

    def compress(self) -> None:
        """Take what waits into the rings."""
        with self._lock:
            waiting, self._waiting = self._waiting, []
            self._bytes, self._all_bytes = Counter(), 0
        for stream, time, data in waiting:
            if data and not is_cdr(data):
                continue  # rclpy decoded it; the channels say CDR
            ring = self._rings.get(stream)
            if ring is None:
                ring = self._rings[stream] = Ring()
            if data:
                ring.append(time, data, self.keep)
            else:
                ring.lost.append(time)

    def get(self, stream: Stream) -> Ring | None:
        """A stream's ring; None if nothing was received of it."""
        return self._rings.get(stream)

    def beside(self, robot: str) -> dict[Stream, Ring]:
        """What was received of a robot beside its diagnostics."""
        return {each: ring for each, ring in self._rings.items() if each.robot == robot}

    def keep_only(self, topics: set[Topic], robots: set[str]) -> None:
        """Forget what is neither of these topics of diagnostics nor of these robots."""
        for each in list(self._rings):
            if each.robot not in robots if each.robot else each.topic not in topics:
                del self._rings[each]

    @property
    def size(self) -> int:
        """Bytes of messages in memory."""
        return self._all_bytes + sum(each.size for each in self._rings.values())
