"""What was known of a fault when it began: as fields, and as lines of text for people.

The lines are written from the fields. All but the last end with a semicolon, so that they read well
on one line, too.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping
from datetime import datetime, timezone
from typing import Any, NamedTuple

from ros_diagnostics_exporter.config.fleet import Threshold
from ros_diagnostics_exporter.faults.model import (
    CapabilityState,
    CapabilityView,
    ComponentName,
    Identity,
    PartName,
    Scope,
    State,
)
from ros_diagnostics_exporter.model import Level
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.robots.values import ExportedValue
from ros_diagnostics_exporter.severity import SILENT
from ros_diagnostics_exporter.texts import one_line, unique_without_node

LENGTH = 640  # characters of the lines
_TEXT_LENGTH = 300  # of one text of a robot
_MOST_NAMED = 5  # of values, components or robots

_WORDS = {"WARN": "WARNING", "ERROR": "CRITICAL"}  # as alerts name them

Find = Callable[[Identity], "tuple[RobotState, Component | None] | None"]
Fields = dict[str, Any]  # JSON; web/openapi.yaml says what is in it


class Evidence(NamedTuple):
    """Lines of at most `LENGTH` printable characters in all, and what they say as fields."""

    text: str
    fields: Fields


def evidence(
    identity: Identity,
    find: Find,
    robots: Iterable[str],
    messages: Iterable[str] = (),
    *,
    flapping: Iterable[Component] = (),
    elsewhere: int = 0,
) -> Evidence:
    """The evidence of a fault, but of a capability.

    Args:
        identity: Which fault it is.
        find: The robot and the component that a fault is about, if they are known.
        robots: Those that a fault of no robot counts, or that are behind an uplink.
        messages: What the components say of which a fault of many robots is.
        flapping: The components of the robot that change too often.
        elsewhere: How many robots more other exporters count.
    """
    found = find(identity)
    if identity.scope in (Scope.SITE, Scope.COMMON, Scope.EXPORTER):
        fields = _most(messages) | _first("robots", map(_text, robots), elsewhere)
    elif found is None:
        fields = {}
    elif found[1] is not None:
        fields = _of_component(identity, found[1], found[0])
        if found[1].is_uplink:
            fields |= _first("behind", map(_text, robots))
    else:
        fields = _of_robot(identity, found[0], flapping)
    if found is not None and found[0].last_wall:  # else it contradicts that nothing was received
        fields |= _first("logged", map(_text, found[0].network.logs))
    return _written(fields, {} if found is None else _short_names(found[0].components))


def of_exporter(message: str) -> Evidence:
    """What is wrong with a part of the exporter itself."""
    return Evidence(message[:LENGTH], {"message": message})


def of_capability(
    view: CapabilityView,
    known: Mapping[ComponentName, Component],
    flapping: Iterable[Component],
) -> Evidence:
    """The parts because of which a robot can do something no longer, or no longer well.

    Args:
        view: What is known of the capability.
        known: The robot's components.
        flapping: Those of them that change too often.
    """
    restless = set(flapping)
    fields = _first("parts", (_part(*each, known, restless) for each in view.parts.items()))
    return _written(fields, _short_names(known.values()))


def _part(
    part: PartName,
    state: CapabilityState,
    known: Mapping[ComponentName, Component],
    flapping: Container[Component],
) -> Fields:
    fields: Fields = {key: _text(text) for key, text in part._asdict().items() if text}
    component = known.get(ComponentName(part.group, part.component))
    beyond = _beyond(component, part.key) if component is not None and part.key else None
    if beyond is not None:
        fields |= {"message": beyond}
    elif component is not None:
        fields |= {"level": Level(component.level).name, "message": _text(component.message)}
        fields |= {"flaps": True} if component in flapping else {}
    return {**fields, "state": state.name.lower()}


def _beyond(component: Component, key: str) -> str | None:
    """Which threshold a value of a component is beyond, the critical one first."""
    for value in () if component.is_stale else component.values.all:
        if value.key == key and value.beyond:
            worst = min(value.beyond, key=lambda each: each.severity)  # critical, warning
            return _value_line(_compared(value, worst, worst.bound))
    return None


def last_received(identity: Identity, find: Find) -> str:
    """What ended a fault, as received: a component's level and message, or its value."""
    found = find(identity)
    component = None if found is None else found[1]
    if component is None or component.level < Level.OK:
        return ""
    if component.suppressed_because:
        return component.suppressed_because
    if identity.scope is Scope.VALUE and not component.has_lapsed:
        numbers = [each for each in component.values.all if each.key == identity.key]
        parts = [f"{each.number:g} {_text(each.unit)}".strip() for each in numbers]
        place = identity.bound, identity.state.value
        if any((each.bound, each.severity) == place for value in numbers for each in value.beyond):
            parts.append("no fault by the condition of its thresholds")
    else:
        level = Level(component.level).name
        parts = [_WORDS.get(level, level), _text(component.message)]
        parts = list(dict.fromkeys(parts))  # many drivers say OK twice
    return ": ".join(filter(None, parts))[:LENGTH]


# -- fields ------------------------------------------------------------------------------------


def _of_component(identity: Identity, component: Component, robot: RobotState) -> Fields:
    own = None if component.rule is None else component.rule.confirm_after
    profile = robot.settings.profile
    fields: Fields = {
        "level": Level(component.level).name,
        "level_since": component.since,
        "message": _text(component.message),
        "reports": component.reports,
        **_on_change(component),
        "hardware_id": _text(component.hardware_id),
        "profile": profile.name,
        "confirm_after": profile.confirm_after if own is None else own,
    }
    if identity.scope is Scope.VALUE:
        fields |= _monitored(identity, component)
    elif component.last is not None and component.feed is None:  # a query's message has it
        fields |= _first("values", _values(component))
    others = (each for each in robot.components if each is not component and _is_troubled(each))
    return fields | _first("also_faulty", map(_with_level, others))


def _on_change(component: Component) -> Fields:
    if not component.is_on_change:
        return {}
    once = {"reported_once": component.since} if component.is_reported_once else {}
    return {"reports_on_change": True, **once}


def _monitored(identity: Identity, component: Component) -> Fields:
    """The number and the threshold that it is beyond, or falls to."""
    severity = "critical" if identity.state is State.FALLING else identity.state.value
    for value in component.values.all:
        if value.key == identity.key and value.rule is not None:
            for each in value.rule.thresholds:
                if (each.bound, each.severity) == (identity.bound, severity):
                    beyond = "falling" if identity.state is State.FALLING else each.bound
                    return {"value": _compared(value, each, beyond)}
    return {}


def _most(messages: Iterable[str]) -> Fields:
    """What most of them say, and how many do where not all do."""
    said = Counter(filter(None, messages))
    if not said:
        return {}
    ((message, number),) = said.most_common(1)
    share = "" if number == said.total() else f" ({number} of {said.total()})"
    return {"most_say": _text(message) + share}


def _compared(value: ExportedValue, threshold: Threshold, beyond: str) -> Fields:
    """A number with a threshold, and how it is beyond it."""
    limit = {"threshold": threshold.value, "beyond": beyond}
    shown = {"key": _text(value.key), "text": f"{value.number:g}"}
    return {**shown, **_number(value), **limit}


def _values(component: Component) -> Iterator[Fields]:
    """Its key-values as last published, with the number as which each is exported, if it is one."""
    pairs = () if component.last is None else component.last.values
    for (key, text), numbers in zip(pairs, component.values.exported(pairs), strict=True):
        number = _number(numbers[0]) if len(numbers) == 1 else {}
        yield {"key": _text(key), "text": _text(text), **number}


def _number(value: ExportedValue) -> Fields:
    finite = abs(value.number) < float("inf")  # JSON has no others
    return {"number": value.number if finite else None, "unit": _text(value.unit)}


def _of_robot(identity: Identity, robot: RobotState, flapping: Iterable[Component]) -> Fields:
    if identity.scope is Scope.CHECK:
        expected = {check.name: check.expect for check in robot.settings.profile.checks}
        found = {name: sum(counts) for name, counts in robot.components.count_checks()}
        if identity.check in found:
            return {"found": found[identity.check], "expected": expected[identity.check]}
    elif identity.state is State.MANY:
        restless = set(flapping)
        troubled = [each for each in robot.components if each in restless or _is_troubled(each)]
        return _first("components", (_with_level(each, each in restless) for each in troubled))
    elif identity.state is State.CLOCK and robot.clock_behind is not None:
        return {"clock_offset": robot.clock_behind}
    elif robot.silent_reason is not None:
        return {"silent_reason": robot.silent_reason, "last_message": robot.last_wall or None}
    return {}


def _is_troubled(component: Component) -> bool:
    return component.level > Level.OK and not component.suppressed_because


def _with_level(component: Component, flaps: bool = False) -> Fields:
    return {
        "group": _text(component.group),
        "component": _text(component.label),
        "level": Level(component.level).name,
        **({"flaps": True} if flaps else {}),
    }


def _first(name: str, items: Iterable[Any], further: int = 0) -> Fields:
    """A list of the first few of them, and how many more there are, ``further`` ones among them."""
    listed = list(items)
    more = max(0, len(listed) - _MOST_NAMED) + further
    found = {name: listed[:_MOST_NAMED]} if listed or further else {}
    return found | ({f"more_{name}": more} if more else {})


# -- lines -------------------------------------------------------------------------------------


def _short_names(components: Iterable[Component]) -> Mapping[str, str]:
    return unique_without_node([_text(each.label) for each in components])


def _written(fields: Fields, short: Mapping[str, str]) -> Evidence:
    text = ";\n".join(filter(None, _lines(fields, short)))
    return Evidence(text if len(text) <= LENGTH else text[: LENGTH - 3] + "...", fields)


def _lines(fields: Fields, short: Mapping[str, str]) -> Iterator[str]:
    def named(component: Fields) -> str:
        name, level = component["component"], component["level"]
        word = "FLAPPING" if "flaps" in component else _WORDS.get(level, level)
        return f"{short.get(name, name)} {word}"

    if "value" in fields:
        yield _value_line(fields["value"])
    if "reports" in fields:
        yield _account(fields)
    if "reported_once" in fields:
        at = datetime.fromtimestamp(fields["reported_once"], timezone.utc)
        yield f"reported once, at {at:%Y-%m-%d %H:%M:%S} UTC; it reports only changes"
    elif "reports_on_change" in fields:
        yield "it reports only changes"
    if "found" in fields:
        yield f"{fields['found']} of {fields['expected']} components report"
    if "clock_offset" in fields:
        where = "behind" if fields["clock_offset"] > 0 else "ahead of"
        yield f"its clock is {abs(fields['clock_offset']):.0f} s {where} the exporter's"
    if "silent_reason" in fields:
        yield SILENT[fields["silent_reason"]]
    for part in fields.get("parts", ()):
        name = named(part) if "level" in part else part.get("component", "")
        yield _part_line(name, part)
    yield fields.get("most_say", "")
    yield _list_line("robots", fields, "robots", str, is_counted=True)
    yield _list_line("robots behind it", fields, "behind", str, is_counted=True)
    yield _list_line("components", fields, "components", named, is_counted=True)
    yield _list_line("values", fields, "values", lambda each: f"{each['key']}: {each['text']}")
    yield _list_line("logged", fields, "logged", str)
    yield _list_line("also faulty", fields, "also_faulty", named)


def _value_line(value: Fields) -> str:
    how = {"low": "below", "high": "above", "falling": "falling to"}[value["beyond"]]
    unit = f" {value['unit']}" if value["unit"] else ""
    return f"{value['text']}{unit}, {how} the threshold of {value['threshold']:g}{unit}"


def _account(fields: Fields) -> str:
    """The message; of a component that says nothing any more, that it is old."""
    message: str = fields["message"]
    if fields["reports"]:
        return message
    return "no longer reports" + (f"; its last message: {message}" if message else "")


def _part_line(name: str, part: Fields) -> str:
    if "check" in part:
        return f"check {part['check']} finds too few components"
    return ": ".join(filter(None, (name, part.get("key"), part.get("message"))))


def _list_line(
    words: str, fields: Fields, name: str, text: Callable[[Any], str], *, is_counted: bool = False
) -> str:
    """The first few; with ``is_counted`` after their number, which a short text may end with."""
    if name not in fields:
        return ""
    more = fields.get(f"more_{name}", 0)
    number = len(fields[name]) + more
    counted = f"{number} " if is_counted and number > 1 else ""
    if not fields[name]:
        return f"{counted}{words} of other exporters"
    rest = f" and {more} more" if more else ""
    return f"{counted}{words}: {', '.join(map(text, fields[name]))}{rest}"


def _text(text: str) -> str:
    """A robot's text, on one line."""
    return one_line(text if len(text) <= _TEXT_LENGTH else text[: _TEXT_LENGTH - 3] + "...")
