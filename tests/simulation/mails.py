"""A small model of what is behind the exporter: Prometheus' hold, alerts, Alertmanager's mails."""

from __future__ import annotations

from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.state.state import State

Key = tuple[str, ...]


class Mails:
    """What was sent: PROBLEM when an alert begins to fire, RECOVERY when it has ended.

    `fleet:ros_diagnostics_fault_start:held` is what is served, and, while the exporter does not
    answer or is not settled, what was held before.
    """

    def __init__(self) -> None:
        self.sent: list[tuple[str, Key, float]] = []
        self._held: set[Key] = set()

    def scrape(self, state: State | None, now: Instant) -> None:
        """Scrape, evaluate, send."""
        if state is None:
            return
        served = {tuple(fault.identity) for fault in state.faults()}
        held = served if state.settled(now) else served | self._held
        self.sent += [("PROBLEM", key, now.mono) for key in sorted(held - self._held)]
        self.sent += [("RECOVERY", key, now.mono) for key in sorted(self._held - held)]
        self._held = held

    @property
    def firing(self) -> set[Key]:
        """The alerts that fire."""
        return set(self._held)
