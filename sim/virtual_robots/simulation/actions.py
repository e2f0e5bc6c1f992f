"""An action of a robot, and the client that sends it goals: which goal begins and ends when.

It does not know ROS: ros/actions.py carries the steps out with a real action server.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from random import Random
from typing import NamedTuple

from virtual_robots.schema.actions import ActionModel
from virtual_robots.simulation.components import Fault, UnknownFaultError

# Seconds after which Fast DDS drops a participant that sends nothing any more (its default lease).
LEASE = 20.0


class Step(Enum):
    """What happens to an action's server, or to the goal that runs."""

    START = "start"  # a new server, without goals
    BEGIN = "begin"
    SUCCEED = "succeed"
    ABORT = "abort"
    CANCEL = "cancel"  # by the client
    REPLACE = "replace"  # the next goal is accepted, then the one that runs is aborted, as in Nav2
    GONE = "gone"  # a server that was killed leaves the graph


FAULTS = ("abort", "cancel", "preempt", "hang", "killed")


class Goal(NamedTuple):
    """A goal that runs: from when to when, in seconds."""

    began: float
    ends: float

    @property
    def half(self) -> float:
        """The middle of its time."""
        return (self.began + self.ends) / 2


@dataclass
class Action:
    """An action of one robot; ``rng`` is its share of the robot's seed.

    Its faults: goals are aborted, cancelled or preempted, or do not end (`hang`); or the server is
    `killed` in the middle of a goal, and starts again when the fault ends.
    """

    model: ActionModel
    rng: Random
    fault: Fault | None = None

    def __post_init__(self) -> None:
        self.boot()

    @property
    def name(self) -> str:
        """The action's name in the robot's namespace."""
        return self.model.name

    def known_faults(self) -> tuple[str, ...]:
        """Return the names that `inject` accepts."""
        return FAULTS

    def inject(self, fault: Fault | None) -> None:
        """Begin a fault, or end it (None). Raises UnknownFaultError."""
        if fault is not None and fault.what not in FAULTS:
            raise UnknownFaultError(
                f"{self.name} has no fault {fault.what!r}, only {', '.join(FAULTS)}"
            )
        self.fault = fault

    def boot(self) -> None:
        """Start the process anew: there is no server yet, and no goal."""
        self._is_up = False
        self._goal: Goal | None = None
        self._next = 0.0
        self._in_graph = False
        self._aborted = 0  # in a row

    def advance(self, now: float, *, fit: bool, reached: bool) -> Iterator[Step]:
        """What has happened by ``now``.

        Args:
            now: Seconds since the fleet's start.
            fit: Whether what the action needs has no fault.
            reached: Whether the client reaches the robot: without that no goal begins or ends.
        """
        if self._what() == "killed":
            yield from self._killed(now)
        elif not reached:
            return
        elif not self._is_up:
            self._is_up = self._in_graph = True
            self._next = now + self.model.pause
            yield Step.START
        elif self._goal is None:
            yield from self._begun(now, fit)
        else:
            yield from self._ended(now, self._goal, fit)

    def _what(self) -> str:
        return self.fault.what if self.fault else ""

    def _killed(self, now: float) -> Iterator[Step]:
        self._is_up, self._goal = False, None
        if self._in_graph and self.fault and now - self.fault.since >= LEASE:
            self._in_graph = False
            yield Step.GONE

    def _begun(self, now: float, fit: bool) -> Iterator[Step]:
        given_up = not fit and self._aborted >= self.model.tries
        if now >= self._next and not given_up:
            self._goal = self._new_goal(now)
            yield Step.BEGIN

    def _ended(self, now: float, goal: Goal, fit: bool) -> Iterator[Step]:
        what = self._what()
        if what == "preempt" and now >= goal.half:
            self._goal = self._new_goal(now)
            yield Step.REPLACE
        elif what == "cancel" and now >= goal.half:
            yield self._over(now, Step.CANCEL)
        elif what != "hang" and now >= goal.ends:
            aborts = what == "abort" or not fit
            yield self._over(now, Step.ABORT if aborts else Step.SUCCEED)

    def _over(self, now: float, step: Step) -> Step:
        self._goal, self._next = None, now + self.model.pause
        self._aborted = self._aborted + 1 if step is Step.ABORT else 0
        return step

    def _new_goal(self, now: float) -> Goal:
        return Goal(now, now + self.rng.uniform(*self.model.takes))
