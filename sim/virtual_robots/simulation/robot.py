"""One robot: its components, its sequence number, whether it lives.

Owns what the robot publishes on its raw topic; it does not know when, nor where to.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from virtual_robots.model import Status
from virtual_robots.simulation.components import Component, Fault

SEQUENCE = "Sequence"


@dataclass
class Robot:
    """A robot as its driver node sees it; ``clock_offset`` is added to its header stamps."""

    name: str
    components: list[Component]
    sequence: int = 0
    clock_offset: float = 0.0
    _ticked: float | None = field(default=None, repr=False)

    def component(self, name: str) -> Component:
        """A component by its name. Raises KeyError with a text that lists them."""
        for component in self.components:
            if component.name == name:
                return component
        known = ", ".join(self.component_names())
        raise KeyError(f"{self.name} has no component {name!r}, only {known}")

    def component_names(self) -> list[str]:
        """The names of its components, in their order."""
        return [component.name for component in self.components]

    def inject(self, component: str, fault: Fault | None) -> None:
        """Begin or end a fault. Raises KeyError or UnknownFaultError."""
        self.component(component).inject(fault)

    def replace_components(self, components: list[Component]) -> None:
        """Take new components; of one that was there already, values and fault stay."""
        before = {component.name: component for component in self.components}
        for component in components:
            if component.name in before:
                component.carry_on(before[component.name])
        self.components = components

    def boot(self) -> None:
        """The driver's process starts anew: the sequence too, and nothing has run yet."""
        self.sequence = 0
        self._ticked = None

    def tick(self, now: float) -> tuple[Status, ...]:
        """What the robot publishes at ``now``: one array of those components that report.

        The array after a boot is what diagnostic_updater sends for each task at once. The first
        status of an array carries the message's number as its last key-value, so a reader finds it
        in every message, and no component is there only for its sake.
        """
        self.sequence += 1
        if self._ticked is None:
            self._ticked = now
            statuses = [component.starting_up() for component in self.components]
        else:
            elapsed, self._ticked = now - self._ticked, now
            statuses = self._advanced(now, elapsed)
        if statuses:
            numbered = (*statuses[0].values, (SEQUENCE, str(self.sequence)))
            statuses[0] = statuses[0]._replace(values=numbered)
        return tuple(statuses)

    def _advanced(self, now: float, elapsed: float) -> list[Status]:
        statuses = []
        for component in self.components:
            component.advance(now, elapsed)
            if (status := component.status(now)) is not None:
                statuses.append(status)
        return statuses
