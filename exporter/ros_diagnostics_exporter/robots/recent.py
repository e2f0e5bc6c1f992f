"""What happened within some time, in few bytes: of each its moment, and a number that says what."""

from __future__ import annotations

from array import array
from bisect import bisect_right
from collections.abc import Iterable, Iterator

MOST = 200  # of one kind that are kept


class Recent:
    """Moments in order, each with a number up to 255; the last `MOST` within so many seconds."""

    __slots__ = ("_at", "_what", "within")

    def __init__(self, within: float) -> None:
        self.within = within
        self._at, self._what = array("d"), b""

    def add(self, what: Iterable[int], at: float) -> None:
        """Note what happened at a moment that is none before the last."""
        for each in what:
            self._at.append(at)
            self._what += bytes([each])
        self._forget(at)

    def _forget(self, at: float) -> None:
        begin = max(bisect_right(self._at, at - self.within), len(self._at) - MOST)
        if begin > 0:
            del self._at[:begin]
            self._what = self._what[begin:]

    def since(self, moment: float) -> bytes:
        """What happened after a moment, in order."""
        return self._what[bisect_right(self._at, moment) :]

    def next_after(self, moment: float) -> float | None:
        """The first moment after another."""
        index = bisect_right(self._at, moment)
        return self._at[index] if index < len(self._at) else None

    def __iter__(self) -> Iterator[tuple[float, int]]:
        return zip(self._at, self._what, strict=True)
