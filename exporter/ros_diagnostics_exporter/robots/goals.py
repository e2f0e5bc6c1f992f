"""The goals of one action server: how each ended, and how long it took. Pure: time is given.

A server publishes the list of the goals that it keeps whenever one of them changes. What is decided
where such lists do not tell everything:

- The first list ever has old goals: those that have ended are not counted, those that run are.
- A goal that ran and is not in the next list has ended unseen, or its server was restarted: it is
  ``unknown``. So is one whose server has been away for `RETURN`, and stays so whatever comes later.
- An id that comes again with another stamp is another goal.
- The robot's clock counts in two cases: in which order two goals of one list began, and which
  goals began and ended while the exporter was not running.
- A goal has a duration where its begin and its end were seen, and its server was always there.
- A goal that is aborted or cancelled is ``preempted`` where a newer one was accepted in the second
  before. A cancelled one is so, too, where a newer one is accepted in the second after, as clients
  that replace a goal do. An aborted one is not: that is a client that tries again.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable
from dataclasses import dataclass, field
from math import inf
from operator import itemgetter
from typing import Annotated, Literal, NamedTuple, get_args

from pydantic import Field

from ros_diagnostics_exporter.decode.goals import ABORTED, CANCELED, MOST, SUCCEEDED, Goal, Key

Result = Literal["succeeded", "aborted", "cancelled", "preempted", "unknown"]
RESULTS: tuple[Result, ...] = get_args(Result)
REPLACED = 1.0  # seconds within which a newer goal has taken the place of one that ends
RETURN = 600.0  # ... for which a server may be away until its goals are unknown
BOUNDS = (1.0, 10.0, 60.0, 300.0, 1800.0)  # of durations, in seconds: from a spin to a tour
MOST_RUNNING = 100  # goals of one server that run at once; later ones are not followed
_ENDED = {SUCCEEDED: "succeeded", ABORTED: "aborted", CANCELED: "cancelled"}

Moment = Annotated[float, Field(ge=-1e11, le=1e11, allow_inf_nan=False)]
_Id = Annotated[str, Field(pattern="^[0-9a-f]{32}$")]
_Count = Annotated[int, Field(ge=0, le=2**53)]


class GoalEnd(NamedTuple):
    """A goal that ended; ``seconds`` is how long it took, None where that was not seen."""

    result: str
    at: float  # monotonic
    seconds: float | None = None


class GoalsLearned(NamedTuple):
    """What a later process should know of one server.

    ``running`` are (id in hexadecimal, stamp, seconds for which it is known), ``lost`` those that
    are counted as unknown and may run, ``newest`` is the robot's time of the last goal. Of
    ``durations``, counts by `BOUNDS`, the last is of longer ones.
    """

    newest: Moment
    running: Annotated[list[tuple[_Id, Moment, Moment]], Field(max_length=MOST_RUNNING)]
    lost: Annotated[list[tuple[_Id, Moment]], Field(max_length=MOST)]
    results: Annotated[list[_Count], Field(min_length=len(RESULTS), max_length=len(RESULTS))]
    started: _Count
    durations: Annotated[
        list[_Count], Field(min_length=len(BOUNDS) + 1, max_length=len(BOUNDS) + 1)
    ]
    seconds: Annotated[float, Field(ge=0, le=1e15, allow_inf_nan=False)]


@dataclass(slots=True)
class _Running:
    """A goal that has not ended, the ``number``-th that was seen.

    ``whole``: its begin was seen, and its server was there ever since.
    """

    number: int
    since: float  # monotonic
    whole: bool


@dataclass(slots=True)
class Counts:
    """How many goals of one server ended in which way, and how long they took."""

    started: int = 0  # those whose begin was seen
    results: dict[str, int] = field(default_factory=lambda: dict.fromkeys(RESULTS, 0))
    durations: list[int] = field(default_factory=lambda: [0] * (len(BOUNDS) + 1))
    seconds: float = 0.0

    def add(self, end: GoalEnd) -> None:
        """Count a goal that ended."""
        self.results[end.result] += 1
        if end.seconds is not None:
            self.seconds += end.seconds
            self.durations[bisect_left(BOUNDS, end.seconds)] += 1

    def with_(self, ends: Iterable[GoalEnd]) -> Counts:
        """Others, with these goals too."""
        others = Counts(self.started, dict(self.results), list(self.durations), self.seconds)
        for end in ends:
            others.add(end)
        return others


class Goals:
    """The goals of one server. Each method returns what ended by it; ``mono`` is monotonic."""

    __slots__ = (
        *("counts", "received_at", "_known", "_running", "_held", "_newest", "_number"),
        *("_accepted_at", "_is_joined", "_is_first", "_away_since"),
    )

    def __init__(self) -> None:
        self.counts = Counts()
        self._known: dict[Key, bool] = {}  # of the last list: whether it has ended
        self._running: dict[Key, _Running] = {}
        self._held: list[GoalEnd] = []  # cancelled ones that may have been replaced
        self._newest = -inf  # the robot's time of its last goal
        self._number = 0  # goals that were seen
        self._accepted_at = -inf  # when the last of them was
        self._is_joined = False  # a list was received before, by whichever process
        self._is_first = True  # the next list is the first of this process
        self._away_since: float | None = None
        self.received_at = -inf  # when the last list was received

    @property
    def state(self) -> tuple[object, ...]:
        """What of it may change how it is judged, served or followed."""
        return self.counts.started, self.running, self.is_away, len(self._held)

    @property
    def is_away(self) -> bool:
        """Whether its server cannot be reached."""
        return self._away_since is not None

    @property
    def running(self) -> int:
        """How many have not ended, as far as is known; none of a server that is away."""
        return len(self._running) if self._away_since is None else 0

    def longest(self, mono: float) -> float:
        """For how many seconds the longest of them runs; 0: none does."""
        if self._away_since is not None:
            return 0.0
        return max((mono - each.since for each in self._running.values()), default=0.0)

    @property
    def due(self) -> float:
        """When `tick` has something to do, monotonic."""
        held = (end.at + REPLACED for end in self._held)
        away = self._away_since
        returns = inf if away is None or not self._running else away + RETURN
        return min((*held, returns), default=inf)

    def see(self, goals: Iterable[Goal], mono: float) -> list[GoalEnd]:
        """Take a list as it was received."""
        before, ends, running = self.return_(mono), list[GoalEnd](), self._running
        self.received_at = mono
        listed = {each.key: each for each in goals}
        known, self._known = self._known, {key: each.has_ended for key, each in listed.items()}
        for key in running.keys() - listed.keys():
            ends.append(self._drop(key, mono))
        new = [key for key in listed if key not in known and not self._is_old(listed[key])]
        for key in sorted(new, key=itemgetter(1)):  # by when they were accepted
            ends += self._begin(listed[key], mono)
        for key, has_ended in self._known.items():
            if has_ended and key in running:
                ends += self._finish(running.pop(key), listed[key], mono)
        if listed:
            self._newest = max(stamp for _id, stamp in listed)
        self._is_joined, self._is_first = True, False
        return before + self._counted(ends)

    def _is_old(self, goal: Goal) -> bool:
        """Whether a goal of the first list had ended before this process, or any, was there."""
        is_counted_before = not self._is_joined or goal.stamp <= self._newest
        return goal.has_ended and self._is_first and is_counted_before

    def _begin(self, goal: Goal, mono: float) -> list[GoalEnd]:
        """Take a goal that is seen the first time; what it takes the place of."""
        self._number += 1
        is_seen = not self._is_first
        self._accepted_at = mono if is_seen else -inf
        self.counts.started += is_seen
        if len(self._running) < MOST_RUNNING:
            whole = is_seen and not goal.has_ended
            self._running[goal.key] = _Running(self._number, mono, whole)
        replaced = [end._replace(result="preempted") for end in self._held]
        self._held.clear()
        return replaced

    def _finish(self, running: _Running, goal: Goal, mono: float) -> list[GoalEnd]:
        """Take how a goal ended; nothing as long as that may change."""
        is_newest = running.number == self._number
        is_replaced = not is_newest and mono - self._accepted_at <= REPLACED
        result = _ENDED[goal.status]
        if result != "succeeded" and is_replaced:
            result = "preempted"
        end = GoalEnd(result, mono, mono - running.since if running.whole else None)
        if result == "cancelled":
            self._held.append(end)
            return []
        return [end]

    def _drop(self, key: Key, mono: float) -> GoalEnd:
        """Follow a goal no more that nobody knows the end of."""
        del self._running[key]
        return GoalEnd("unknown", mono)

    def _counted(self, ends: list[GoalEnd]) -> list[GoalEnd]:
        for end in ends:
            self.counts.add(end)
        return ends

    # -- the server ----------------------------------------------------------------------------

    def leave(self, mono: float) -> None:
        """Note that the server, or its robot, cannot be reached."""
        if self._away_since is None:
            self._away_since = mono
            for each in self._running.values():
                each.whole = False

    def return_(self, mono: float) -> list[GoalEnd]:
        """Note that it is reached again: what it ran, it may still run."""
        ends = self.tick(mono)
        self._away_since = None
        return ends

    def restart(self, mono: float) -> list[GoalEnd]:
        """Note that another process serves the action: it knows nothing of these goals."""
        self._known.clear()
        return self._lose_all(mono)

    def _lose_all(self, mono: float) -> list[GoalEnd]:
        return self._counted([self._drop(each, mono) for each in list(self._running)])

    def tick(self, mono: float) -> list[GoalEnd]:
        """Let time pass."""
        if not self._held and self._away_since is None:
            return []
        ends = [each for each in self._held if mono > each.at + REPLACED]
        self._held = [each for each in self._held if mono <= each.at + REPLACED]
        self._counted(ends)
        if self._away_since is not None and mono >= self._away_since + RETURN:
            ends += self._lose_all(mono)
        return ends

    # -- outliving the process -----------------------------------------------------------------

    def learned(self, mono: float) -> GoalsLearned:
        """What a later process should know; a goal that was cancelled just now is counted so."""
        counts = self.counts.with_(self._held) if self._held else self.counts
        return GoalsLearned(
            newest=max(self._newest, -1e11),
            running=[
                (key[0].hex(), key[1], mono - each.since) for key, each in self._running.items()
            ],
            lost=[
                (key[0].hex(), key[1])
                for key, has_ended in self._known.items()
                if not has_ended and key not in self._running
            ],
            results=[*counts.results.values()],
            started=counts.started,
            durations=[*counts.durations],
            seconds=counts.seconds,
        )

    def restore(self, learned: GoalsLearned, mono: float) -> None:
        """Go on from what an earlier process knew: the server is away until it is found."""
        self._newest, self._is_joined, self._away_since = learned.newest, True, mono
        for goal_id, stamp, age in learned.running:
            self._number += 1
            self._running[bytes.fromhex(goal_id), stamp] = _Running(
                self._number, mono - age, whole=False
            )
        self._known = dict.fromkeys(self._running, False)
        self._known |= {(bytes.fromhex(each), stamp): False for each, stamp in learned.lost}
        counts = self.counts
        counts.started, counts.seconds = learned.started, learned.seconds
        counts.durations = list(learned.durations)
        counts.results = dict(zip(RESULTS, learned.results, strict=True))
