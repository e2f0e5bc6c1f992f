"""Events of the levels of one robot's components.

A component that changes all the time has a few events a minute, and one that says how often it
changed: a loose contact at 10 Hz would otherwise be a million events a day.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass
from math import inf

from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.model import Instant, Level
from ros_diagnostics_exporter.robots.component import OK, Component

MOST = 10  # events of one component in a minute, until its changes are only counted
MINUTE = 60.0
MESSAGE = 200  # characters
_NAMES = tuple(level.name for level in Level)


@dataclass(slots=True)
class _Minute:
    """``before`` is the level at the first of the changes that are only counted."""

    begin: float  # monotonic
    events: int = 1
    counted: int = 0
    before: int = OK


class LevelEvents:
    """Appends the events of one robot to ``events``; ``minutes`` are under way, by their begin."""

    def __init__(self, robot: str, events: deque[Event]) -> None:
        self._robot = robot
        self._events = events
        self.minutes: dict[Component, _Minute] = {}

    def record(self, component: Component, before: int, now: Instant, after: str = "") -> None:
        """Record that a level changed; the first one where it is trouble."""
        if before < 0 and component.level == OK and not after:
            return
        minute = self.minutes.get(component)
        if minute is None or after or now.mono >= minute.begin + MINUTE:
            self._end(component, now)
            self.minutes[component] = _Minute(now.mono)
        elif minute.events < MOST:
            minute.events += 1
        else:
            minute.before = minute.before if minute.counted else before
            minute.counted += 1
            return
        self._append(component, before, now, after or _NAMES[component.level], component.message)
        if after:  # it is gone
            del self.minutes[component]

    def tick(self, now: Instant) -> None:
        """End the minutes that are over."""
        while self.next_tick <= now.mono:
            self._end(next(iter(self.minutes)), now)

    @property
    def next_tick(self) -> float:
        """After which time, monotonic, `tick` may have something to do."""
        for minute in self.minutes.values():  # in the order of their begin
            return minute.begin + MINUTE
        return inf

    def _end(self, component: Component, now: Instant) -> None:
        minute = self.minutes.pop(component, None)
        if minute is not None and minute.counted:
            text = f"changed {minute.counted} times in {now.mono - minute.begin:.0f} s"
            message = f"{text}; {component.message}"
            self._append(component, minute.before, now, _NAMES[component.level], message)

    def _append(
        self, component: Component, before: int, now: Instant, after: str, message: str
    ) -> None:
        self._events.append(
            Event(
                time=now.wall,
                kind="level",
                robot=self._robot,
                group=component.group,
                component=component.label,
                before=_NAMES[before] if before >= 0 else "",
                after=after,
                message=message if len(message) <= MESSAGE else message[:MESSAGE] + "…",
            )
        )
