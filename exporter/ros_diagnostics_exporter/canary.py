"""The canary: a fault of no robot, which measures how long a notification takes.

It is served beside the faults, its alert fires, and Alertmanager posts it back to the exporter and
to nobody else. It lasts until it is back; the next one begins the interval of fleet.yml later. One
that does not come back counts once for each interval, as longer than every bucket.
"""

from __future__ import annotations

import threading
from typing import NamedTuple

from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.notifications import Message
from ros_diagnostics_exporter.texts import encodable

ALERT = "RosDiagnosticsCanary"
# Seconds. The largest is the least interval of fleet.yml: what is missed has taken longer than all.
BUCKETS = (2.5, 5.0, 7.5, 10.0, 12.0, 15.0, 20.0, 30.0, 60.0)
FIRST = 30.0  # seconds after the start until the first one: a restart, too, may break the way
SAME = 0.002  # seconds; what is served is rounded to one


class Times(NamedTuple):
    """How many canaries took at most each of ``BUCKETS``, how many there were, their seconds."""

    within: tuple[int, ...]
    total: int
    seconds: float


class Canary:
    """The canary of one exporter. Safe from any thread."""

    def __init__(self, now: Instant) -> None:
        self._lock = threading.Lock()
        self._interval: float | None = None
        self._due = now.mono + FIRST
        self._began: Instant | None = None
        self._missed = 0  # intervals that the one under way has lasted
        self._times = Times((0,) * len(BUCKETS), 0, 0.0)

    @property
    def start(self) -> float | None:
        """When the canary that is under way began, Unix time; None if there is none."""
        with self._lock:
            return None if self._began is None else self._began.wall

    @property
    def times(self) -> Times | None:
        """The canaries until now; None while fleet.yml wants none."""
        with self._lock:
            return None if self._interval is None else self._times

    def tick(self, interval: float | None, now: Instant) -> None:
        """Let time pass; ``interval`` is that of fleet.yml, in seconds, None for no canary."""
        with self._lock:
            self._interval = interval
            if interval is None:
                self._began = None
            elif self._began is None:
                self._due = min(self._due, now.mono + max(FIRST, interval))
                if now.mono >= self._due:
                    self._began, self._missed = now, 0
            elif now.mono - self._began.mono >= (self._missed + 1) * interval:
                self._missed += 1
                self._count(interval, missed=True)

    def receive(self, message: Message, fleet: str, now: Instant) -> int:
        """How many alerts of a message are canaries of this fleet; the one under way is back."""
        found = [
            each.annotations.canary
            for each in message.alerts
            if each.labels.get("alertname") == ALERT
            and each.labels.get("fleet") == encodable(fleet)
        ]
        for start in found:
            self._receive(start, now)
        return len(found)

    def _receive(self, start: str, now: Instant) -> None:
        with self._lock:
            if self._began is None or self._interval is None or not _is(start, self._began.wall):
                return
            if not self._missed:
                self._count(now.mono - self._began.mono)
            self._began = None
            self._due = now.mono + self._interval

    def _count(self, seconds: float, *, missed: bool = False) -> None:
        within = (
            count + (not missed and seconds <= bucket)
            for count, bucket in zip(self._times.within, BUCKETS, strict=True)
        )
        self._times = Times(tuple(within), self._times.total + 1, self._times.seconds + seconds)


def _is(start: str, began: float) -> bool:
    """Whether an annotation of the alert is this Unix time; another exporter's canary is not."""
    try:
        return abs(float(start) - began) <= SAME
    except ValueError:
        return False
