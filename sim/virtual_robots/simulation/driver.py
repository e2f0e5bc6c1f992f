"""A robot's driver node: its components, and the arrays that it publishes on its raw topic.

It does not know when, nor where to.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from virtual_robots.model import Status
from virtual_robots.schema.actions import ActionModel
from virtual_robots.schema.topics import TopicModel, Tree
from virtual_robots.simulation.actions import Action, Step
from virtual_robots.simulation.components import Component, Fault

SEQUENCE = "Sequence"


@dataclass
class Driver:
    """A driver node; ``clock_offset`` (seconds) is added to its header stamps."""

    name: str
    components: list[Component]
    actions: list[Action] = field(default_factory=list)
    sequence: int = 0
    clock_offset: float = 0.0
    _last_tick: float | None = field(default=None, repr=False)
    _latched: dict[str, Tree] = field(default_factory=dict, repr=False)

    @property
    def parts(self) -> list[Component | Action]:
        """What can have a fault: its components, and its actions."""
        return [*self.components, *self.actions]

    def part(self, name: str) -> Component | Action:
        """Return a component or action. Raises KeyError with a text that lists all names."""
        for part in self.parts:
            if part.name == name:
                return part
        known = ", ".join(each.name for each in self.parts)
        raise KeyError(f"{self.name} has no component {name!r}, only {known}")

    def inject(self, part: str, fault: Fault | None) -> None:
        """Begin or end a fault. Raises KeyError or UnknownFaultError."""
        self.part(part).inject(fault)

    def replace_components(self, components: list[Component]) -> None:
        """Replace the components; one with the name of an old one keeps its values and fault."""
        before = {component.name: component for component in self.components}
        for component in components:
            if component.name in before:
                component.copy_state(before[component.name])
        self.components = components

    def boot(self) -> None:
        """Start the process anew: the sequence begins at 1 and no component has run yet."""
        self.sequence = 0
        self._last_tick = None
        self._latched.clear()
        self.leave_graph()

    def tick(self, now: float) -> tuple[Status, ...]:
        """Return the array to publish at ``now``: a status for each component that reports.

        The first array after a boot is what diagnostic_updater sends for tasks that have not run.
        The first status of each array has the message's number as its last key-value, so that a
        reader can count lost messages.
        """
        self.sequence += 1
        if self._last_tick is None:
            self._last_tick = now
            reporting = (each for each in self.components if each.model.publishes is None)
            statuses = [component.starting_up() for component in reporting]
        else:
            elapsed, self._last_tick = now - self._last_tick, now
            statuses = self._advanced(now, elapsed)
        if statuses:
            numbered = (*statuses[0].values, (SEQUENCE, str(self.sequence)))
            statuses[0] = statuses[0]._replace(values=numbered)
        return tuple(statuses)

    def _advanced(self, now: float, elapsed: float) -> list[Status]:
        statuses = []
        for component in self.components:
            component.advance(now, elapsed)
            in_array = component.model.publishes is None
            if in_array and (status := component.status(now)) is not None:
                statuses.append(status)
        return statuses

    @property
    def has_diagnostics(self) -> bool:
        """Whether any component is in its arrays."""
        return any(component.model.publishes is None for component in self.components)

    def messages(self) -> Iterator[tuple[TopicModel, Tree]]:
        """The messages of topics of their own that are due, with their fields."""
        for component in self.components:
            topic, fields = component.model.publishes, component.fields()
            if topic is None or fields is None:
                continue
            if not topic.latched or self._latched.get(topic.topic) != fields:
                self._latched[topic.topic] = fields
                yield topic, fields

    def goal_steps(self, now: float, *, reached: bool) -> Iterator[tuple[ActionModel, Step]]:
        """What has happened to its actions by ``now``; whether their client ``reached`` it."""
        for action in self.actions:
            needs = action.model.needs
            fit = needs is None or self.part(needs).fault is None
            for step in action.advance(now, fit=fit, reached=reached):
                yield action.model, step

    def leave_graph(self) -> None:
        """Its action servers are gone, and start anew when it is back."""
        for action in self.actions:
            action.boot()

    def publish_again(self) -> None:
        """Have what is latched published again: the robot left the graph."""
        self._latched.clear()
