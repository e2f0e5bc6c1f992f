"""What a profile says of a kind of robot: its components, values, checks and times."""

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from types import MappingProxyType
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field
from typing_extensions import override

from ros_diagnostics_exporter.config.capabilities import Capability, Parts, short_capability
from ros_diagnostics_exporter.config.conditions import (
    LEVEL_NAMES,
    Conditional,
    ConditionList,
    LevelWord,
    level,
)
from ros_diagnostics_exporter.config.errors import WrongValueError, quoted, suggestion
from ros_diagnostics_exporter.config.graph import Graph
from ros_diagnostics_exporter.config.keys import Entry, Value, Written, described, nothing
from ros_diagnostics_exporter.config.links import Links
from ros_diagnostics_exporter.config.metric_names import MetricName, Unit
from ros_diagnostics_exporter.config.missions import ActionRules, Modes
from ros_diagnostics_exporter.config.patterns import Wildcards, Words
from ros_diagnostics_exporter.config.scalars import CapabilityName, Duration, Name, PositiveDuration
from ros_diagnostics_exporter.config.topics import TopicEntry
from ros_diagnostics_exporter.regex import Pattern

DEFAULT = "default"  # the profile that applies where none is named
ALL = "all"  # the check that is always there

# An entry has all the patterns of its key; `_one_each` makes of it rules that have one each.
OneOfWords = Annotated[Pattern, Written(Words)]
OneOfWildcards = Annotated[Pattern, Written(Wildcards)]


def _published_level(value: Any) -> int:
    """The level of a name, or any number: drivers and aggregators have numbers of their own."""
    is_byte = isinstance(value, str) and re.fullmatch("[0-9]{1,3}", value) and int(value) <= 255
    return int(value) if is_byte else level(value, " or a number to 255")


PublishedLevel = Annotated[
    int,
    Value(_published_level, "level", type="string", pattern=f"^({LEVEL_NAMES}|[0-9]{{1,3}})$"),
]


def _one_each(entries: Any, *attributes: str) -> Any:
    for name in attributes:
        entries = [
            each if getattr(each, name) is None else replace(each, **{name: pattern})
            for each in entries
            for pattern in getattr(each, name) or (None,)
        ]
    return tuple(entries)


class ComponentRule(Conditional, Entry, title="Component"):
    """Settings for some components; the first entry that matches applies."""

    pattern: OneOfWords = described(
        "The component's name contains one of these words, in upper or lower case; or {regex: "
        "...}.",
        example="Laser",
        key="match",
    )
    ignore: bool = described("Ignore these components.", example=True, default=False)
    stale_after: PositiveDuration | None = described(
        "They are STALE after this time without an update. By default it is the robot's. For a "
        "component that its driver publishes itself, it is three times the longest of its last ten "
        "gaps, at least 5s; while these are not known, 90s. An aggregator makes its components "
        "STALE itself, after its own timeout. What a query measures has the time of its query.",
        example="90s",
        default=None,
    )
    confirm_after: Duration | None = described(
        "Time after which a problem is confirmed, in place of the profile's.",
        example="1m",
        default=None,
    )
    levels: Annotated[
        Mapping[int, int],
        Written(dict[PublishedLevel, LevelWord], MappingProxyType),
    ] = described(
        "The level that counts in place of the published one. A published level may be a number "
        "that ROS does not know; without an entry it counts as ERROR.",
        example={"ERROR": "WARN", "255": "OK"},
        default_factory=nothing,
    )
    reports: Literal["always", "on_change"] = described(
        "`on_change`: they are published only when something changes, as rosserial does. They are "
        "not STALE for lack of an update while their robot is received, and keep the level that "
        "was published last. If an aggregator's array no longer has them, for example after a "
        "reboot of the robot, they are STALE until they are published again. So let their drivers "
        "publish them when they start.",
        example="on_change",
        default="always",
    )
    ends_after: PositiveDuration | None = described(
        "With `reports: on_change`: a problem that is not published again is over after this time. "
        "The time runs only while the robot's diagnostics are received, and not in the first "
        "minute after they are received again. If you leave it out, a problem lasts until they "
        "are published as OK, or until a person removes them.",
        example="10m",
        default=None,
    )
    planned_stale: bool = described(
        "Their STALE is planned (a sensor that is switched off): no notification is sent.",
        example=True,
        default=False,
    )
    depends_on: Words = described(
        "They depend on the robot's component whose name contains one of these words, in upper or "
        "lower case. While that component is ERROR or flaps, their problems do not become faults. "
        "While it is STALE, this holds if they are STALE, too "
        "([depends_on](queries.md#depends_on)).",
        example="Power",
        default=(),
    )
    when: ConditionList = described(
        "Their problems are faults only while this condition is true. Of a list, all have to be "
        "true ([if it is not known](configuration.md#condition)).",
        example={"component": "Mode", "key": "mode", "equals": "auto"},
        default=(),
    )
    unless: ConditionList = described(
        "Their problems are no faults while this condition is true. Of a list, one is enough.",
        example={"component": "Charger", "key": "State", "equals": "charging"},
        default=(),
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "ComponentRule":
        if self.ignore and self.conditions:
            what = "ignores these components and gives them conditions"
            raise WrongValueError(what, "remove ignore, or when and unless")
        if self.ends_after is not None and self.reports != "on_change":
            what = "has ends_after, and reports always"
            raise WrongValueError(what, "add reports: on_change, or remove ends_after")
        if self.stale_after is not None and self.reports == "on_change":
            what = "has stale_after, and reports on_change"
            raise WrongValueError(what, "remove one of them; ends_after ends what is not repeated")
        return self


@dataclass(frozen=True)
class Threshold:
    """A threshold for a value, exported as component_value_threshold."""

    bound: str  # "low" or "high"
    severity: str  # "warning" or "critical"
    value: float

    def is_beyond(self, number: float, margin: float = 0.0) -> bool:
        """Whether a number is beyond it, or not back by ``margin``, a share of the threshold."""
        back = abs(self.value) * margin
        if self.bound == "low":
            return number < self.value + back
        return number > self.value - back


class Bound(Entry):
    """Thresholds for a value, in the unit in which it is exported."""

    warning: float | None = described(
        "Beyond it the value is a WARNING.", example=11.5, default=None
    )
    critical: float | None = described(
        "Beyond it the value is CRITICAL.", example=10.8, default=None
    )


class Thresholds(Entry):
    """Thresholds for a value, exported as `component_value_threshold`."""

    low: Bound = described(
        "The value should not be below.", example={"critical": 10.8}, default=Bound()
    )
    high: Bound = described(
        "The value should not be above.", example={"warning": 80}, default=Bound()
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> tuple[Threshold, ...]:
        in_order = [
            Threshold(bound, severity, number)
            for bound, severity in (
                *(("low", "critical"), ("low", "warning")),
                *(("high", "warning"), ("high", "critical")),
            )
            if (number := getattr(getattr(self, bound), severity)) is not None
        ]
        for below, above in pairwise(in_order):
            if below.value > above.value:
                raise WrongValueError(
                    f"{below.bound} {below.severity} ({below.value:g}) is above "
                    f"{above.bound} {above.severity} ({above.value:g})",
                    "order them: low critical, low warning, high warning, high critical",
                )
        return tuple(
            sorted(in_order, key=lambda each: (each.bound == "high", each.severity != "warning"))
        )


def _numbers(enum: dict[str, float]) -> Mapping[str, float]:
    numbers = {word.strip().lower(): number for word, number in enum.items()}
    if not enum or len(numbers) < len(enum):
        what = "enum names a word twice, as case is ignored" if numbers else "enum is empty"
        raise WrongValueError(what, "give each word one number, or remove enum")
    return MappingProxyType(numbers)


class ValueRule(Conditional, Entry, title="Value"):
    """How some key-values are read; the first entry that matches applies."""

    component: OneOfWords | None = described(
        "The component's name contains one of these words, in upper or lower case. Without it, "
        "all.",
        example="Battery",
        default=None,
    )
    key: OneOfWildcards | None = described(
        "The key as the driver publishes it; `*` stands for anything. Or {regex: ...}, matched "
        "against the whole key. You may omit a colon at its end. Without `key`, all keys.",
        example="Voltage (V)",
        default=None,
    )
    keep: bool = described("false drops the value.", example=False, default=True)
    unit: Unit | None = described(
        "The unit, in place of the one found in the key or the value.", example="V", default=None
    )
    enum: Annotated[Mapping[str, float], Written(dict[str, float], _numbers)] | None = described(
        "Numbers for words, case ignored.",
        example={"None": 0, "Adapter": 1, "Dock": 2},
        default=None,
    )
    scale: float = described(
        "Factor from the value to what is exported.", example=0.01, default=1.0
    )
    offset: float = described("Added after `scale`.", example=-273.15, default=0.0)
    metric: MetricName | None = described(
        "Export the value as a metric of this name, in a base unit, in place of `component_value`. "
        "If it has `thresholds`, it is exported as both.",
        example="ros_battery_voltage_volts",
        default=None,
    )
    thresholds: Annotated[tuple[Threshold, ...], Written(Thresholds, tuple)] = described(
        "Thresholds for the exported value.",
        example={"low": {"warning": 11.5, "critical": 10.8}},
        default=(),
    )
    when: ConditionList = described(
        "As in a [component](#component), for the faults of the thresholds.",
        example={"component": "Dock", "key": "Docked", "equals": True},
        default=(),
    )
    unless: ConditionList = described(
        "As in a component, for the faults of the thresholds.",
        example={"key": "Charging state", "equals": "charging"},
        default=(),
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "ValueRule":
        others = given.keys() - {"key", "component", "keep"}
        if not self.keep and others:
            what = f"drops the value (keep: false) and also sets {', '.join(sorted(others))}"
            raise WrongValueError(what, "remove keep, or the other keys")
        if self.conditions and "thresholds" not in given:
            what = "has conditions and no thresholds, so there is no fault that they could prevent"
            raise WrongValueError(what, "add thresholds, or move them to an entry of components")
        if self.scale == 0:
            raise WrongValueError(
                "scale is 0, which makes every value the same", "use another factor"
            )
        return self


# -- profiles ----------------------------------------------------------------------------------


class Check(Entry):
    """A named set of components; a list of words is short for `match`."""

    name: str = ""
    patterns: Words = described(
        "A component belongs to the check if its group and name contain one of these words, in "
        'upper or lower case. {regex: "..."} is searched in `group/component`, case as written. '
        "Without it, all.",
        example=["Motor"],
        default=(),
        key="match",
    )
    expect: Annotated[int, Field(ge=0, le=100_000)] | None = described(
        "How many components the check should find; fewer are CRITICAL.", example=3, default=None
    )


def _short_check(value: Any) -> Any:
    return {"match": value} if isinstance(value, str | list) else value


class Profile(Entry):
    """Settings for a kind of robot. What is not given comes from the profile that is extended."""

    name: str = DEFAULT
    extends: Name = described(
        "The profile to start from ([what is added, what replaced](configuration.md#profile)).",
        example="wheeled",
        default=DEFAULT,
    )
    stale_after: PositiveDuration = described(
        "Time without a message after which a robot is silent.", example="5s", default=10.0
    )
    confirm_after: Duration = described(
        "Time after which a problem is confirmed.", example="30s", default=10.0
    )
    boot_grace: Duration = described(
        "A problem that is there from the first message after a silence is suppressed for this "
        "time, because many drivers report ERROR until they are up. A component that was OK first "
        "and then fails is not suppressed.",
        example="1m",
        default=0.0,
    )
    forget_after: PositiveDuration = described(
        "A component that was OK is forgotten after this time without an update, if its robot is "
        "silent or its STALE is planned. So is a discovered robot that never published.",
        example="24h",
        default=86_400.0,
    )
    flap_interval: PositiveDuration = described(
        "For `component_flap_ratio`, changes are counted between 21 states. This is the time "
        "between two of these states.",
        example="1m",
        default=15.0,
    )
    stale_is_critical: bool = described(
        "Whether STALE counts as CRITICAL. If not, it is a state of its own between WARNING and "
        "CRITICAL. By default the fleet's `stale_is_critical`.",
        example=True,
        default=False,
        written=None,
    )
    checks: Annotated[
        tuple[Check, ...],
        Written(
            dict[
                Name,
                Annotated[
                    Check, BeforeValidator(_short_check, json_schema_input_type=Words | Check)
                ]
                | None,
            ],
            lambda checks: tuple(
                replace(each, name=name) for name, each in checks.items() if each is not None
            ),
        ),
    ] = described(
        "Named sets of components. The check `all` always exists and has no words.",
        example={"motors": ["Motor"], "lasers": {"match": ["Laser"], "expect": 2}},
        default=(Check(ALL),),
    )
    components: Annotated[
        tuple[ComponentRule, ...],
        Written(list[ComponentRule], lambda entries: _one_each(entries, "pattern")),
    ] = described(
        "Settings for some components; the first entry that matches applies.",
        example=[{"match": "Laser", "stale_after": "90s"}],
        default=(),
    )
    values: Annotated[
        tuple[ValueRule, ...],
        Written(list[ValueRule], lambda entries: _one_each(entries, "component", "key")),
    ] = described(
        "How key-values are read; the first entry that matches applies.",
        example=[{"key": "PID", "keep": False}],
        default=(),
    )
    topics: Annotated[tuple[TopicEntry, ...], Written(list[TopicEntry], tuple)] = described(
        "Small topics, of which you make components "
        "([robots without diagnostics](robots-without-diagnostics.md)).",
        example=[{"topic": "e_stop", "component": "E-stop", "field": "data", "error_when": True}],
        default=(),
    )
    capabilities: Annotated[
        Mapping[str, Capability],
        Written(
            dict[
                CapabilityName,
                Annotated[
                    Capability,
                    BeforeValidator(short_capability, json_schema_input_type=Parts | Capability),
                ]
                | None,
            ],
            lambda found: MappingProxyType(
                {name: replace(each, name=name) for name, each in found.items() if each}
            ),
        ),
    ] = described(
        "Jobs that the robot can do, each with the components that it needs. A fault then says "
        "which job is lost, and which still works ([capabilities](capabilities.md)).",
        example={
            "driving": ["Motor", {"capability": "front view"}],
            "front view": {"any": ["Laser", "Camera"]},
        },
        default_factory=nothing,
    )
    graph: Graph = described(
        "How the robot's nodes and topics in the ROS graph, and its lost messages, are judged "
        "([silent faults](silent-faults.md)).",
        example={"mode": "on", "expect": ["amcl"]},
        default=Graph(),
    )
    actions: ActionRules = described(
        "Which of the robot's actions are its work, and which of their goals are faults; the first "
        "entry that matches applies ([missions](missions.md)).",
        example=[{"match": "navigate_to_pose", "aborted": {"critical": 3}}],
        default=(),
    )
    links: Links = described(
        "Links to more about the robot, by name. `{robot}` stands for its name, and `{address}` "
        "for its `address`. A robot without `address` has no links that need it.",
        example={"manual": "https://wiki.example.org/amr", "camera": "http://{address}:8080/"},
        default_factory=nothing,
    )
    modes: Modes | None = described(
        "Where the robot says whether it works by itself ([interventions]"
        "(missions.md#interventions)).",
        example={"component": "Mode", "key": "mode", "autonomous": "auto"},
        default=None,
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "Profile":
        counted = Counter(each.component for each in self.topics)
        for at, each in enumerate(self.topics):
            if counted[each.component] > 1:
                what = f"another entry makes the component {quoted(each.component)}, too"
                raise WrongValueError(what, "name each component once", ("topics", at, "component"))
        if self.topics and self.graph.mode == "off":
            what = "is off, and topics are found in the ROS graph, so none would be read"
            raise WrongValueError(what, "write mode: shadow", ("graph", "mode"))
        return self

    @cached_property
    def has_conditions(self) -> bool:
        """Whether `modes`, or `when` or `unless` of any entry, asks about levels or values."""
        return (
            self.modes is not None
            or any(each.conditions for each in (*self.components, *self.values))
            or any(each.when for each in self.capabilities.values())
        )


def _named_profile(name: str, profiles: Mapping[str, Profile] | None) -> Profile:
    """The profile of this name; the context of the validation has all of the file."""
    known = profiles or {}
    if name not in known:
        what = f"there is no profile {quoted(name)}"
        raise WrongValueError(what, suggestion(name, sorted(known)))
    return known[name]


ProfileName = Annotated[Profile, Written(Name, _named_profile, in_context=True)]
