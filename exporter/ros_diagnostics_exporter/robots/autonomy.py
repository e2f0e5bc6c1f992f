"""Whether one robot works by itself, for how long it did, and how often somebody had to help.

A robot that leaves autonomous before its goal has succeeded is an *intervention*. What is not known
(the component with the mode is STALE) is neither time of autonomy nor an end of it. Pure.
"""

from __future__ import annotations

from typing import Annotated, NamedTuple

from pydantic import Field

from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.robots.goals import GoalEnd


class AutonomyLearned(NamedTuple):
    """What a later process should know; see `Autonomy`."""

    seconds: Annotated[float, Field(ge=0, le=1e11, allow_inf_nan=False)]
    interventions: Annotated[int, Field(ge=0, le=2**53)]
    was_autonomous: bool
    is_counted: bool
    has_succeeded: bool
    is_stopped: bool


class Autonomy:
    """The autonomy of one robot."""

    def __init__(self) -> None:
        self.interventions = 0
        self.seconds = 0.0  # until it was updated last
        self._since: float | None = None  # monotonic; None: it is not autonomous, or not known
        self._was = False  # autonomous, when that was known last
        self._is_counted = False  # an intervention of this time of autonomy
        self._has_succeeded = False  # its last goal
        self._is_stopped = False  # by a condition that is an intervention

    def read(self, mono: float) -> float:
        """Seconds of autonomy until now."""
        return self.seconds + (0.0 if self._since is None else mono - self._since)

    @property
    def is_running(self) -> bool:
        """Whether it works by itself, as far as is known."""
        return self._since is not None

    def advance(self, mono: float) -> None:
        """Let time pass."""
        self.seconds = self.read(mono)
        self._since = None if self._since is None else mono

    def note_end(self, end: GoalEnd) -> None:
        """Take that a goal of its work ended."""
        self._has_succeeded = end.result == "succeeded"

    def update(
        self, *, autonomous: bool | None, stopped: bool | None, running: int, now: Instant
    ) -> bool:
        """Take how it is; whether an intervention began.

        ``stopped``: a condition holds that is one; ``running`` goals of its work have not ended.
        """
        self.advance(now.mono)
        self._since = now.mono if autonomous else None
        was, before = self._was, self._is_stopped
        self._was = was if autonomous is None else autonomous
        self._is_stopped = before if stopped is None else stopped
        if autonomous and not was:
            self._is_counted, self._has_succeeded = False, False
        left = was and autonomous is False
        if left and self._has_succeeded and not running:
            return False
        return self._count(begins=left or (self._was and self._is_stopped and not before))

    def _count(self, *, begins: bool) -> bool:
        """Count an intervention once for each time of autonomy, and each stop in it."""
        counts = begins and not self._is_counted
        self.interventions += counts
        self._is_counted = begins or (self._is_counted and self._is_stopped)
        return counts

    def learned(self, now: Instant) -> AutonomyLearned:
        """What a later process should know."""
        return AutonomyLearned(
            self.read(now.mono),
            self.interventions,
            self._was,
            self._is_counted,
            self._has_succeeded,
            self._is_stopped,
        )

    def restore(self, learned: AutonomyLearned) -> None:
        """Go on from what an earlier process knew."""
        self.seconds, self.interventions = learned.seconds, learned.interventions
        self._was, self._is_counted = learned.was_autonomous, learned.is_counted
        self._has_succeeded, self._is_stopped = learned.has_succeeded, learned.is_stopped
