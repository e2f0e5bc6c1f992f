"""The messages of one topic that are not decoded yet: limited in size and in CPU time.

Taking a message's bytes is cheap, decoding them is expensive. So a topic's messages are queued
as bytes, of which the oldest are dropped beyond a limit, and a topic that has used its share of CPU
time is decoded later. Pure: knows no ROS and no clock.
"""

from __future__ import annotations

from collections import deque

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
        self._messages: deque[bytes] = deque()
        self._bytes = 0
        self._debt = 0.0
        self._at = 0.0
        self._dropped = 0

    def __len__(self) -> int:
        """How many messages wait."""
        return len(self._messages)

    def put(self, message: bytes) -> None:
        """Append a message; what is beyond the limits goes, the oldest first, never the newest."""
        self._messages.append(message)
        self._bytes += len(message)
        while len(self._messages) > MAX_MESSAGES or (
            self._bytes > MAX_BYTES and len(self._messages) > 1
        ):
            self._bytes -= len(self._messages.popleft())
            self._dropped += 1

    def get(self) -> bytes:
        """Remove and return the oldest message.

        Raises:
            IndexError: none waits.
        """
        message = self._messages.popleft()
        self._bytes -= len(message)
        return message

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
