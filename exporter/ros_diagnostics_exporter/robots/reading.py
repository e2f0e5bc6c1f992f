"""Which of its topics a robot with the source ``auto`` is read from, as its arrays show."""

from __future__ import annotations

from ros_diagnostics_exporter.config.fleet import Source
from ros_diagnostics_exporter.model import Instant

AUTO_WAIT = 5.0  # seconds that a raw array waits for an aggregated one before raw is the source
# Seconds for which both are read once an aggregator has started late: it lists one component after
# another, and what it lists keeps its faults.
SWITCH = 60.0
PAUSE = 10.0  # seconds without an array after which an aggregator has started anew


class AutoSource:
    """The aggregate if there is one, else raw until there is."""

    def __init__(self) -> None:
        self._first_raw: float | None = None
        self._since: float | None = None  # there are aggregated arrays
        self._last = 0.0

    def decide(self, source: Source, now: Instant, *, raw: bool) -> Source:
        """The source from now on, by an array that was received."""
        if raw:
            return self._after_raw(now) if source is Source.AUTO else source
        if source in (Source.AUTO, Source.AGG):
            return Source.AGG
        if self._since is None or now.mono - self._last > PAUSE:
            self._since = now.mono
        self._last = now.mono
        return Source.AGG if now.mono - self._since >= SWITCH else Source.BOTH

    def _after_raw(self, now: Instant) -> Source:
        if self._first_raw is None:
            self._first_raw = now.mono
        return Source.AUTO if now.mono - self._first_raw < AUTO_WAIT else Source.RAW
