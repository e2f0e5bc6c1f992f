"""What robots of a profile can do: expressions over their components, values and checks."""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Annotated, Any, Literal

from typing_extensions import override

from ros_diagnostics_exporter.config.conditions import ConditionList
from ros_diagnostics_exporter.config.errors import WrongValueError, quoted, suggestion
from ros_diagnostics_exporter.config.keys import Entry, Value, described
from ros_diagnostics_exporter.config.patterns import MAX_PATTERN, wildcard, word
from ros_diagnostics_exporter.config.scalars import text
from ros_diagnostics_exporter.regex import Pattern

MOST = 100  # of one profile
MOST_PARTS = 1000  # of one list
_DEPTH = 10  # of lists in one another
_FORMS = "all, any, at_least, degraded_is_ok, degraded_is_lost, component, check or capability"


@dataclass(frozen=True)
class ComponentsOf:
    """The components whose name has one of the words; with ``keys`` their values of these keys."""

    patterns: tuple[Pattern, ...]
    keys: tuple[Pattern, ...] = ()


@dataclass(frozen=True)
class CheckOf:
    """A check of the profile: that it finds enough components, and how these are."""

    name: str


@dataclass(frozen=True)
class CapabilityOf:
    """Another capability of the profile."""

    name: str


@dataclass(frozen=True)
class RobotsOf:
    """The robots with these labels that have the capability of this name: of a fleet's."""

    capability: str
    selector: Mapping[str, tuple[Pattern, ...]]

    def selects(self, labels: Mapping[str, str]) -> bool:
        """Whether it is a robot with these labels, `robot` and `fleet` among them."""
        return all(
            any(pattern.fullmatch(labels.get(label, "")) for pattern in patterns)
            for label, patterns in self.selector.items()
        )


@dataclass(frozen=True)
class Expression:
    """At least ``k`` of what follows; None: all of it.

    ``degraded`` is what each of these counts as where it is degraded: that, ``ok`` or ``lost``.
    """

    k: int | None
    of: tuple["Need", ...]
    degraded: Literal["degraded", "ok", "lost"] = "degraded"


Need = ComponentsOf | CheckOf | CapabilityOf | RobotsOf | Expression


def _need(value: Any, depth: int = 0) -> Need:
    """What one element of a list names."""
    if depth > _DEPTH:
        raise WrongValueError(
            f"lists are nested deeper than {_DEPTH} levels",
            "make a list within it a capability of its own",
        )
    if not isinstance(value, dict) or "regex" in value:
        return ComponentsOf((word(value),))
    if "component" in value:
        return _components(value)
    if "can" in value:
        return _robots(value)
    if len(value) != 1 or not value.keys() <= _MADE.keys():
        raise WrongValueError(f"{quoted(value)} is not one of {_FORMS}", "write {any: [...]}")
    (form,) = value
    made: Need = _below(form, lambda: _MADE[form](value[form], depth + 1))
    return made


def _below(key: str | int, make: Any) -> Any:
    """What ``make`` makes of the part of a value at ``key``."""
    try:
        return make()
    except WrongValueError as error:
        raise WrongValueError(error.what, error.remedy, (key, *error.below)) from None


def _components(value: dict[str, Any]) -> ComponentsOf:
    unknown = sorted(value.keys() - {"component", "key"})
    if unknown:
        what = f"has component and {unknown[0]}"
        raise WrongValueError(what, "write {component: Battery, key: Charge}")

    def patterns(key: str, one: Any) -> tuple[Pattern, ...]:
        items = value[key] if isinstance(value.get(key), list) else [value.get(key)]
        return tuple(_below(key, lambda each=each: one(each)) for each in items)

    found = patterns("component", word)
    if not found:
        raise WrongValueError("is an empty list", "remove it or fill it in", ("component",))
    return ComponentsOf(found, patterns("key", wildcard) if "key" in value else ())


def _robots(value: dict[str, Any]) -> RobotsOf:
    unknown = sorted(value.keys() - {"can", "robots"})
    labels = value.get("robots", {})
    if unknown or not isinstance(labels, dict):
        what = f"has can and {unknown[0]}" if unknown else f"{quoted(labels)} is no mapping"
        raise WrongValueError(what, "write {can: lifting, robots: {site: hall}}")

    def patterns(label: str) -> tuple[Pattern, ...]:
        items = labels[label] if isinstance(labels[label], list) else [labels[label]]
        if not items:
            raise WrongValueError("is an empty list", "remove it or fill it in", (label,))
        return tuple(_below(label, lambda each=each: wildcard(each)) for each in items)

    selector = {
        text(label): _below("robots", lambda each=label: patterns(each)) for label in labels
    }
    return RobotsOf(_below("can", lambda: text(value["can"])), MappingProxyType(selector))


def _needs(value: Any, depth: int = 0) -> tuple[Need, ...]:
    """The elements of a list, or the only one of it without a list."""
    items = value if isinstance(value, list) else [value]
    if not items:
        raise WrongValueError("is an empty list", "remove it or fill it in")
    if len(items) > MOST_PARTS:
        raise WrongValueError(f"has {len(items)} elements", f"use at most {MOST_PARTS}")
    if not isinstance(value, list):
        return (_need(value, depth),)
    return tuple(_below(at, lambda each=each: _need(each, depth)) for at, each in enumerate(items))


def _all(value: Any, depth: int = 0) -> Expression:
    return Expression(None, _needs(value, depth))


def _any(value: Any, depth: int = 0) -> Expression:
    return Expression(1, _needs(value, depth))


def _at_least(value: Any, depth: int = 0) -> Expression:
    if not isinstance(value, dict) or value.keys() != {"k", "of"}:
        raise WrongValueError(f"{quoted(value)} does not have k and of", "write {k: 2, of: [...]}")
    k = value["k"]
    if isinstance(k, bool) or not isinstance(k, int) or not 1 <= k <= MOST_PARTS:
        remedy = f"use a whole number from 1 to {MOST_PARTS}"
        raise WrongValueError(f"{quoted(k)} is not a number of parts", remedy, ("k",))
    of = _below("of", lambda: _needs(value["of"], depth))
    is_counted = not any(isinstance(each, ComponentsOf | RobotsOf) for each in of)
    if is_counted and k > len(of):
        remedy = f"use at most {len(of)}"
        raise WrongValueError(f"{k} is more than the {len(of)} of the list", remedy, ("k",))
    return Expression(k, of)


def _degraded_is(counts_as: Literal["ok", "lost"]) -> Any:
    return lambda value, depth=0: Expression(None, _needs(value, depth), counts_as)


def _named(kind: type[CheckOf | CapabilityOf]) -> Any:
    return lambda value, _depth=0: kind(text(value))


_MADE: Mapping[str, Any] = {
    "all": _all,
    "any": _any,
    "at_least": _at_least,
    "degraded_is_ok": _degraded_is("ok"),
    "degraded_is_lost": _degraded_is("lost"),
    "check": _named(CheckOf),
    "capability": _named(CapabilityOf),
}
_PART: dict[str, Any] = {
    "anyOf": [
        {"type": "string", "minLength": 1, "maxLength": MAX_PATTERN},
        {
            "type": "object",
            "properties": {
                each: {} for each in (*_MADE, "component", "key", "regex", "can", "robots")
            },
            "additionalProperties": False,
            "minProperties": 1,
        },
    ]
}
_LIST = {"type": "array", "minItems": 1, "maxItems": MOST_PARTS, "items": _PART}
_PARTS = {"anyOf": [*_PART["anyOf"], _LIST]}
_K = {"type": "integer", "minimum": 1, "maximum": MOST_PARTS}


_AllForm = Annotated[Expression | None, Value(_all, "parts", **_PARTS)]
_AnyForm = Annotated[Expression | None, Value(_any, "parts", **_PARTS)]
_AtLeastForm = Annotated[
    Expression | None,
    Value(
        _at_least,
        "`{k: number, of: parts}`",
        type="object",
        properties={"k": _K, "of": _PARTS},
        required=["k", "of"],
        additionalProperties=False,
    ),
]


class Capability(Entry):
    """Something that a robot can do; a list, or a word, is short for `all`."""

    name: str = ""
    need: Expression = Expression(None, ())
    all: _AllForm = described(
        "It needs all of these: components by words of their names, in upper or lower case, or any "
        "of the [other forms](capabilities.md#expressions).",
        example=["Motor", {"capability": "front view"}],
        default=None,
    )
    any: _AnyForm = described(
        "It needs one of these. In place of `all`.",
        example=["lidar front_upper", "lidar front_lower"],
        default=None,
    )
    at_least: _AtLeastForm = described(
        "It needs `k` of these. In place of `all`.",
        example={"k": 6, "of": ["lidar"]},
        default=None,
    )
    when: ConditionList = described(
        "The capability is needed only while this condition is true; otherwise it is OK. Of a "
        "list, all have to be true. While the condition is not known, no fault of the capability "
        "begins or ends.",
        example={"component": "Mode", "key": "mode", "equals": "auto"},
        default=(),
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "Capability":
        need = _only_form(self)
        for each in parts_of(need):
            if isinstance(each, RobotsOf):
                what = (
                    f"{{can: {each.capability}}} is about robots, and this capability belongs to "
                    "one"
                )
                raise WrongValueError(what, "put it into the fleet's capabilities")
        for at, condition in enumerate(self.when):
            if not condition.component:
                what = "is about the component itself, and a capability is no component"
                is_list = isinstance(given.get("when"), list)
                below = ("when", at) if is_list else ("when",)
                raise WrongValueError(what, "name the component: {component: Mode, ...}", below)
        return replace(self, need=need)


def _only_form(capability: "Capability | FleetCapability") -> Expression:
    forms = [each for each in ("all", "any", "at_least") if getattr(capability, each) is not None]
    if len(forms) != 1:
        what = f"has {' and '.join(forms) or 'none of all, any and at_least'}"
        raise WrongValueError(what, "give one of them, and put the others into it")
    need: Expression = getattr(capability, forms[0])
    return need


class FleetCapability(Entry):
    """Something that the fleet can do, while enough of its robots can."""

    name: str = ""
    need: Expression = Expression(None, ())
    all: _AllForm = described(
        "It needs all of these: robots that can do something, `{can: lifting, robots: {site: "
        "hall}}`, other capabilities of the fleet, or [expressions](capabilities.md#of-a-fleet).",
        example=[{"can": "lifting", "robots": {"site": "hall"}}],
        default=None,
    )
    any: _AnyForm = described(
        "It needs one of these. In place of `all`.",
        example=[{"can": "lifting"}],
        default=None,
    )
    at_least: _AtLeastForm = described(
        "It needs `k` of these. In place of `all`.",
        example={"k": 3, "of": [{"can": "lifting", "robots": {"site": "hall"}}]},
        default=None,
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "FleetCapability":
        need = _only_form(self)
        for each in parts_of(need):
            if isinstance(each, ComponentsOf | CheckOf):
                what = (
                    "names a component or a check of a robot, and this capability belongs to the "
                    "fleet"
                )
                raise WrongValueError(what, "name what its robots can do: {can: lifting}")
        return replace(self, need=need)


def short_capability(value: Any) -> Any:
    """A list of parts, or one part, is short for all of them."""
    return {"all": value} if isinstance(value, str | list) else value


# What is short for a capability, for its schema.
Parts = Annotated[Any, Value(_all, "parts", anyOf=[_PART["anyOf"][0], _LIST])]


def parts_of(need: Need) -> Iterator[Need]:
    """All that an expression has, itself first."""
    yield need
    for each in need.of if isinstance(need, Expression) else ():
        yield from parts_of(each)


def named_by(capability: Capability | FleetCapability) -> list[str]:
    """The other capabilities that one needs."""
    return [each.name for each in parts_of(capability.need) if isinstance(each, CapabilityOf)]


def in_order(capabilities: Mapping[str, Capability] | Mapping[str, FleetCapability]) -> list[str]:
    """Their names, each after those that it needs; there are no circles, see `wrong_names`."""
    ordered: dict[str, None] = {}

    def add(name: str) -> None:
        if name not in ordered:
            for each in named_by(capabilities[name]):
                add(each)
            ordered[name] = None

    for name in capabilities:
        add(name)
    return list(ordered)


def wrong_names(
    capabilities: Mapping[str, Capability] | Mapping[str, FleetCapability],
    checks: Iterable[str] = (),
    of_robots: Iterable[str] = (),
) -> Iterator[tuple[str, str, str]]:
    """(capability, what is wrong, remedy) of names that are not there, of circles, of too many.

    ``of_robots`` are what any profile's robots can do, for a fleet's.
    """
    if len(capabilities) > MOST:
        what = f"is one of {len(capabilities)}"
        yield next(iter(capabilities)), what, f"have at most {MOST} in a profile"
        return
    known = {
        CheckOf: ("check", list(checks)),
        CapabilityOf: ("capability", sorted(capabilities)),
        RobotsOf: ("capability of any profile", sorted(of_robots)),
    }
    for name, capability in capabilities.items():
        for each in parts_of(capability.need):
            if isinstance(each, CheckOf | CapabilityOf | RobotsOf):
                kind, names = known[type(each)]
                wanted = each.capability if isinstance(each, RobotsOf) else each.name
                if wanted not in names:
                    what = f"there is no {kind} {quoted(wanted)}"
                    yield name, what, suggestion(wanted, names)
        circle = _circle(name, capabilities)
        if circle:
            what = f"needs itself: {' -> '.join(map(quoted, circle))}"
            yield name, what, "remove one of them"


def _circle(
    name: str, capabilities: Mapping[str, Capability] | Mapping[str, FleetCapability]
) -> list[str]:
    """A way from a capability to itself; [] for none."""
    ways = [[name]]
    seen = set()
    while ways:
        way = ways.pop()
        for each in named_by(capabilities[way[-1]]):
            if each == name:
                return [*way, each]
            if each in capabilities and each not in seen:
                seen.add(each)
                ways.append([*way, each])
    return []
