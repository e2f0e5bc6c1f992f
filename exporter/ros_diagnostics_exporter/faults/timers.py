"""Timers: at most one for each key, in a heap from which replaced ones are deleted lazily."""

from __future__ import annotations

import heapq
from collections.abc import Hashable
from math import inf
from typing import Generic, TypeVar

_Key = TypeVar("_Key", bound=Hashable)
_SLACK = 64  # entries of the heap that are always allowed beside the live ones


class Timers(Generic[_Key]):
    """When each key is due, in seconds of the monotonic clock."""

    def __init__(self) -> None:
        self._due: dict[_Key, float] = {}
        self._heap: list[tuple[float, int, _Key]] = []
        self._serial = 0  # keys themselves are never compared

    def __len__(self) -> int:
        return len(self._due)

    @property
    def entries(self) -> int:
        """How long the heap is, at most twice the timers and a constant."""
        return len(self._heap)

    @property
    def next(self) -> float:
        """When the first is due; infinite where there is none."""
        while self._heap and self._due.get(self._heap[0][2]) != self._heap[0][0]:
            heapq.heappop(self._heap)
        return self._heap[0][0] if self._heap else inf

    def set(self, key: _Key, due: float) -> None:
        """Let ``key`` be due then, and no longer at another time."""
        if self._due.get(key) == due:
            return
        self._due[key] = due
        self._serial += 1
        heapq.heappush(self._heap, (due, self._serial, key))
        self._compact()

    def set_at_latest(self, key: _Key, due: float) -> None:
        """Let ``key`` be due then, unless it is earlier; infinite: no timer is needed."""
        if due < self._due.get(key, inf):
            self.set(key, due)

    def clear(self, key: _Key) -> None:
        """Let ``key`` not be due at all."""
        if self._due.pop(key, None) is not None:
            self._compact()

    def pop(self) -> list[_Key]:
        """Take out all that are due first, at one time."""
        first = self.next
        due = []
        while self.next == first < inf:
            key = heapq.heappop(self._heap)[2]
            del self._due[key]
            due.append(key)
        return due

    def _compact(self) -> None:
        if len(self._heap) > 2 * len(self._due) + _SLACK:
            self._heap = [entry for entry in self._heap if self._due.get(entry[2]) == entry[0]]
            heapq.heapify(self._heap)
