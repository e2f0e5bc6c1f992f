"""fleet.yml as frozen value types: its keys, what they mean, and what the exporter reads of them.

The other packages read these types; they know neither YAML nor pydantic. A key is added here alone,
as a field that is `described`; what loads, checks and documents it follows from that.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import Enum
from functools import cached_property
from itertools import chain, pairwise
from math import ceil
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any, Literal
from zoneinfo import ZoneInfo

from pydantic import BeforeValidator, Field
from typing_extensions import override

from ros_diagnostics_exporter.config.capabilities import (
    Capability,
    FleetCapability,
    Parts,
    short_capability,
)
from ros_diagnostics_exporter.config.conditions import LEVELS, Conditional, ConditionList
from ros_diagnostics_exporter.config.errors import WrongValueError, quoted, suggestion
from ros_diagnostics_exporter.config.graph import Graph
from ros_diagnostics_exporter.config.keys import Entry, Written, described
from ros_diagnostics_exporter.config.metric_names import MetricName, Unit
from ros_diagnostics_exporter.config.patterns import (
    ROBOT,
    KeyTemplate,
    NameTemplate,
    Split,
    TopicTemplate,
    Wildcards,
    Words,
    topic_pattern,
)
from ros_diagnostics_exporter.config.promql import ComponentTemplate, Expression, ResultLabel
from ros_diagnostics_exporter.config.scalars import (
    Address,
    CanaryInterval,
    CapabilityName,
    DomainId,
    DomainIds,
    Duration,
    File,
    Folder,
    KeyPrefix,
    LabelName,
    LabelValue,
    Locator,
    Moment,
    Name,
    Namespace,
    PositiveDuration,
    QueryInterval,
    RecordedTime,
    TimeZone,
    Topic,
    WeeklyTime,
)
from ros_diagnostics_exporter.model import ZENOH, Domain, Feed
from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_exporter.weekly import Weekly

AGGREGATED = "_agg"  # the usual suffix of an aggregator's topic
RAW_NAME = "diagnostics"
DEFAULT = "default"  # the profile that applies where none is named
ALL = "all"  # the check that is always there
MESSAGE_TYPE = "diagnostic_msgs/msg/DiagnosticArray"

Count = Annotated[int, Field(ge=1, le=10_000_000)]
Share = Annotated[float, Field(ge=0, le=1)]
FlapRatio = Annotated[float, Field(ge=0.01, le=1)]
Labels = Annotated[Mapping[str, str], Written(dict[LabelName, LabelValue], MappingProxyType)]


def _as_it_is(value: Any) -> Any:
    return value


def _joined(weekly: list[Weekly]) -> Weekly:
    return tuple(chain.from_iterable(weekly))


WeeklyTimes = Annotated[Weekly, Written(list[WeeklyTime], _joined)]
UnixTime = Annotated[float, Written(Moment, _as_it_is)]  # of a time zone: `Maintenance.completed`


class Source(str, Enum):
    """Which of a robot's topics its components are read from."""

    AGG = "agg"
    RAW = "raw"
    BOTH = "both"  # the tree from the aggregate, changes of level from raw
    AUTO = "auto"  # the aggregate if there is one, else raw; decided once for a robot
    QUERIES = "queries"  # none: what has no ROS, such as a server


AnySource = Annotated[Source, Written(Literal["agg", "raw", "both", "auto"], Source)]
SourceOfOne = Annotated[Source, Written(Literal["agg", "raw", "both", "auto", "queries"], Source)]

_SOURCE = (
    "Where the components are read from: `agg`, the tree of the robot's "
    "diagnostic_aggregator; `raw`, what the drivers publish; `both`, the tree from the aggregate "
    "and changes from raw, because an aggregator hides what is shorter than its period; `auto`, "
    "the aggregate if there is one, else raw, decided once for a robot."
)
_LABELS = (
    "Labels of `robot_info`. The rules that are shipped put `site`, `robot_group`, `team`, `kind` "
    "and `uplink` on alerts, for routing; any other is for queries of your own. Reserved names are "
    "rejected."
)


class Limits(Entry):
    """Limits of what is held in memory and served; what is beyond is rejected and counted."""

    robots: Count = described("Robots.", example=500, default=2000)
    components: Count = described("Components of one robot.", example=200, default=500)
    values: Count = described("Key-values of one component.", example=50, default=200)
    label_length: Annotated[int, Field(ge=16, le=4096)] = described(
        "Characters of a label's value.", example=128, default=256
    )
    series: Count = described("Series of the whole exporter.", example=200_000, default=1_000_000)
    robot_series: Count = described(
        "Series of one robot's values (with their thresholds); also the limit of its key-values.",
        example=5000,
        default=20_000,
    )


# -- components and values ---------------------------------------------------------------------

# An entry has all the patterns of its key; `_one_each` makes of it rules that have one each.
OneOfWords = Annotated[Pattern, Written(Words, _as_it_is)]
OneOfWildcards = Annotated[Pattern, Written(Wildcards, _as_it_is)]
LevelWord = Literal["OK", "WARN", "ERROR", "STALE"]


def _one_each(entries: Any, *attributes: str) -> Any:
    for name in attributes:
        entries = [
            each if getattr(each, name) is None else replace(each, **{name: pattern})
            for each in entries
            for pattern in getattr(each, name) or (None,)
        ]
    return tuple(entries)


def _nothing() -> Mapping[Any, Any]:
    return MappingProxyType({})


class ComponentRule(Conditional, Entry, title="Component"):
    """Settings for some components; the first entry that matches applies."""

    pattern: OneOfWords = described(
        "Words, case ignored, one of which the component's name contains; or {regex: ...}.",
        example="Laser",
        key="match",
    )
    ignore: bool = described("Ignore these components.", example=True, default=False)
    stale_after: PositiveDuration | None = described(
        "Time without an update after which they are STALE, in place of the profile's.",
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
        Written(
            dict[LevelWord, LevelWord],
            lambda words: MappingProxyType({LEVELS[k]: LEVELS[v] for k, v in words.items()}),
        ),
    ] = described(
        "The level that counts in place of the published one.",
        example={"ERROR": "WARN"},
        default_factory=_nothing,
    )
    planned_stale: bool = described(
        "Their STALE is planned (a sensor that is switched off): no notification is sent.",
        example=True,
        default=False,
    )
    when: ConditionList = described(
        "Only where this condition holds, or all of a list, is their trouble a fault; while it is "
        "not known, no fault begins and none ends.",
        example={"component": "Mode", "key": "mode", "equals": "auto"},
        default=(),
    )
    unless: ConditionList = described(
        "Where this condition holds, or one of a list, their trouble is no fault.",
        example={"component": "Charger", "key": "State", "equals": "charging"},
        default=(),
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "ComponentRule":
        if self.ignore and self.conditions:
            what = "ignores these components and gives them conditions"
            raise WrongValueError(what, "remove ignore, or when and unless")
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
        "Words, case ignored, one of which the component's name contains. Without it, all.",
        example="Battery",
        default=None,
    )
    key: OneOfWildcards | None = described(
        "The key as the driver publishes it, `*` for anything; or {regex: ...}, matched "
        "against the whole key. A colon at the end may be omitted. Without `key`, all keys.",
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
        "Export the value as a metric of this name, in a base unit, in place of `component_value`; "
        "in addition to it if there are `thresholds`.",
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
        "Words, case ignored: a component belongs to the check if its group and name contain "
        'one of them. {regex: "..."} is searched in `group/component` as it is. Without it, all.',
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
        "The profile to start from. Checks and capabilities are added to its own (one of the same "
        "name replaces it, null removes it); its components and values are searched after this "
        "profile's own.",
        example="wheeled",
        default=DEFAULT,
    )
    stale_after: PositiveDuration = described(
        "Time without a message after which a robot is silent.", example="5s", default=10.0
    )
    confirm_after: Duration = described(
        "Time after which a problem is confirmed.", example="30s", default=10.0
    )
    forget_after: PositiveDuration = described(
        "Time without an update after which a component of a silent robot is forgotten if it was "
        "OK, and a discovered robot that never published.",
        example="24h",
        default=86_400.0,
    )
    flap_interval: PositiveDuration = described(
        "Time between two of the 21 states in which changes are counted for "
        "`component_flap_ratio`.",
        example="1m",
        default=15.0,
    )
    stale_is_critical: bool = described(
        "Whether STALE counts as CRITICAL; else it is a state of its own between WARNING and "
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
        "What the robot can do, and what it needs for it: a fault says what is lost, and what "
        "still works ([capabilities](capabilities.md)).",
        example={
            "driving": ["Motor", {"capability": "front view"}],
            "front view": {"any": ["Laser", "Camera"]},
        },
        default_factory=_nothing,
    )
    graph: Graph = described(
        "What is seen of the robot in the ROS graph, and of lost messages: silent faults.",
        example={"mode": "on", "expect": ["amcl"]},
        default=Graph(),
    )

    @cached_property
    def has_conditions(self) -> bool:
        """Whether `when` or `unless` of any component or value asks about levels or values."""
        return any(each.conditions for each in (*self.components, *self.values))


def _named_profile(name: str, profiles: Mapping[str, Profile] | None) -> Profile:
    """The profile of this name; the context of the validation has all of the file."""
    known = profiles or {}
    if name not in known:
        what = f"there is no profile {quoted(name)}"
        raise WrongValueError(what, suggestion(name, sorted(known)))
    return known[name]


ProfileName = Annotated[Profile, Written(Name, _named_profile, in_context=True)]


# -- robots ------------------------------------------------------------------------------------


class Robot(Entry):
    """A robot that is known by name, also before its first message and while it is silent."""

    name: Name = described(
        "The robot's name, unique in the fleet: its label `robot`.", example="r1"
    )
    domain_id: DomainId = described(
        "The ROS_DOMAIN_ID of the robot. 102 to 214 share ports with Linux' outgoing connections "
        "and cause a warning.",
        example=7,
        default=0,
    )
    namespace: Namespace = described(
        "The ROS namespace in which the robot publishes `diagnostics_agg` and `diagnostics`. "
        "Without `namespace` and `topic` the robot is the one in the root namespace of its domain.",
        example="/robot_1",
        default="",
        written="/",
    )
    topic_agg: str | None = None  # absolute name, of namespace or topic
    topic_raw: str | None = None
    source: SourceOfOne = described(
        f"{_SOURCE} And `queries` for what has no ROS, such as a server or a dock: it has the "
        "components of [queries](#query) alone, and is never silent.",
        example="raw",
        default=Source.AUTO,
    )
    profile: ProfileName = described(
        "The robot's profile.",
        example="turtlebot4",
        default_factory=Profile,
        written=DEFAULT,
    )
    address: Address | None = described(
        "Host name or IP address for checks of the host (ping, SSH, node_exporter).",
        example="10.0.0.17",
        default=None,
    )
    labels: Labels = described(_LABELS, example={"site": "hall"}, default_factory=_nothing)
    topic: Topic | None = described(
        "The topic in full, in place of `namespace`. With source `auto` or `both`, a name that "
        "ends in `_agg` is the aggregate's, any other is raw, and the other topic is named after "
        "it. If it is one of `shared`, this is one of the robots there.",
        example="/robot_1/health/diagnostics_agg",
        default=None,
    )
    zenoh: KeyPrefix | None = described(
        "In place of `domain_id`, for what comes by [zenoh](#zenoh): the beginning of its keys, "
        "which the topic follows; `/` where there is none. A bridge's `namespace` is one, and with "
        "rmw_zenoh the number of the ROS domain.",
        example="customer_a/robot_1",
        default=None,
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "Robot":
        if "namespace" in given and "topic" in given:
            raise WrongValueError("has both namespace and topic", "keep one of them")
        ros = sorted({"namespace", "topic", "domain_id", "zenoh"} & given.keys())
        if self.source is Source.QUERIES and ros:
            what = f"has source queries, so nothing of ROS, and {ros[0]}"
            raise WrongValueError(what, f"remove {ros[0]} or source")
        if self.zenoh is None:
            return self.reading(self.source)
        _not_both("domain_id", given)
        topic = self.topic and self.zenoh + self.topic
        namespace = self.zenoh + self.namespace
        behind = replace(self, domain_id=ZENOH, topic=topic, namespace=namespace)
        return behind.reading(self.source)

    def reading(self, source: Source) -> "Robot":
        """The robot with its topics as they are for a source."""
        topic = self.topic or f"{self.namespace}/{RAW_NAME}"
        if self.topic is None and source is Source.AGG:
            topic += AGGREGATED
        aggregate, raw = topics_of(topic, source)
        return replace(
            self,
            namespace=topic.rpartition("/")[0],
            topic_agg=aggregate,
            topic_raw=raw,
            source=source,
        )


class Discovery(Entry):
    """Robots that are found by their topics, as they come and go."""

    # fullmatch on the topic; group "robot" if `name` needs it
    pattern: re.Pattern[str] = topic_pattern("")
    template: TopicTemplate = described(
        "The topics to look for: `{robot}` stands for one part of the name and becomes the "
        "robot's name, `*` stands for one part of any name.",
        example="/{robot}/diagnostics_agg",
        default="",
        key="topic",
    )
    domain_ids: DomainIds = described(
        "The DDS domains to look in: numbers and ranges.",
        example=[0, "10-19"],
        default=(0,),
        written=[0],
    )
    type: Literal["diagnostic_msgs/msg/DiagnosticArray"] | None = described(
        "In place of `topic`: every topic of this message type is a robot's, whatever its "
        "name; the robot's name is the last part of its namespace (`/hall/r1/health` -> `r1`). "
        "With source `agg` only topics that end in `_agg`, with `raw` only the others.",
        example=MESSAGE_TYPE,
        default=None,
    )
    name: NameTemplate = described(
        "The robot's name, made of `{robot}` and `{domain_id}`; for robots in the root namespace "
        "of a domain of their own: `robot_{domain_id}`.",
        example="amr_{robot}",
        default=ROBOT,
    )
    include: Wildcards = described(
        "Only robots with these names; `*` stands for anything.", example=["amr_*"], default=()
    )
    exclude: Wildcards = described("No robots with these names.", example=["amr_test*"], default=())
    source: AnySource = described(_SOURCE, example="agg", default=Source.AUTO)
    profile: ProfileName = described(
        "The robot's profile.",
        example="turtlebot4",
        default_factory=Profile,
        written=DEFAULT,
    )
    address: NameTemplate | None = described(
        "The robot's host, made of `{robot}`, the robot's name, and `{domain_id}`.",
        example="{robot}.lan",
        default=None,
    )
    labels: Labels = described(_LABELS, example={"site": "hall"}, default_factory=_nothing)
    zenoh: KeyTemplate | None = described(
        "In place of `domain_ids`, for what comes by [zenoh](#zenoh): the beginning of their keys, "
        "which the topic follows; `/` where there is none. A bridge's `namespace` is one, and with "
        "rmw_zenoh the number of the ROS domain.",
        example="customer_a/{robot}",
        default=None,
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "Discovery":
        if bool(self.template) == bool(self.type):
            what = "has topic and type" if self.type else "has neither topic nor type"
            raise WrongValueError(what, 'give one, such as topic: "/{robot}/diagnostics_agg"')
        if self.zenoh is not None:
            _not_both("domain_ids", given)
            self = replace(self, domain_ids=(ZENOH,))  # noqa: PLW0642 - the rest is as for DDS
        shown = (self.zenoh or "") + (self.template or ROBOT)
        if shown.count(ROBOT) > 1:
            what = "zenoh has {robot}, as topic has, or type takes the robot's name from the topic"
            raise WrongValueError(what, "keep one and write * for the other")
        named = ROBOT in shown
        if not named and ROBOT in self.name:
            raise WrongValueError(
                "cannot distinguish robots: topic has no {robot}",
                'put {robot} into topic, or name: "robot_{domain_id}"',
            )
        if named and ROBOT not in self.name:
            raise WrongValueError("gives all robots of a domain one name", "put {robot} into name")
        template = (self.zenoh or "") + (self.template or str(self.type))
        return replace(self, pattern=self._topics(), template=template)

    def _topics(self) -> re.Pattern[str]:
        """The topics to look for. If any name will do, topics of the other source are excluded."""
        pattern = topic_pattern(self.template, self.zenoh or "")
        any_name = not self.template or self.template.endswith("/*")
        if not any_name or self.source not in (Source.AGG, Source.RAW):
            return pattern
        wanted = "(?<=" if self.source is Source.AGG else "(?<!"
        return re.compile(f"{pattern.pattern}{wanted}{AGGREGATED})")


class Shared(Entry):
    """Several robots on one topic; each status names its robot."""

    topic: Topic = described("The topic on which they all publish.", example="/diagnostics")
    raw: bool = True  # partial arrays (/diagnostics) or complete ones (/diagnostics_agg)
    domain_id: DomainId = described("Its DDS domain.", example=7, default=0)
    source: Literal["agg", "raw"] | None = described(
        "Whether arrays are complete (`agg`) or partial (`raw`). By default `agg` if the topic's "
        "name ends in `_agg`, else `raw`.",
        example="raw",
        default=None,
    )
    by: Literal["hardware_id", "name"] = described(
        "Where a status names its robot: in its `hardware_id` or in its `name`.",
        example="hardware_id",
        default="hardware_id",
    )
    pattern: Split | None = described(
        "How to find the robot's name there: text with `{robot}` and, for names, `{component}`; "
        'or {regex: "..."} with groups of these names, `(?P<robot>...)`. Statuses that do not '
        "match are counted as rejected. Needed with by: name; without it the whole hardware_id is "
        "the robot's name.",
        example="{robot}/{component}",
        default=None,
    )
    profile: ProfileName = described(
        "The profile of these robots.",
        example="arm",
        default_factory=Profile,
        written=DEFAULT,
    )
    labels: Labels = described(_LABELS, example={"site": "hall"}, default_factory=_nothing)
    zenoh: KeyPrefix | None = described(
        "In place of `domain_id`, for what comes by [zenoh](#zenoh): the beginning of its keys, "
        "which the topic follows; `/` where there is none. A bridge's `namespace` is one, and with "
        "rmw_zenoh the number of the ROS domain.",
        example="customer_a",
        default=None,
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "Shared":
        if self.by == "name" and self.pattern is None:
            raise WrongValueError(
                "has by: name and no pattern", 'add pattern: "{robot}/{component}"'
            )
        aggregated = self.source == "agg" if self.source else self.topic.endswith(AGGREGATED)
        if self.zenoh is None:
            return replace(self, raw=not aggregated)
        _not_both("domain_id", given)
        topic = self.zenoh + self.topic
        return replace(self, raw=not aggregated, domain_id=ZENOH, topic=topic)


class Zenoh(Entry):
    """How to reach the robots that are connected by zenoh (docs/beyond-the-lan.md)."""

    routers: Annotated[tuple[Locator, ...], Written(list[Locator], tuple)] = described(
        "The routers to connect to: `tcp/host:port`, `tls/`, `quic/`, `udp/` or `ws/`. With mode "
        "`client` the first that answers is used.",
        example=["tls/centre.example.org:7447"],
    )
    mode: Literal["client", "peer"] = described(
        "`client` for one router, `peer` to connect to all of `routers`, which may be bridges.",
        example="peer",
        default="client",
    )
    user: str | None = described(
        "The user at the router; needs `password_file`.", example="exporter", default=None
    )
    password_file: File | None = described(
        "A file with the user's password in one line.",
        example="/etc/ros-diagnostics/zenoh-password",
        default=None,
    )
    ca_file: File | None = described(
        "The certificates of the authorities that a router's certificate is checked with (`tls/`, "
        "`quic/`), in PEM.",
        example="/etc/ros-diagnostics/ca.pem",
        default=None,
    )
    cert_file: File | None = described(
        "The exporter's own certificate, where the router asks for one; needs `key_file`.",
        example="/etc/ros-diagnostics/exporter.pem",
        default=None,
    )
    key_file: File | None = described(
        "The key of `cert_file`.", example="/etc/ros-diagnostics/exporter.key", default=None
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "Zenoh":
        if not self.routers:
            raise WrongValueError("has no routers", "name one, such as routers: [tcp/centre:7447]")
        for one, other in (("user", "password_file"), ("cert_file", "key_file")):
            if (one in given) != (other in given):
                raise WrongValueError(f"has one of {one} and {other}", "give both or none")
        return self


def _not_both(domain: str, given: Mapping[str, Any]) -> None:
    if domain in given:
        raise WrongValueError(f"has both zenoh and {domain}", "keep one of them")


# -- queries -----------------------------------------------------------------------------------


class Query(Entry):
    """What Prometheus measures of robots: each element of an expression's result is a component."""

    expr: Expression = described(
        "The PromQL expression. It may not read this exporter's own families.",
        example="100 * node_filesystem_avail_bytes / node_filesystem_size_bytes",
    )
    component: ComponentTemplate = described(
        "The component's name; `{label}` stands for a label of the result. A robot's elements of "
        "one name are one component, which is as bad as the worst of them.",
        example="disk {mountpoint}",
    )
    group: Name = described("The group of the components.", example="Network", default="Host")
    robot: ResultLabel | None = described(
        "The label of the result that names the robot. By default `robot`, unless `address` is "
        "given.",
        example="vehicle",
        default=None,
    )
    address: ResultLabel | None = described(
        "In place of `robot`: the label that has the robot's `address`; a port behind it is "
        "ignored.",
        example="instance",
        default=None,
    )
    unit: Unit | None = described("The unit of the result.", example="%", default=None)
    thresholds: Annotated[tuple[Threshold, ...], Written(Thresholds, tuple)] = described(
        "The level of a component: WARN beyond `warning`, ERROR beyond `critical`. It ends beyond "
        "`value_hysteresis`. Without thresholds it is always OK.",
        example={"low": {"warning": 20, "critical": 10}},
        default=(),
    )
    interval: QueryInterval = described(
        "How often Prometheus is asked, 5s to 30s.", example="30s", default=15.0
    )
    stale_after: PositiveDuration = described(
        "Time without an element after which its component is STALE; at least twice `interval`.",
        example="2m",
        default=60.0,
    )
    confirm_after: Duration | None = described(
        "Time after which a problem is confirmed, in place of the profile's. An entry of the "
        "profile's `components` precedes it.",
        example="1m",
        default=None,
    )

    planned_stale: bool = described(
        "Their STALE is no fault: where another query says that the target does not answer.",
        example=True,
        default=False,
    )
    uplink: bool = described(
        "While one of them is ERROR, the robots that name its robot by the label `uplink` are "
        "unreachable: their silence, and what is measured of them, is no fault.",
        example=True,
        default=False,
    )

    @property
    def name(self) -> str:
        """Unique in the fleet: what logs, metrics and pages call it."""
        return f"{self.group}/{self.component}"

    @property
    def feed(self) -> Feed:
        """What it delivers."""
        return Feed(
            self.name,
            self.group,
            self.stale_after,
            self.confirm_after,
            self.planned_stale,
            self.uplink,
        )

    @override
    def completed(self, given: Mapping[str, Any]) -> "Query":
        if self.robot and self.address:
            raise WrongValueError("has both robot and address", "keep one of them")
        if self.stale_after < 2 * self.interval:
            what = f"stale_after ({self.stale_after:g}s) is below twice interval"
            raise WrongValueError(
                what, f"use {2 * self.interval:g}s or more, or a shorter interval"
            )
        return self if self.address else replace(self, robot=self.robot or "robot")


# -- faults ------------------------------------------------------------------------------------


class CauseSettings(Entry):
    """From how many on several problems are one: ``number`` and ``share``, or ``absolute``."""

    number: int
    share: float
    absolute: int | None = None

    def needed(self, total: int) -> int:
        """How many of ``total`` have to be in trouble."""
        # The tolerance keeps 0.1 of 30 at 3, whatever floating point makes of it.
        needed = max(1, self.number, ceil(self.share * total - 1e-9))
        return needed if self.absolute is None else min(needed, max(1, self.absolute))

    @override
    def completed(self, given: Mapping[str, Any]) -> "CauseSettings":
        absolute = self.absolute
        if absolute is not None and "absolute" not in given:
            absolute = max(absolute, self.number)  # a number that is written down counts
        return CauseSettings(self.number, self.share, absolute)


class Many(CauseSettings):
    """When components of one robot that fail at once are one fault."""

    number: Count = described(
        "At least so many of its components.", example=10, default=8, key="components"
    )
    share: Share = described(
        "At least this share of all that it has, too.", example=0.3, default=0.5
    )
    absolute: Count | None = described(
        "Or so many components, however many it has.", example=40, default=20
    )


class Site(CauseSettings):
    """When robots of one site that fall silent at once are one fault."""

    number: Count = described("At least so many of its robots.", example=3, default=5, key="robots")
    share: Share = described("At least this share of them, too.", example=0.3, default=0.5)
    absolute: Count | None = described(
        "Or so many robots, however large the site is.", example=50, default=20
    )


class Common(CauseSettings):
    """When one component that is CRITICAL on many robots is one fault."""

    number: Count = described("At least so many robots.", example=3, default=5, key="robots")
    share: Share = described("At least this share of the fleet, too.", example=0.2, default=0.25)
    absolute: Count | None = described(
        "Or so many robots, however large the fleet is.", example=50, default=20
    )


class WarningHours(Entry):
    """The hours of the week in which faults of severity warning begin."""

    weekly: Annotated[
        Weekly, Written(Annotated[list[WeeklyTime], Field(min_length=1)], _joined)
    ] = described(
        "Times of each week, in `time_zone`, also across midnight.",
        example=["Mon-Fri 06:00-18:00"],
    )
    time_zone: TimeZone = described(
        "The IANA time zone of the times.", example="Europe/Berlin", default="UTC"
    )


class Flapping(Entry):
    """When something changes too often: Nagios' ratio of changes between its last 21 states."""

    start: FlapRatio = described("From this ratio on it is flapping.", example=0.5, default=0.4)
    stop: FlapRatio = described("Below this ratio it no longer is.", example=0.25, default=0.2)

    @override
    def completed(self, given: Mapping[str, Any]) -> "Flapping":
        if self.stop >= self.start:
            what = f"stop ({self.stop:g}) is not below start ({self.start:g})"
            raise WrongValueError(what, "use a stop below start, such as start: 0.4, stop: 0.2")
        return self


class Intermittent(Entry):
    """When faults too short to be confirmed are too many to be chance."""

    changes: Annotated[Count, Field(ge=2, le=20)] = described(
        "From so many changes of a component's level on; two are one short fault.",
        example=6,
        default=4,
    )
    within: Duration = described("In this time.", example="1h", default=600.0)


class Falling(Entry):
    """When a value that falls will soon be below its critical threshold."""

    over: Duration = described(
        "How fast it falls is computed from so long.", example="5m", default=900.0
    )
    ahead: Duration = described("How soon it would be too low.", example="1h", default=1800.0)


class CapsuleSettings(Entry, title="Capsules"):
    """What a capsule has of the messages around the begin of its fault (docs/time-machine.md)."""

    before: RecordedTime = described(
        "Time before the begin, at most 10m. Memory grows with it.", example="2m", default=60.0
    )
    after: RecordedTime = described(
        "Time after the begin, at most 10m; that long a capsule is not there yet.",
        example="30s",
        default=10.0,
    )


class FaultSettings(Entry, title="Faults"):
    """How the exporter decides which problems are faults, for the whole fleet."""

    restart_grace: Duration = described(
        "Time after a start of the exporter in which no fault begins for want of data.",
        example="1m",
        default=30.0,
    )
    pending_after: Duration = described(
        "Time after which a declared robot that was never received is a fault.",
        example="1h",
        default=900.0,
    )
    confirm_after: Duration = described(
        "Time after which a fault of a site, or one that is common to many robots, is confirmed; "
        "for robots and components see the profile.",
        example="30s",
        default=10.0,
    )
    flapping: Flapping = described(
        "When components, and robots that come and go, are flapping.",
        example={"start": 0.5},
        default=Flapping(),
    )
    intermittent: Intermittent = described(
        "When a component whose faults end before they are confirmed has an intermittent one.",
        example={"changes": 6},
        default=Intermittent(),
    )
    falling: Falling = described(
        "When a value with a critical low threshold falls too fast.",
        example={"ahead": "1h"},
        default=Falling(),
    )
    value_hysteresis: Share = described(
        "Share of a threshold by which a value has to come back before its fault ends.",
        example=0.05,
        default=0.02,
    )
    many: Annotated[CauseSettings, Written(Many, _as_it_is)] = described(
        "When components of one robot that fail at once are one fault.",
        example={"components": 5},
        default=Many().completed({}),
    )
    site: Annotated[CauseSettings, Written(Site, _as_it_is)] = described(
        "When robots of one site (their label `site`) that fall silent at once are one fault.",
        example={"robots": 3, "share": 0.3},
        default=Site().completed({}),
    )
    common: Annotated[CauseSettings, Written(Common, _as_it_is)] = described(
        "When one component that is CRITICAL on many robots is one fault.",
        example={"robots": 10, "absolute": 50},
        default=Common().completed({}),
    )
    warning_hours: WarningHours | None = described(
        "The hours of the week in which faults of severity warning begin. By default all.",
        example={"weekly": ["Mon-Fri 06:00-18:00"], "time_zone": "Europe/Berlin"},
        default=None,
    )


# -- the file ----------------------------------------------------------------------------------


class Maintenance(Entry):
    """A planned downtime: which robots, when and why."""

    name: Name = described("A name for people.", example="hall 2 charges")
    selector: Annotated[
        Mapping[str, Wildcards], Written(dict[str, Wildcards], MappingProxyType)
    ] = described(
        "The robots: each of these labels (`robot`, `fleet` and those of `labels`) must match one "
        'of its texts, `*` stands for anything; or {regex: "..."}.',
        example={"site": "hall_2", "robot": ["amr_*", "arm_1"]},
    )
    comment: str = described("The reason.", example="batteries, ticket 12")
    start: UnixTime | None = described(
        "When it begins (ISO 8601; without an offset, in `time_zone`).",
        example="2026-03-28T22:00",
        default=None,
    )
    end: UnixTime | None = described(
        "When it ends.", example="2026-03-29T06:00:00+02:00", default=None
    )
    weekly: WeeklyTimes = described(
        "Times of each week, in `time_zone`, also across midnight; only between `start` and `end` "
        "if these are given.",
        example=["Mon-Fri 22:00-06:00", "Sun 00:00-24:00"],
        default=(),
    )
    time_zone: TimeZone = described(
        "The IANA time zone of the times.", example="Europe/Berlin", default="UTC"
    )

    @override
    def completed(self, given: Mapping[str, Any]) -> "Maintenance":
        if not self.selector:
            raise WrongValueError(
                "selects nothing", 'name a label, such as selector: {robot: "*"} for all'
            )
        if self.start is None and self.end is None and not self.weekly:
            raise WrongValueError("has no time", "add start, end or weekly")
        start, end = self._unix(self.start), self._unix(self.end)
        if start is not None and end is not None and end <= start:
            raise WrongValueError("is not after start", "put end after start", ("end",))
        return replace(self, start=start, end=end)

    def _unix(self, moment: Any) -> float | None:
        """Unix time of what the file has, without an offset in the downtime's time zone."""
        if moment is None:
            return None
        aware = moment if moment.tzinfo else moment.replace(tzinfo=ZoneInfo(self.time_zone))
        unix: float = aware.timestamp()
        return unix


class Fleet(Entry, title="FleetFile"):
    """The file fleet.yml."""

    name: Name = described(
        "The fleet's name: the label `fleet` of every series.", example="plant1", key="fleet"
    )
    robots: Annotated[tuple[Robot, ...], Written(list[Robot], tuple)] = described(
        "Robots known by name.",
        example=[{"name": "robot_1", "namespace": "/robot_1"}],
        default=(),
    )
    discoveries: Annotated[tuple[Discovery, ...], Written(list[Discovery], tuple)] = described(
        "Robots found by their topics.",
        example=[{"topic": "/{robot}/diagnostics_agg"}],
        default=(),
        key="discovery",
    )
    shared: Annotated[tuple[Shared, ...], Written(list[Shared], tuple)] = described(
        "Topics on which several robots publish.",
        example=[{"topic": "/diagnostics", "by": "hardware_id"}],
        default=(),
    )
    profiles: Annotated[
        Mapping[str, Profile], Written(dict[Name, Profile | None], MappingProxyType)
    ] = described(
        "Settings for kinds of robots. `default` applies where no profile is named, and is "
        "extended by profiles without `extends`.",
        example={"default": {"stale_after": "5s"}},
        default_factory=_nothing,
    )
    robots_folder: Folder = described(
        "A folder, beside this file, of more robots: each `*.yml` in it has one robot or a list. "
        "Add a file to add a robot.",
        example="fleet/robots",
        default="robots.d",
    )
    maintenance: Annotated[tuple[Maintenance, ...], Written(list[Maintenance], tuple)] = described(
        "Planned downtimes.",
        example=[
            {
                "name": "charging",
                "selector": {"robot": "*"},
                "comment": "every night",
                "weekly": ["daily 22:00-23:00"],
            }
        ],
        default=(),
    )
    maintenance_folder: Folder = described(
        "A folder, beside this file, of more planned downtimes: each `*.yml` in it has one or a "
        "list.",
        example="fleet/maintenance",
        default="maintenance.d",
    )
    capabilities: Annotated[
        Mapping[str, FleetCapability],
        Written(
            dict[CapabilityName, FleetCapability],
            lambda found: MappingProxyType(
                {name: replace(each, name=name) for name, each in found.items()}
            ),
        ),
    ] = described(
        "What the fleet can do while enough of its robots can: a fault says so before too few "
        "can ([capabilities](capabilities.md#of-a-fleet)).",
        example={
            "lifting in hall 2": {
                "at_least": {"k": 3, "of": {"can": "lifting", "robots": {"site": "hall_2"}}}
            }
        },
        default_factory=_nothing,
    )
    queries: Annotated[tuple[Query, ...], Written(list[Query], tuple)] = described(
        "What Prometheus measures of the robots (`--prometheus.url`), as components of them.",
        example=[
            {
                "expr": "node_load1",
                "component": "load",
                "address": "instance",
                "thresholds": {"high": {"warning": 5}},
            }
        ],
        default=(),
    )
    queries_folder: Folder = described(
        "A folder, beside this file, of more queries: each `*.yml` in it has one or a list.",
        example="fleet/queries",
        default="queries.d",
    )
    zenoh: Zenoh | None = described(
        "How to reach the robots that are connected by zenoh.",
        example={"routers": ["tls/centre.example.org:7447"]},
        default=None,
    )
    limits: Limits = described("Limits.", example={"components": 200}, default=Limits())
    faults: FaultSettings = described(
        "How the exporter decides which problems are faults.",
        example={"pending_after": "1h"},
        default=FaultSettings(),
    )
    capsules: CapsuleSettings = described(
        "How much of what was received around the begin of a fault is kept.",
        example={"before": "2m"},
        default=CapsuleSettings(),
    )
    exporter: LabelValue = described(
        "This exporter's name where several share the fleet: the label `exporter` of its faults, "
        "robots and own metrics. Two that receive the same robots have the same name.",
        example="berlin",
        default="",
    )
    stale_is_critical: bool = described(
        "Whether STALE counts as CRITICAL, in all profiles that do not set it.",
        example=True,
        default=False,
    )
    canary: CanaryInterval | None = described(
        "How often a canary measures the time of a notification (docs/notifications.md), at least "
        "1m. By default never.",
        example="5m",
        default=None,
    )
    warnings: tuple[str, ...] = field(default=(), compare=False)  # allowed, but probably mistakes
    sources: tuple[Path, ...] = field(default=(), compare=False)  # see `load.sources`

    @property
    def longest_confirm_after(self) -> float:
        """The longest time, in seconds, after which anything that is wrong is a fault."""
        profiles = [each.profile for each in self.robots]
        profiles += [each.profile for each in self.discoveries]
        profiles += [each.profile for each in self.shared]
        found = [self.faults.confirm_after]
        for profile in profiles:
            found.append(profile.confirm_after)
            found += (rule.confirm_after or 0.0 for rule in profile.components)
        return max(found)

    @property
    def domain_ids(self) -> tuple[Domain, ...]:
        """Every domain to join: those of DDS, ascending, then zenoh."""
        found = {each.domain_id for each in self.robots if each.source is not Source.QUERIES}
        found.update(each.domain_id for each in self.shared)
        found.update(domain for each in self.discoveries for domain in each.domain_ids)
        return (*sorted(each for each in found if isinstance(each, int)), *(found & {ZENOH}))


def topics_of(topic: str, source: Source) -> tuple[str | None, str | None]:
    """The aggregated and the raw topic of a robot of which one is known.

    With source agg or raw the topic has that kind, whatever its name. Else the name shows which of
    the two it is, and the other is named after it.
    """
    if source is Source.QUERIES:
        return None, None
    if source is Source.AGG:
        return topic, None
    if source is Source.RAW:
        return None, topic
    raw = topic.removesuffix(AGGREGATED)
    return raw + AGGREGATED, raw
