"""Two subscriptions of a topic, while one replaces the other: each message is taken once.

A new subscription receives nothing before the publishers have heard of it, which takes as long as
the network takes. Until then the old one goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable
from typing import Any, NamedTuple

OVERLAP = 3.0  # seconds that both are there
LATE = 3.0  # ... after that until nothing is sent again to the one that is left


class Taking(NamedTuple):
    """What takes the next message of a subscription, None where there is none, and what ends it."""

    take: Callable[[], Any]
    close: Callable[[], object]


class Handover:
    """The old one ends at ``end_at``; ``identity`` of a message is the same in both."""

    def __init__(
        self, old: Taking, new: Taking, identity: Callable[[Any], Hashable], end_at: float
    ) -> None:
        self.new = new
        self._old: Taking | None = old
        self._identity = identity
        self._taken: set[Hashable] = set()  # of one, and not of the other yet
        self._end_at = end_at

    def take(self) -> Any:
        """The next message; None where there is none."""
        if self._old is not None:
            taken = self._take_once(self._old.take)
            if taken is not None:
                return taken
        return self._take_once(self.new.take)

    def _take_once(self, take: Callable[[], Any]) -> Any:
        while (taken := take()) is not None:
            identity = self._identity(taken)
            if identity not in self._taken:
                if self._old is not None:
                    self._taken.add(identity)
                return taken
            self._taken.remove(identity)
        return None

    def replace(self, new: Taking, end_at: float) -> None:
        """Hand over to another one; of the two that there are, the one that is known stays."""
        if self._old is None:
            self._old = self.new
        else:
            self.new.close()
        self.new, self._end_at = new, end_at

    def is_over(self, now: float) -> bool:
        """End the old one when that is due; whether nothing comes twice any more."""
        if now >= self._end_at:
            self._end_old()
        return now >= self._end_at + LATE

    def close(self) -> None:
        """End both."""
        self._end_old()
        self.new.close()

    def _end_old(self) -> None:
        if self._old is not None:
            self._old.close()
            self._old = None


class Handovers:
    """Those under way, by topic: no topic has more than two subscriptions."""

    def __init__(self, identity: Callable[[Any], Hashable]) -> None:
        self._identity = identity
        self._handovers: dict[str, Handover] = {}

    def begin(self, topic: str, old: Taking, new: Taking, end_at: float) -> Taking:
        """What takes of both, and ends both; the old one ends then."""
        handover = self._handovers.get(topic)
        if handover is None:
            handover = self._handovers[topic] = Handover(old, new, self._identity, end_at)
        else:
            handover.replace(new, end_at)
        return Taking(handover.take, handover.close)

    def end(self, now: float) -> dict[str, Taking]:
        """End the old ones that are due; the new ones of which nothing comes twice any more."""
        over = {topic: each.new for topic, each in self._handovers.items() if each.is_over(now)}
        for topic in over:
            del self._handovers[topic]
        return over

    def forget(self, topic: str) -> None:
        """Note that a topic is no longer subscribed."""
        self._handovers.pop(topic, None)
