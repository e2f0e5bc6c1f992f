"""Which components of a robot depend on which others, by fleet.yml's `depends_on`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from ros_diagnostics_exporter.faults.model import ComponentName
from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.rules import SEARCHED

Dependencies = Mapping[Component, frozenset[ComponentName]]


def find(names: Mapping[Component, ComponentName]) -> Dependencies:
    """All that each component depends on, directly or not; without those that depend on nothing.

    What would depend on itself depends on nothing: else nobody would be notified of it.
    """
    patterns = {each: _patterns(each) for each in names if _patterns(each)}
    matching = _matching({pattern for each in patterns.values() for pattern in each}, names)
    direct = {
        component: {other for pattern in each for other in matching[pattern]}
        for component, each in patterns.items()
    }
    reached = {component: _reached(component, direct) for component in direct}
    return {
        component: frozenset(names[other] for other in others)
        for component, others in reached.items()
        if others and component not in others
    }


def _patterns(component: Component) -> tuple[Pattern, ...]:
    return () if component.rule is None else tuple(component.rule.depends_on)


def _matching(
    patterns: Iterable[Pattern], components: Iterable[Component]
) -> dict[Pattern, list[Component]]:
    """The components of each pattern: each pattern is searched once in each name."""
    names = [(component, component.identity[0][:SEARCHED]) for component in components]
    return {
        pattern: [component for component, name in names if pattern.search(name)]
        for pattern in patterns
    }


def _reached(
    component: Component, direct: Mapping[Component, Iterable[Component]]
) -> dict[Component, None]:
    reached: dict[Component, None] = {}
    ahead = list(direct[component])
    while ahead:
        other = ahead.pop()
        if other not in reached:
            reached[other] = None
            ahead += direct.get(other, ())
    return reached
