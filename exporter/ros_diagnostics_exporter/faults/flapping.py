"""How often something changed of late: Nagios' flap detection over 21 states, and when."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import compress
from operator import ne

SLOTS = 21
_LOW_CURVE = 0.75
_HIGH_CURVE = 1.25
# Of each possible change, the oldest first.
_WEIGHTS = tuple(
    place * (_HIGH_CURVE - _LOW_CURVE) / (SLOTS - 2) + _LOW_CURVE for place in range(SLOTS - 1)
)


def flap_ratio(slots: Sequence[int]) -> float:
    """Weighted share (0..1) of changes between neighbouring states, the oldest first.

    The newest of the 20 possible changes weighs 1.25, the oldest 0.75: the formula of Nagios'
    check_for_service_flapping (base/flapping.c). ``slots`` holds 21 states.
    """
    changed = map(ne, slots, slots[1:])
    return sum(compress(_WEIGHTS, changed)) / (SLOTS - 1)


class FlapHistory:
    """The last 21 states of one thing.

    A state is recorded at every change, so that no change is ever missed, and otherwise once an
    interval, so that what has come to rest no longer flaps after 21 intervals. ``changed`` are the
    times (monotonic) of its last changes, the oldest first, that no fault explains.
    """

    __slots__ = ("changed", "last", "ratio", "slots")

    def __init__(self, slots: Iterable[int], mono: float) -> None:
        """``slots`` are 21 states, the oldest first, each from 0 to 255."""
        self.slots = bytes(slots)  # of each component there is one: a list takes four times as much
        self.ratio = flap_ratio(self.slots)
        self.last = mono  # when the latest state was recorded
        self.changed: tuple[float, ...] = ()

    def decay(self, mono: float, interval: float) -> bool:
        """Record what the time since the last record adds; True if the ratio may have changed."""
        steps = int((mono - self.last) / interval + 1e-9)
        if steps <= 0:
            # Computed as a timer is: after a long uptime the difference may be less than interval.
            if mono < self.last + interval:
                return False
            steps = 1
        self.last = min(mono, self.last + steps * interval)
        if self.ratio == 0.0:
            return False
        steps = min(steps, SLOTS)
        self.slots = self.slots[steps:] + self.slots[-1:] * steps
        self.ratio = flap_ratio(self.slots)
        return True

    def change(self, state: int, mono: float, interval: float) -> None:
        """Record a change to another state."""
        self.decay(mono, interval)
        self.last = mono
        self.slots = bytes((*self.slots[1:], state))
        self.ratio = flap_ratio(self.slots)
        self.changed = (*self.changed, mono)[1 - SLOTS :]
