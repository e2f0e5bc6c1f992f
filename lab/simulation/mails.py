"""A small model of what is behind the exporter: Prometheus' hold, alerts, Alertmanager's mails."""

from __future__ import annotations

from math import inf

from ros_diagnostics_exporter.faults.model import Fault
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Instant

Key = tuple[str, ...]


class Mails:
    """What was sent: PROBLEM when an alert begins, RECOVERY or (by a person) REMOVED at its end.

    `fleet:ros_diagnostics_fault_start:held` is what is served, and what was held before,
    until it is served that it has ended. A milder alert of the same component or value is
    inhibited by its critical one: a PROBLEM is not sent then, and no RECOVERY without a PROBLEM.
    """

    def __init__(self) -> None:
        self.sent: list[tuple[str, Key, float]] = []
        self._held: dict[Key, Fault] = {}
        self._notified: set[Key] = set()

    def scrape(self, state: FleetState | None, now: Instant) -> None:
        """Scrape, evaluate, send."""
        if state is None:
            return
        faults, ends = state.served()
        state.note_served(now)
        served = {tuple(fault.identity): fault for fault in faults}
        ended = {tuple(end.fault.identity): end.at for end in ends if end.fault is not None}
        forgotten = {end.robot: end.at for end in ends if end.fault is None}
        removed = {
            tuple(end.fault.identity) for end in ends if end.fault and end.reason == "removed"
        }

        def lasts(key: Key, fault: Fault) -> bool:
            at = max(ended.get(key, -inf), forgotten.get(fault.identity.robot, -inf))
            return at < fault.since

        held = {
            key: fault for key, fault in self._held.items() if key in served or lasts(key, fault)
        }
        self._held = {**served, **held}
        problems = {key for key in self._held.keys() - self._notified if not self._inhibited(key)}
        recoveries = self._notified - self._held.keys()
        self.sent += [("PROBLEM", key, now.mono) for key in sorted(problems)]
        for key in sorted(recoveries):
            is_removed = key in removed or key not in ended
            self.sent.append(("REMOVED" if is_removed else "RECOVERY", key, now.mono))
        self._notified = (self._notified | problems) - recoveries

    def _inhibited(self, key: Key) -> bool:
        scope, severity, *where = key
        milder = scope in {"component", "value"} and severity in {"warning", "stale"}
        return milder and (scope, "critical", *where) in self._held

    @property
    def firing(self) -> set[Key]:
        """The alerts that fire."""
        return set(self._held)

    def faults(self) -> list[Fault]:
        """The faults of these alerts."""
        return list(self._held.values())

    @property
    def notified(self) -> set[Key]:
        """The alerts of which a PROBLEM was sent, and no RECOVERY since."""
        return set(self._notified)
