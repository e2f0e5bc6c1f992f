"""What was not reported since its robot came back: what is wrong from then on may be a boot."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.robot import RobotState


class FirstReports:
    """The components that were received since a robot came back.

    ``now``: those that are reported for the first time. One whose trouble is not judged yet, as its
    condition is not known, is not received yet; nor is one that reports only changes and is as it
    was before the robot went.
    """

    def __init__(self, robot: RobotState) -> None:
        self.now: set[Component] = set()
        self._received: set[Component] = set()
        self._values: set[tuple[Component, str]] = set()  # that are not judged yet
        self._resumed = {  # with the last report, which was before
            each: each.last_report
            for each in robot.components
            if each.is_on_change and each.last_report != robot.last_mono
        }

    def note(self, changed: Iterable[Component], is_judged: Callable[[Component], bool]) -> None:
        """Note which components are reported now, and which of them are judged."""
        self.now = set(changed) - self._received
        self._received |= {
            each
            for each in self.now
            if self._resumed.get(each) != each.last_report and is_judged(each)
        }

    def has_value(self, component: Component, key: str, *, waits: bool) -> bool:
        """Whether a value is reported for the first time; ``waits``: it is not judged by that."""
        place = component, key
        is_first = component in self.now or place in self._values
        self._values.discard(place)
        if is_first and waits:
            self._values.add(place)
        return is_first
