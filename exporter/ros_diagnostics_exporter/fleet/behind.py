"""Which components of a robot are behind which others, by fleet.yml's `depends_on`."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from ros_diagnostics_exporter.faults.model import ComponentName
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.rules import SEARCHED

Found = Mapping[Component, frozenset[ComponentName]]


def find(names: Mapping[Component, ComponentName]) -> Found:
    """All that each component is behind, directly or not; without those behind nothing.

    What would be behind itself is behind nothing: nobody would be notified of it.
    """
    direct = {each: list(_directly(each, names)) for each in names if _rule_has_it(each)}
    found: dict[Component, frozenset[ComponentName]] = {}
    for component, others in direct.items():
        reached: dict[Component, None] = {}
        ahead = list(others)
        while ahead:
            each = ahead.pop()
            if each not in reached:
                reached[each] = None
                ahead += direct.get(each, ())
        if reached and component not in reached:
            found[component] = frozenset(names[each] for each in reached)
    return found


def _rule_has_it(component: Component) -> bool:
    return component.rule is not None and bool(component.rule.depends_on)


def _directly(
    component: Component, names: Mapping[Component, ComponentName]
) -> Iterator[Component]:
    patterns = () if component.rule is None else component.rule.depends_on
    for each in names:
        if any(pattern.search(each.identity[0][:SEARCHED]) for pattern in patterns):
            yield each
