"""A small model of what is behind the exporter: Prometheus' hold, alerts, Alertmanager's mails."""

from __future__ import annotations

from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.state.state import State

Key = tuple[str, ...]


class Mails:
    """What was sent: PROBLEM when an alert begins to fire, RECOVERY when it has ended.

    `fleet:ros_diagnostics_fault_start:held` is what is served, and, while the exporter does not
    answer or is not settled, what was held before. A milder alert of the same component or value is
    inhibited by its critical one: a PROBLEM is not sent then, and no RECOVERY without a PROBLEM.
    """

    def __init__(self) -> None:
        self.sent: list[tuple[str, Key, float]] = []
        self._held: set[Key] = set()
        self._notified: set[Key] = set()

    def scrape(self, state: State | None, now: Instant) -> None:
        """Scrape, evaluate, send."""
        if state is None:
            return
        served = {tuple(fault.identity) for fault in state.faults()}
        self._held = served if state.settled(now) else served | self._held
        problems = {key for key in self._held - self._notified if not self._inhibited(key)}
        recoveries = self._notified - self._held
        self.sent += [("PROBLEM", key, now.mono) for key in sorted(problems)]
        self.sent += [("RECOVERY", key, now.mono) for key in sorted(recoveries)]
        self._notified = (self._notified | problems) - recoveries

    def _inhibited(self, key: Key) -> bool:
        scope, severity, *where = key
        milder = scope in {"component", "value"} and severity in {"warning", "stale"}
        return milder and (scope, "critical", *where) in self._held

    @property
    def firing(self) -> set[Key]:
        """The alerts that fire."""
        return set(self._held)

    @property
    def notified(self) -> set[Key]:
        """The alerts of which a PROBLEM was sent, and no RECOVERY since."""
        return set(self._notified)
