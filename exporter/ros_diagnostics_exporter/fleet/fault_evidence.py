"""What was known of a fault when it began: lines of text for people.

All but the last end with a semicolon, so that it reads well on one line, too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping

from ros_diagnostics_exporter.faults.model import (
    AbilityView,
    ComponentName,
    Identity,
    PartName,
    Scope,
    State,
)
from ros_diagnostics_exporter.model import Level
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.robot import Robot
from ros_diagnostics_exporter.severity import SILENT
from ros_diagnostics_exporter.texts import one_line

LENGTH = 512  # characters of the whole
_TEXT_LENGTH = 160  # of one text of a robot
_MOST_NAMED = 5  # of values, components or robots

_WORDS = {Level.WARN: "WARNING", Level.ERROR: "CRITICAL"}  # as alerts name them

Find = Callable[[Identity], "tuple[Robot, Component | None] | None"]


def evidence(identity: Identity, find: Find, robots: Iterable[str]) -> str:
    """The evidence of a fault, printable lines of at most `LENGTH` characters in all.

    Args:
        identity: Which fault it is.
        find: The robot and the component that a fault is about, if they are known.
        robots: Those that a fault of no robot counts.
    """
    found = find(identity)
    if identity.scope in (Scope.SITE, Scope.COMMON, Scope.CLOCK):
        parts = [_listed("robots", robots)]
    elif found is None:
        parts = []
    elif found[1] is not None:
        parts = list(_of_component(identity, found[1], found[0]))
    else:
        parts = list(_of_robot(identity, found[0]))
    return ";\n".join(filter(None, parts))[:LENGTH]


def parts(of: AbilityView, known: Mapping[ComponentName, Component]) -> str:
    """The parts because of which a robot can do something no longer, or no longer well.

    Args:
        of: What is known of the capability.
        known: The robot's components.
    """
    return ";\n".join(_part(each, known) for each in list(of.parts)[:_MOST_NAMED])[:LENGTH]


def _part(part: PartName, known: Mapping[ComponentName, Component]) -> str:
    if part.check:
        return f"check {_text(part.check)} finds too few components"
    component = known.get(ComponentName(part.group, part.component))
    if component is None:
        return _text(part.component)
    texts = [_with_level(component), _text(part.key), _text(component.message)]
    return ": ".join(filter(None, texts))


def last_received(identity: Identity, find: Find) -> str:
    """What ended a fault, as received: a component's level and message, or its value."""
    found = find(identity)
    component = None if found is None else found[1]
    if component is None or component.level < Level.OK:
        return ""
    if identity.scope is Scope.VALUE:
        numbers = (each for each in component.values.all if each.key == identity.key)
        parts = [f"{each.number:g} {_text(each.unit)}".strip() for each in numbers]
    else:
        level = Level(component.level)
        parts = [_WORDS.get(level, level.name), _text(component.message)]
    return ": ".join(filter(None, parts))[:LENGTH]


def _of_component(identity: Identity, component: Component, robot: Robot) -> Iterator[str]:
    if identity.scope is Scope.VALUE:
        yield from _monitored(identity, component)
    yield _text(component.account)
    if component.last is not None and identity.scope is not Scope.VALUE:
        pairs = (f"{_text(key)}: {_text(text)}" for key, text in component.last.values)
        yield _listed("values", pairs)
    yield _listed("logged", map(_text, robot.network.logs))
    others = (each for each in _troubled(robot) if each is not component)
    yield _listed("also faulty", map(_with_level, others))


def _monitored(identity: Identity, component: Component) -> Iterator[str]:
    """The number and the threshold that it is beyond, or falls to."""
    severity, how = identity.state.value, "below" if identity.bound == "low" else "above"
    if identity.state is State.FALLING:
        severity, how = "critical", "falling to"
    for value in component.values.all:
        if value.key == identity.key and value.rule is not None:
            for each in value.rule.thresholds:
                if (each.bound, each.severity) == (identity.bound, severity):
                    unit = f" {_text(value.unit)}" if value.unit else ""
                    yield f"{value.number:g}{unit}, {how} the threshold of {each.value:g}{unit}"


def _of_robot(identity: Identity, robot: Robot) -> Iterator[str]:
    if identity.scope is Scope.CHECK:
        expected = {check.name: check.expect for check in robot.settings.profile.checks}
        found = {name: sum(counts) for name, counts in robot.components.count_checks()}
        if identity.check in found:
            yield f"{found[identity.check]} of {expected[identity.check]} components report"
    elif identity.state is State.MANY:
        yield _listed("components", map(_with_level, _troubled(robot)))
    elif identity.state is State.CLOCK and robot.clock_behind is not None:
        where = "behind" if robot.clock_behind > 0 else "ahead of"
        yield f"its clock is {abs(robot.clock_behind):.0f} s {where} the exporter's"
    elif robot.silent_reason is not None:
        yield SILENT[robot.silent_reason]
    yield _listed("logged", map(_text, robot.network.logs))


def _troubled(robot: Robot) -> Iterator[Component]:
    return (each for each in robot.components if each.level > Level.OK and not each.quiet_because)


def _with_level(component: Component) -> str:
    level = Level(component.level)
    return f"{_text(component.label)} {_WORDS.get(level, level.name)}"


def _listed(what: str, texts: Iterable[str]) -> str:
    """The first few of them, and how many more there are."""
    found = list(texts)
    if not found:
        return ""
    more = len(found) - _MOST_NAMED
    rest = f" and {more} more" if more > 0 else ""
    return f"{what}: {', '.join(found[:_MOST_NAMED])}{rest}"


def _text(text: str) -> str:
    """A robot's text, on one line."""
    return one_line(text[:_TEXT_LENGTH])
