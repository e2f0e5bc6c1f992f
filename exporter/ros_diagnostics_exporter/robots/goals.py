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
from operator import attrgetter
from typing import Annotated, Literal, NamedTuple, get_args

from pydantic import Field

from ros_diagnostics_exporter.decode.goals import (
    ABORTED,
    CANCELED,
    MOST,
    SUCCEEDED,
    Goal,
    Key,
    key_of,
    parts_of,
)

Result = Literal["succeeded", "aborted", "cancelled", "preempted", "unknown"]
RESULTS: tuple[Result, ...] = get_args(Result)
REPLACED = 1.0  # seconds within which a newer goal has taken the place of one that ends
RETURN = 600.0  # ... for which a server may be away until its goals are unknown
BOUNDS = (1.0, 10.0, 60.0, 300.0, 1800.0)  # of durations, in seconds: from a spin to a tour
MOST_RUNNING = 100  # goals of one server that run at once; later ones are not followed
_NEVER = -inf  # one object for all
_ENDED: dict[int, Result] = {SUCCEEDED: "succeeded", ABORTED: "aborted", CANCELED: "cancelled"}

Moment = Annotated[float, Field(ge=-1e11, le=1e11, allow_inf_nan=False)]
_Id = Annotated[str, Field(pattern="^[0-9a-f]{32}$")]
_Count = Annotated[int, Field(ge=0, le=2**53)]


class GoalEnd(NamedTuple):
    """A goal that ended; ``seconds`` is how long it took, None where that was not seen."""

    result: Result
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

    key: Key
    number: int
    since: float  # monotonic
    whole: bool


@dataclass(slots=True)
class Counts:
    """How many goals of one server ended in which way, and how long they took.

    ``numbers`` are those of each of `RESULTS`, then those of `durations`.
    """

    started: int = 0  # those whose begin was seen
    seconds: float = 0.0
    numbers: list[int] = field(default_factory=lambda: [0] * (len(RESULTS) + len(BOUNDS) + 1))

    @property
    def ended(self) -> list[int]:
        """How many ended in which way, in the order of `RESULTS`."""
        return self.numbers[: len(RESULTS)]

    @property
    def durations(self) -> list[int]:
        """How many took how long, by `BOUNDS`; the last is of longer ones."""
        return self.numbers[len(RESULTS) :]

    @property
    def results(self) -> dict[Result, int]:
        """How many ended in which way."""
        return dict(zip(RESULTS, self.ended, strict=True))

    def add(self, end: GoalEnd) -> None:
        """Count a goal that ended."""
        self.numbers[RESULTS.index(end.result)] += 1
        if end.seconds is not None:
            self.seconds += end.seconds
            self.numbers[len(RESULTS) + bisect_left(BOUNDS, end.seconds)] += 1

    def with_(self, ends: Iterable[GoalEnd]) -> Counts:
        """Others, with these goals too."""
        others = Counts(self.started, self.seconds, [*self.numbers])
        for end in ends:
            others.add(end)
        return others


class Goals:
    """The goals of one server. Each method returns what ended by it; ``mono`` is monotonic.

    A fleet has thousands of servers with one or two goals each, so these are kept in tuples: a
    dict of one takes five times as much memory.
    """

    __slots__ = (
        *("counts", "received_at", "_ended", "_lost", "_running", "_held", "_newest", "_number"),
        *("_accepted_at", "_is_joined", "_away_since"),
    )

    def __init__(self) -> None:
        self.counts = Counts()
        self._ended: tuple[Key, ...] = ()  # of the last list
        self._lost: tuple[Key, ...] = ()  # of the last list, which may run, and are not followed
        self._running: tuple[_Running, ...] = ()
        self._held: tuple[GoalEnd, ...] = ()  # cancelled ones that may have been replaced
        self._newest = _NEVER  # the robot's time of its last goal
        self._number = 0  # goals that were seen
        self._accepted_at = _NEVER  # when the last of them was
        self._is_joined = False  # a list was received before, by whichever process
        self._away_since: float | None = None
        self.received_at = _NEVER  # when the last list was received

    @property
    def state(self) -> tuple[object, ...]:
        """What of it may change how it is judged, served or followed."""
        return self.counts.started, self.running, self.is_away, len(self._held)

    @property
    def _is_first(self) -> bool:
        """Whether the next list is the first of this process."""
        return self.received_at == _NEVER

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
        return max([mono - each.since for each in self._running], default=0.0)

    @property
    def due(self) -> float:
        """When `tick` has something to do, monotonic."""
        held = (end.at + REPLACED for end in self._held)
        away = self._away_since
        returns = inf if away is None or not self._running else away + RETURN
        return min((*held, returns), default=inf)

    def see(self, goals: Iterable[Goal], mono: float) -> list[GoalEnd]:
        """Take a list as it was received."""
        before, ends = self.return_(mono), list[GoalEnd]()
        listed = {each.key: each for each in goals}
        running = {each.key: each for each in self._running}
        known = {*running, *self._ended, *self._lost}
        ends += [GoalEnd("unknown", mono) for key in running if key not in listed]
        new = [goal for key, goal in listed.items() if key not in known and not self._is_old(goal)]
        running = {key: each for key, each in running.items() if key in listed}
        for goal in sorted(new, key=attrgetter("stamp")):  # by when they were accepted
            ends += self._begin(goal, running, mono)
        for key, goal in listed.items():
            if goal.has_ended and key in running:
                ends += self._finish(running.pop(key), goal, mono)
        self._running = tuple(running.values())
        self._ended = tuple([key for key, each in listed.items() if each.has_ended])
        going = [key for key, each in listed.items() if not each.has_ended]
        self._lost = tuple([key for key in going if key not in running])
        if listed:
            self._newest = max([each.stamp for each in listed.values()])
        self._is_joined, self.received_at = True, mono
        return before + self._counted(ends)

    def _is_old(self, goal: Goal) -> bool:
        """Whether a goal of the first list had ended before this process, or any, was there."""
        is_counted_before = not self._is_joined or goal.stamp <= self._newest
        return goal.has_ended and self._is_first and is_counted_before

    def _begin(self, goal: Goal, running: dict[Key, _Running], mono: float) -> list[GoalEnd]:
        """Take a goal that is seen the first time; what it takes the place of."""
        self._number += 1
        is_seen = not self._is_first
        self._accepted_at = mono if is_seen else _NEVER
        self.counts.started += is_seen
        if len(running) < MOST_RUNNING:
            whole = is_seen and not goal.has_ended
            running[goal.key] = _Running(goal.key, self._number, mono, whole)
        replaced = [end._replace(result="preempted") for end in self._held]
        self._held = ()
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
            self._held += (end,)
            return []
        return [end]

    def _counted(self, ends: list[GoalEnd]) -> list[GoalEnd]:
        for end in ends:
            self.counts.add(end)
        return ends

    # -- the server ----------------------------------------------------------------------------

    def leave(self, mono: float) -> None:
        """Note that the server, or its robot, cannot be reached."""
        if self._away_since is None:
            self._away_since = mono
            for each in self._running:
                each.whole = False

    def return_(self, mono: float) -> list[GoalEnd]:
        """Note that it is reached again: what it ran, it may still run."""
        ends = self.tick(mono)
        self._away_since = None
        return ends

    def restart(self, mono: float) -> list[GoalEnd]:
        """Note that another process serves the action: it knows nothing of these goals."""
        ends = self._lose_all(mono)
        self._ended = self._lost = ()
        return ends

    def _lose_all(self, mono: float) -> list[GoalEnd]:
        """Follow none of the goals any more: nobody knows how they end."""
        lost, self._running = self._running, ()
        self._lost += tuple([each.key for each in lost])
        return self._counted([GoalEnd("unknown", mono) for _ in lost])

    def tick(self, mono: float) -> list[GoalEnd]:
        """Let time pass."""
        if not self._held and self._away_since is None:
            return []
        ends = [each for each in self._held if mono > each.at + REPLACED]
        self._held = tuple([each for each in self._held if mono <= each.at + REPLACED])
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
            running=[(*_written(each.key), mono - each.since) for each in self._running],
            lost=[_written(each) for each in self._lost],
            results=counts.ended,
            started=counts.started,
            durations=counts.durations,
            seconds=counts.seconds,
        )

    def restore(self, learned: GoalsLearned, mono: float) -> None:
        """Go on from what an earlier process knew: the server is away until it is found."""
        self._newest, self._is_joined, self._away_since = learned.newest, True, mono
        self._running = tuple(
            _Running(key_of(bytes.fromhex(goal_id), stamp), number, mono - age, whole=False)
            for number, (goal_id, stamp, age) in enumerate(learned.running, 1)
        )
        self._number = len(self._running)
        self._lost = tuple([key_of(bytes.fromhex(each), stamp) for each, stamp in learned.lost])
        numbers = [*learned.results, *learned.durations]
        self.counts = Counts(learned.started, learned.seconds, numbers)


def _written(key: Key) -> tuple[str, float]:
    """A goal's id in hexadecimal, and its stamp."""
    goal_id, stamp = parts_of(key)
    return goal_id.hex(), stamp
