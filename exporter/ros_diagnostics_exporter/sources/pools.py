"""What the middleware holds of topics with large messages, and when it is to be given back.

A subscription keeps the memory that its largest messages needed until it ends. So a topic that had
large ones is subscribed anew once nothing comes any more, and sooner where all of them together
hold too much: anybody may invent topics, each with one large message.
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass

LARGE = 256 << 10  # bytes of a message whose memory matters
BUDGET = 64 << 20  # bytes that the middleware may hold of all topics of a domain
MOST = 20  # topics that are subscribed anew in one turn, which costs others their time
PAUSE = 10.0  # seconds without a message after which a topic has paused
# ... where all together hold too much; one that sends more often would soon hold as much again.
SHORT_PAUSE = 0.5


@dataclass(slots=True)
class _Held:
    size: int
    last: float  # monotonic


class Pools:
    """By topic, of those with large messages."""

    def __init__(self) -> None:
        self._held: dict[str, _Held] = {}

    def note(self, topic: str, largest: int, number: int, now: float) -> None:
        """Note that so many messages were taken at once, of at most ``largest`` bytes."""
        known = self._held.get(topic)
        if known is None and largest < LARGE:
            return
        size = largest * number
        self._held[topic] = _Held(size if known is None else max(known.size, size), now)

    @property
    def are_full(self) -> bool:
        """Whether all together hold too much."""
        return self._total > BUDGET

    @property
    def _total(self) -> int:
        return sum(each.size for each in self._held.values())

    def take_due(self, now: float) -> list[str]:
        """The topics to be subscribed anew, which then hold nothing."""
        total = self._total
        due: list[str] = []
        for topic, held in sorted(self._held.items(), key=lambda item: -item[1].size):
            pause = SHORT_PAUSE if total > BUDGET else PAUSE
            if len(due) < MOST and now - held.last >= pause:
                due.append(topic)
                total -= held.size
                del self._held[topic]
        return due

    def forget(self, topic: str) -> None:
        """Note that a topic is no longer subscribed."""
        self._held.pop(topic, None)


def trim() -> None:
    """Give the memory that is free back to the system, where the C library can (glibc)."""
    malloc_trim = getattr(ctypes.CDLL(None), "malloc_trim", None)
    if malloc_trim is not None:
        malloc_trim(0)
