"""Which events are kept, and the clock by which they become old."""

from __future__ import annotations

from dataclasses import dataclass

from ros_diagnostics_exporter.model import Instant

LEAST = 10_000  # events that are kept however large the robots are; some 5 MB


@dataclass(frozen=True)
class Retention:
    """Events are kept for ``seconds``, and while the database has at most ``size`` bytes.

    `LEAST` are kept in a larger database, too: what robots need is not theirs to give.
    """

    seconds: float = 90 * 86_400.0
    size: int = 256 << 20


class AgeClock:
    """The wall clock by which events become old, which follows one that was set ahead slowly.

    So an hour in which the clock is 200 days ahead costs some hours of the oldest events, not all.
    """

    FASTEST = 4  # seconds a second: an exporter that is off for most of the day keeps up

    def __init__(self) -> None:
        self._last: Instant | None = None

    def set(self, wall: float | None, now: Instant) -> None:
        """Go on from what it was in an earlier process, None: from now."""
        self._last = now if wall is None else Instant(now.mono, wall)

    def time(self, now: Instant) -> float:
        """Unix time, never ahead of the wall clock."""
        return min(self.wall(now), now.wall)

    def wall(self, now: Instant) -> float:
        """What a later process goes on from; ahead of a wall clock that was set back."""
        last = self._last or now
        most = last.wall + self.FASTEST * (now.mono - last.mono)
        self._last = Instant(now.mono, max(last.wall, min(now.wall, most)))
        return self._last.wall
