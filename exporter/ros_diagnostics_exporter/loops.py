"""Clocks, timers, and the one kind of thread: work that is repeated, guarded, timed and watched.

An exception ends a turn, not the loop. What may hang (a disk, a folder, a name server, another
program) has a loop of its own, so that none that judges or answers waits for it.
"""

from __future__ import annotations

import heapq
import logging
import threading
import time
from collections.abc import Callable, Hashable
from math import inf
from typing import Generic, TypeVar

from ros_diagnostics_exporter.model import Instant

log = logging.getLogger(__name__)

LOG_INTERVAL = 60.0  # seconds between two lines about a loop whose turns fail


class Clocks:
    """Both clocks, the monotonic one without the time in which this process stood still.

    A machine that is overloaded, or a virtual one that moves, stops the process for seconds; the
    robots go on. Nothing was received meanwhile, so nothing is known of that time: it confirms no
    fault, and no robot is silent for it. It is noticed while something reads the clocks a few times
    a second, between `keep_watch` and `end_watch`.
    """

    LONGEST = 2.0  # seconds between two readings of a process that runs

    def __init__(self, monotonic: Callable[[], float] = time.monotonic) -> None:
        self._monotonic = monotonic
        self._lock = threading.Lock()
        self._watches = 0
        self._last = monotonic()
        self._stood_still = 0.0

    def read(self) -> Instant:
        """Both clocks, now."""
        with self._lock:
            now = self._monotonic()
            pause, self._last = now - self._last, now
            stood_still = self._watches > 0 and pause > self.LONGEST
            # The rest counts, so that time goes on where every turn takes that long.
            self._stood_still += pause - self.LONGEST if stood_still else 0.0
            mono = now - self._stood_still
        if stood_still:
            log.warning(
                "this process stood still for %.1f s, of which %.0f s count", pause, self.LONGEST
            )
        return Instant(mono, time.time())

    def keep_watch(self) -> None:
        """From now on the clocks are read a few times a second."""
        self.read()
        with self._lock:
            self._watches += 1

    def end_watch(self) -> None:
        """They are no longer."""
        with self._lock:
            self._watches -= 1


_CLOCKS = Clocks()  # of this process: its sources, its judgement and its pages share the time
read_clocks, keep_watch, end_watch = _CLOCKS.read, _CLOCKS.keep_watch, _CLOCKS.end_watch


def _nothing() -> None:
    """End without more ado."""


class Loop:
    """Calls ``work`` in a thread of its own, at once and then ``interval`` seconds after its end.

    Args:
        name: Of the thread, and of the loop in metrics and log.
        interval: Seconds from the end of a turn to the next.
        work: One turn.
        end: Called in the thread once it is asked to stop.
        vital: Whether the exporter is of no use while a turn hangs, and a restart may help.

    Attributes:
        last_turn: When the last turn that did not fail ended, Unix time; 0 before that.
        errors: How many turns have failed, and pieces of turns that go on.
        stopping: Whether it was asked to stop; a long turn should look.
    """

    def __init__(
        self,
        name: str,
        interval: float,
        work: Callable[[], object],
        *,
        end: Callable[[], object] = _nothing,
        vital: bool = False,
    ) -> None:
        self.name = name
        self.vital = vital
        self.last_turn = 0.0
        self.errors = 0
        self.stopping = False
        self.interval = interval
        self._work = work
        self._end = end
        self._wake = threading.Event()
        self._busy_since: float | None = None  # monotonic
        self._logged_at = float("-inf")
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        """Begin the first turn."""
        self._thread.start()

    def wake(self) -> None:
        """Have the next turn at once."""
        self._wake.set()

    def ask_to_stop(self) -> None:
        """Begin no more turn."""
        self.stopping = True
        self._wake.set()

    def stop(self, seconds: float) -> bool:
        """Begin no more turn, and wait for one under way; whether it ended in time."""
        self.ask_to_stop()
        if self.alive:
            self._thread.join(seconds)
        return not self.alive

    @property
    def alive(self) -> bool:
        """Whether the thread runs."""
        return self._thread.is_alive()

    def hangs(self, seconds: float) -> bool:
        """Whether a turn has been going on for longer than that."""
        since = self._busy_since
        return since is not None and time.monotonic() - since > seconds

    def _run(self) -> None:
        while not self.stopping:
            self._busy_since = time.monotonic()
            self._turn()
            self._busy_since = None
            self._wake.wait(self.interval)
            self._wake.clear()
        self._end()

    def _turn(self) -> None:
        try:
            self._work()
        except Exception:  # a bug: the next turn may do better, and nobody else does this work
            self.errors += 1
            if time.monotonic() - self._logged_at >= LOG_INTERVAL:
                self._logged_at = time.monotonic()
                log.exception("loop %s: a turn failed; it goes on", self.name)
        else:
            self.last_turn = time.time()


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
        if len(self._heap) > 2 * len(self._due) + _SLACK:
            self._compact()

    def set_at_latest(self, key: _Key, due: float) -> None:
        """Let ``key`` be due then, unless it is earlier; infinite: no timer is needed."""
        if due < self._due.get(key, inf):
            self.set(key, due)

    def clear(self, key: _Key) -> None:
        """Let ``key`` not be due at all."""
        self._due.pop(key, None)
        if len(self._heap) > 2 * len(self._due) + _SLACK:
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
        self._heap = [entry for entry in self._heap if self._due.get(entry[2]) == entry[0]]
        heapq.heapify(self._heap)
