"""What sequence numbers and times of one publisher's messages say about the way to the exporter.

The middleware numbers what a publisher sends and notes when it was sent and received, so neither a
subscription nor a byte is added. A number that is missing was lost on the way, or replaced by the
next before it could be sent again. Sent is by the robot's clock: of a delay only that counts which
is above the least of late.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

WINDOW = 60.0  # seconds over which messages are counted
STEP = 10.0  # ... in so many at a time
# A longer pause is the silence of the robot, not the loss of messages; it is judged elsewhere.
PAUSE = 10.0
MOST_MISSING = 1000  # between two messages: more are the numbers of another publisher
# In a row that come late, as it seems: a robot has rebooted, and its clock and numbers are behind.
MOST_OVERTAKEN = 30
LEAST_KEPT = 10  # minutes over which the least delay is looked for
_SECOND = 1e-9  # of a nanosecond


class LinkReading(NamedTuple):
    """What arrived of late: messages ``expected``, at least one, those ``lost`` of them, seconds.

    ``delay`` is the largest of the window, above the least of the last minutes; ``jitter`` as RFC
    3550 defines it. By ``behind`` at most the robot's clock is behind the exporter's: the least
    difference of when a message was received and sent. Below zero, it is ahead by at least that.
    """

    expected: int
    lost: int
    delay: float
    jitter: float
    behind: float = 0.0

    @property
    def loss(self) -> float:
        """The share of messages that were lost."""
        return self.lost / self.expected


@dataclass(slots=True)
class _Step:
    """What arrived in one part of the window."""

    begin: float
    expected: int = 0
    received: int = 0
    most: float = float("-inf")
    least: float = float("inf")


class Link:
    """The messages of one publisher, as they arrive."""

    __slots__ = (
        "_delay",
        "_jitter",
        "_least",
        "_number",
        "_overtaken",
        "_received",
        "_sent",
        "_steps",
    )

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Begin anew: another publisher."""
        self._number: int | None = None
        self._overtaken = 0  # messages in a row
        self._sent = self._received = self._delay = self._jitter = 0.0
        self._steps: deque[_Step] = deque()
        self._least: deque[tuple[int, float]] = deque(maxlen=LEAST_KEPT)

    def note(self, number: int, sent: int, received: int) -> None:
        """Take one message: its number, and when it was sent and received (Unix time in ns)."""
        at, delay = received * _SECOND, (received - sent) * _SECOND
        if self._number is not None and number <= self._number and sent * _SECOND <= self._sent:
            self._overtaken += 1
            if self._overtaken < MOST_OVERTAKEN:
                self._step(at).received += number < self._number  # it was counted as missing
                return
            self.reset()
        self._overtaken = 0
        last = self._number
        missing = 0 if last is None else number - last - 1
        follows = last is not None and 0 <= missing <= MOST_MISSING and self._goes_on(at)
        if follows:
            self._jitter += (abs(delay - self._delay) - self._jitter) / 16
            if sent * _SECOND < self._sent:
                self._least.clear()  # the robot's clock was set back
        step = self._step(at)
        step.expected += 1 + (missing if follows else 0)
        step.received += 1
        step.most, step.least = max(step.most, delay), min(step.least, delay)
        self._note_least(at, delay)
        self._number, self._sent, self._received = number, sent * _SECOND, at
        self._delay = delay

    def _goes_on(self, at: float) -> bool:
        return 0 <= at - self._received <= PAUSE

    def _step(self, at: float) -> _Step:
        steps = self._steps
        if steps and at < steps[-1].begin - STEP:
            self._steps = steps = deque()  # the exporter's clock was set back
        if not steps or at >= steps[-1].begin + STEP:
            steps.append(_Step(at))
            while steps[0].begin <= at - WINDOW:
                steps.popleft()
        return steps[-1]

    def _note_least(self, at: float, delay: float) -> None:
        minute = int(at // 60)
        while self._least and self._least[0][0] <= minute - LEAST_KEPT:
            self._least.popleft()  # after a pause the clocks may differ by something else
        if self._least and self._least[-1][0] == minute:
            self._least[-1] = minute, min(self._least[-1][1], delay)
        else:
            self._least.append((minute, delay))

    def reading(self, wall: float) -> LinkReading | None:
        """What arrived in the window up to a Unix time; None where nothing did."""
        steps = [each for each in self._steps if wall - WINDOW < each.begin <= wall + STEP]
        expected = sum(each.expected for each in steps)
        if not expected:
            return None
        lost = max(0, expected - sum(each.received for each in steps))
        least = min(delay for _minute, delay in self._least)
        delay = max(each.most for each in steps) - least
        return LinkReading(expected, lost, delay, self._jitter, min(each.least for each in steps))


def joined(readings: list[LinkReading]) -> LinkReading:
    """What several publishers of one robot say of its link."""
    return LinkReading(
        sum(each.expected for each in readings),
        sum(each.lost for each in readings),
        max(each.delay for each in readings),
        max(each.jitter for each in readings),
        min(each.behind for each in readings),
    )
