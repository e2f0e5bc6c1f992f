"""Nagios' flap detection: how restless a component has been over its last 21 states."""

from __future__ import annotations

from ros_diagnostics_exporter.faults.flapping import SLOTS, flap_ratio


class FlapHistory:
    """The last 21 states of one component.

    A state is recorded at every change, so that no change is ever missed, and otherwise once an
    interval, so that a component that has come to rest is calm again after 21 intervals.
    """

    __slots__ = ("last", "ratio", "slots")

    def __init__(self, level: int, mono: float) -> None:
        self.slots = [level] * SLOTS
        self.ratio = 0.0
        self.last = mono  # when the latest state was recorded

    def restore(self, slots: list[int], mono: float) -> None:
        """Go on from the states that a former process recorded."""
        self.slots = list(slots)
        self.ratio = flap_ratio(self.slots)
        self.last = mono

    def decay(self, mono: float, interval: float) -> bool:
        """Record what the time since the last record adds; True if the ratio changed."""
        steps = int((mono - self.last) / interval)
        if steps <= 0:
            return False
        self.last += steps * interval
        if self.ratio == 0.0:
            return False
        steps = min(steps, SLOTS)
        self.slots = self.slots[steps:] + [self.slots[-1]] * steps
        self.ratio = flap_ratio(self.slots)
        return True

    def change(self, level: int, mono: float, interval: float) -> None:
        """Record a change to another level."""
        self.decay(mono, interval)
        self.last = mono
        self.slots = [*self.slots[1:], level]
        self.ratio = flap_ratio(self.slots)
