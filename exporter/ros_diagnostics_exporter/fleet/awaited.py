"""The components of one robot of which nothing is received, until that is known to mean something.

An array of the robot shows that they are absent: if none comes it is the robot that is silent, and
before that a slow driver is no stale component.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import inf, nextafter

from ros_diagnostics_exporter.config.fleet import Source
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.robot import RobotState


class Awaited:
    """Each with when (monotonic) an array of its robot shows that it is absent."""

    def __init__(self, robot: RobotState) -> None:
        self._robot = robot
        self._absent: dict[Component, float] = {}

    def __bool__(self) -> bool:
        return bool(self._absent)

    def __contains__(self, component: Component) -> bool:
        return component in self._absent

    def clear(self) -> None:
        """Wait for none."""
        self._absent.clear()

    def drop(self, component: Component) -> None:
        """No longer wait for one."""
        self._absent.pop(component, None)

    def _last(self, now: Instant) -> float:
        """When the robot's last array was received, monotonic; now, of one that is never silent."""
        return now.mono if self._robot.is_never_silent else self._robot.last_mono or 0.0

    def _last_of(self, component: Component, now: Instant) -> float:
        """When what delivers a component was last received, monotonic."""
        answered = self._robot.measured.last_answer(component)
        return self._last(now) if answered is None else answered

    def await_raw(self, now: Instant) -> None:
        """Wait for the raw components that the array which brought the robot back lacks."""
        default, last = self._robot.settings.profile.stale_after, self._last(now)
        for component in self._robot.components:
            if self._is_raw(component) and component.is_stale and component.listed < last:
                absent = last + component.stale_after(default, raw=True)
                self._absent.setdefault(component, absent)

    def await_late(self, changed: Iterable[Component], now: Instant) -> None:
        """Wait for an array that lacks the components that turned STALE because none came."""
        default = self._robot.settings.profile.stale_after
        for component in changed:
            if not component.is_stale or self._is_reported_stale(component, now):
                continue
            # An aggregator's next array: those since that lacked it were of one that just started.
            absent = nextafter(self._last(now), inf)
            if self._is_raw(component):
                # An aggregator lists it, too, whose copies are older.
                last = component.raw_received or component.listed
                absent = last + component.stale_after(default, raw=True)
            if absent > self._last_of(component, now):
                self._absent.setdefault(component, absent)

    def _is_raw(self, component: Component) -> bool:
        if not component.is_published:  # an array says nothing of it
            return True
        return self._robot.source is Source.RAW or component.raw_received is not None

    def _is_reported_stale(self, component: Component, now: Instant) -> bool:
        """Whether the last array has the component as STALE, or is an aggregator's without it."""
        if component.missing:
            return True
        return component.stale_at_source and component.listed >= self._last_of(component, now)

    def has_found(self, now: Instant) -> bool:
        """Whether the last array shows one of them to be absent, or has it as STALE.

        That is no change of its level, which was STALE before for want of anything received.
        """
        return any(
            self._last_of(component, now) >= absent or self._is_reported_stale(component, now)
            for component, absent in self._absent.items()
        )

    def find(self, now: Instant) -> None:
        """Have those reported that are received now, or that an array shows to be absent."""
        for component, absent in list(self._absent.items()):
            is_known = not component.is_stale or self._is_reported_stale(component, now)
            if is_known or self._last_of(component, now) >= absent:
                del self._absent[component]
                self._robot.components.report_again(component)
