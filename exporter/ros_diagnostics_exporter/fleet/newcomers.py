"""How many robots that fleet.yml does not declare may be found, and how soon.

Whoever may publish can invent robots, some every second, each with a name and components of its
own. Those that another process knew, and those of the first minutes, are not limited: a fleet that
is found for the first time may be large. But a fleet stays, and invented robots go.
"""

from __future__ import annotations

from ros_diagnostics_exporter.config.fleet import Source
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.robots.robot import RobotState

STARTING = 120.0  # seconds after the start in which a fleet is found
REFILL = 600.0  # seconds in which as many as `limits.new_robots` may be found, after that many


class NewcomerRate:
    """Counts robots; ``at_once`` may be found at once, and as many again in `REFILL`."""

    def __init__(self, at_once: int, now: Instant) -> None:
        self.at_once = at_once
        self._free_until = now.mono + STARTING
        self._found: list[RobotState] = []  # until then
        self._left = float(at_once)
        self._at = now.mono

    def limits(self, now: Instant) -> bool:
        """Whether robots are counted already."""
        return now.mono >= self._free_until

    def note(self, robot: RobotState, now: Instant) -> None:
        """Note a robot that was found; of the first minutes each may turn out to be invented."""
        robot.is_newcomer = self.limits(now)
        if not robot.is_newcomer:
            self._found.append(robot)

    def look(self, now: Instant) -> None:
        """Begin to count at once where too many robots of the first minutes are gone already."""
        gone = sum(map(_is_gone, self._found))
        if gone >= self.at_once and not self.limits(now):
            self._free_until, self._left, self._at = now.mono, 0.0, now.mono
            for robot in self._found:
                robot.is_newcomer = True
        if self.limits(now):
            self._found.clear()

    def take(self, now: Instant) -> bool:
        """Count one more; False where there are too many."""
        if not self.limits(now):
            return True
        gained = (now.mono - self._at) * self.at_once / REFILL
        self._left, self._at = min(self.at_once, self._left + gained), now.mono
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


def _is_gone(robot: RobotState) -> bool:
    """Whether nobody publishes as a robot any more, as far as is known."""
    if robot.shared or robot.settings.source is Source.NONE:  # it has no publisher of its own
        return robot.last_mono is not None and not robot.up
    return not robot.network.publishers
