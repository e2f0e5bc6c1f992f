"""How many bytes per second arrive on the topics beside diagnostics, counted over a minute."""

from __future__ import annotations

from collections import Counter

COUNTED = 60.0  # seconds over which bytes are counted


class WatchedBytes:
    """Those of one domain."""

    def __init__(self) -> None:
        self._bytes = Counter[str]()
        self._since: float | None = None  # monotonic

    def add(self, topic: str, size: int) -> None:
        """Count what was received of a topic."""
        self._bytes[topic] += size

    def rates(self, mono: float) -> dict[str, float] | None:
        """Bytes per second by topic, once a minute; else None."""
        self._since = mono if self._since is None else self._since
        seconds = mono - self._since
        if seconds < COUNTED:
            return None
        rates = {name: count / seconds for name, count in self._bytes.items()}
        self._bytes.clear()
        self._since = mono
        return rates
