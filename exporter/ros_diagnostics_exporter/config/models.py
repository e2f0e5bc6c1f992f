"""The shape of fleet.yml as pydantic models: the keys, their types and what they mean.

The descriptions are the documentation: docs/configuration.md and the JSON Schema are generated
from them.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.fleet import FaultSettings
from ros_diagnostics_exporter.config.metric_names import MetricName, Unit
from ros_diagnostics_exporter.config.patterns import (
    Equals,
    NameTemplate,
    Split,
    TopicTemplate,
    Wildcards,
    Words,
)
from ros_diagnostics_exporter.config.scalars import (
    Address,
    CanaryInterval,
    DomainId,
    DomainIds,
    Duration,
    Folder,
    LabelName,
    LabelValue,
    Moment,
    Name,
    Namespace,
    PositiveDuration,
    TaskName,
    TimeZone,
    Topic,
    WeeklyTime,
)


class Entry(BaseModel):
    """A mapping in fleet.yml: unknown keys are errors, types are not converted."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        model_title_generator=lambda model: model.__name__.removesuffix("Entry"),
    )


def optional(description: str, *, example: Any, default: Any = None) -> Any:
    """An optional key; ``default`` applies if the key is not given.

    Schema and documentation show the default, but the model has None for "not given": `resolve`
    then looks in the profile that is extended, for instance.
    """
    extra = {} if default is None else {"default": default}
    return Field(
        default=None, description=description, examples=[example], json_schema_extra=extra or None
    )


def required(description: str, *, example: Any) -> Any:
    """A required key."""
    return Field(description=description, examples=[example])


MAX_CONDITIONS = 10  # of one when or unless
LevelWord = Literal["OK", "WARN", "ERROR", "STALE"]


class CheckEntry(Entry):
    """A named set of components; a list of words is short for `match`."""

    match: Words | None = optional(
        "Words, case ignored: a component belongs to the check if its group and name contain "
        'one of them. {regex: "..."} is searched in `group/component` as it is. Without it, all.',
        example=["Motor"],
    )
    expect: Annotated[int, Field(ge=0, le=100_000)] | None = optional(
        "How many components the check should find; fewer are CRITICAL.", example=3
    )


def _short_check(value: Any) -> Any:
    return {"match": value} if isinstance(value, str | list) else value


Check = Annotated[
    CheckEntry, BeforeValidator(_short_check, json_schema_input_type=Words | CheckEntry)
]


class ConditionEntry(Entry):
    """What a component, or a value, of the same robot has to be like."""

    component: Words | None = optional(
        "Words, case ignored, one of which the component's name contains; one such component is "
        "enough. Without it, the component itself.",
        example="Charger",
    )
    level: ConditionLevels | None = optional(
        "The component's level, or a list of levels one of which it has. In place of `key`.",
        example="ERROR",
    )
    key: Wildcards | None = optional("The key of one of its values.", example="Charging state")
    equals: Equals | None = optional(
        "The text that the driver publishes, case ignored, `*` for anything; or a list, one of "
        "which it is; or {regex: ...}, matched against the whole text.",
        example="charging",
    )
    below: float | None = optional(
        "The number is below, as it is exported: after `enum`, `scale` and `offset`.", example=20
    )
    above: float | None = optional("The number is above, as it is exported.", example=0.5)

    @model_validator(mode="after")
    def _about_one_thing(self) -> ConditionEntry:
        if (self.level is None) == (self.key is None):
            what = "has neither level nor key" if self.level is None else "has level and key"
            remedy = (
                "give one: {component: Gripper, level: ERROR} or {key: State, equals: charging}"
            )
            raise WrongValueError(what, remedy)
        if self.level is not None and self.component is None:
            what = "is about the component's own level"
            raise WrongValueError(what, "name another component, or use levels to change a level")
        is_number = self.below is not None or self.above is not None
        if self.level is not None and (is_number or self.equals is not None):
            raise WrongValueError("compares a level with a value", "give key in place of level")
        if self.key is not None and is_number == (self.equals is not None):
            what = (
                "compares a text and a number" if is_number else "compares the value with nothing"
            )
            raise WrongValueError(what, "give equals, or below, above or both of these")
        if None not in (self.below, self.above) and self.below <= self.above:  # type: ignore[operator]
            what = f"never holds: nothing is above {self.above:g} and below {self.below:g}"
            raise WrongValueError(what, "give one of them, or two conditions")
        return self


def _list_of_one(value: Any) -> Any:
    if value == []:
        raise WrongValueError("is an empty list", "remove it or fill it in")
    return value if isinstance(value, list) else [value]


_ConditionLevel = Literal["OK", "WARN", "ERROR"]
ConditionLevels = Annotated[
    list[_ConditionLevel],
    Field(min_length=1),
    BeforeValidator(_list_of_one, json_schema_input_type=_ConditionLevel | list[_ConditionLevel]),
]
ConditionList = Annotated[
    list[ConditionEntry],
    Field(min_length=1, max_length=MAX_CONDITIONS),
    BeforeValidator(_list_of_one, json_schema_input_type=ConditionEntry | list[ConditionEntry]),
]
_WHEN = (
    "Only where this condition holds, or all of a list, is their trouble a fault; while it is not "
    "known, no fault begins and none ends."
)
_UNLESS = "Where this condition holds, or one of a list, their trouble is no fault."
_CHARGING = {"component": "Charger", "key": "State", "equals": "charging"}


class ComponentEntry(Entry):
    """Settings for some components; the first entry that matches applies."""

    match: Words = required(
        "Words, case ignored, one of which the component's name contains; or {regex: ...}.",
        example="Laser",
    )
    ignore: bool | None = optional("Ignore these components.", example=True, default=False)
    stale_after: PositiveDuration | None = optional(
        "Time without an update after which they are STALE, in place of the profile's.",
        example="90s",
    )
    confirm_after: Duration | None = optional(
        "Time after which a problem is confirmed, in place of the profile's.",
        example="1m",
    )
    levels: dict[LevelWord, LevelWord] | None = optional(
        "The level that counts in place of the published one.", example={"ERROR": "WARN"}
    )
    planned_stale: bool | None = optional(
        "Their STALE is planned (a sensor that is switched off): no notification is sent.",
        example=True,
        default=False,
    )
    when: ConditionList | None = optional(
        _WHEN, example={"component": "Mode", "key": "mode", "equals": "auto"}
    )
    unless: ConditionList | None = optional(_UNLESS, example=_CHARGING)

    @model_validator(mode="after")
    def _something_to_judge(self) -> ComponentEntry:
        if self.ignore and (self.when or self.unless):
            what = "ignores these components and gives them conditions"
            raise WrongValueError(what, "remove ignore, or when and unless")
        return self


class BoundEntry(Entry):
    """Thresholds for a value, in the unit in which it is exported."""

    warning: float | None = optional("Beyond it the value is a WARNING.", example=11.5)
    critical: float | None = optional("Beyond it the value is CRITICAL.", example=10.8)


class ThresholdsEntry(Entry):
    """Thresholds for a value, exported as `component_value_threshold`."""

    low: BoundEntry | None = optional("The value should not be below.", example={"critical": 10.8})
    high: BoundEntry | None = optional("The value should not be above.", example={"warning": 80})

    @model_validator(mode="after")
    def _in_order(self) -> ThresholdsEntry:
        low, high = self.low or BoundEntry(), self.high or BoundEntry()
        names = ("low critical", "low warning", "high warning", "high critical")
        limits = (low.critical, low.warning, high.warning, high.critical)
        given = [(n, b) for n, b in zip(names, limits, strict=True) if b is not None]
        for (below, small), (above, large) in pairwise(given):
            if small > large:
                raise WrongValueError(
                    f"{below} ({small:g}) is above {above} ({large:g})",
                    "order them: low critical, low warning, high warning, high critical",
                )
        return self


class ValueEntry(Entry):
    """How some key-values are read; the first entry that matches applies."""

    key: Wildcards | None = optional(
        "The key as the driver publishes it, `*` for anything; or {regex: ...}, matched "
        "against the whole key. A colon at the end may be omitted. Without `key`, all keys.",
        example="Voltage (V)",
    )
    component: Words | None = optional(
        "Words, case ignored, one of which the component's name contains. Without it, all.",
        example="Battery",
    )
    keep: bool | None = optional("false drops the value.", example=False, default=True)
    unit: Unit | None = optional(
        "The unit, in place of the one found in the key or the value.", example="V"
    )
    enum: dict[str, float] | None = optional(
        "Numbers for words, case ignored.", example={"None": 0, "Adapter": 1, "Dock": 2}
    )
    scale: float | None = optional(
        "Factor from the value to what is exported.", example=0.01, default=1
    )
    offset: float | None = optional("Added after `scale`.", example=-273.15, default=0)
    metric: MetricName | None = optional(
        "Export the value as a metric of this name, in a base unit, in place of `component_value`; "
        "in addition to it if there are `thresholds`.",
        example="ros_battery_voltage_volts",
    )
    thresholds: ThresholdsEntry | None = optional(
        "Thresholds for the exported value.", example={"low": {"warning": 11.5, "critical": 10.8}}
    )
    when: ConditionList | None = optional(
        "As in a [component](#component), for the faults of the thresholds.",
        example={"component": "Dock", "key": "Docked", "equals": True},
    )
    unless: ConditionList | None = optional(
        "As in a component, for the faults of the thresholds.",
        example={"key": "Charging state", "equals": "charging"},
    )

    @model_validator(mode="after")
    def _something_to_do(self) -> ValueEntry:
        others = self.model_fields_set - {"key", "component", "keep"}
        if self.keep is False and others:
            what = f"drops the value (keep: false) and also sets {', '.join(sorted(others))}"
            raise WrongValueError(what, "remove keep, or the other keys")
        if self.thresholds is None and (self.when or self.unless):
            what = "has conditions and no thresholds, so there is no fault that they could prevent"
            raise WrongValueError(what, "add thresholds, or move them to an entry of components")
        if self.scale == 0:
            raise WrongValueError(
                "scale is 0, which makes every value the same", "use another factor"
            )
        if self.enum is not None:
            words = {word.strip().lower() for word in self.enum}
            if not self.enum or len(words) < len(self.enum):
                what = "enum names a word twice, as case is ignored" if words else "enum is empty"
                raise WrongValueError(what, "give each word one number, or remove enum")
        return self


class ProfileEntry(Entry):
    """Settings for a kind of robot. What is not given comes from the profile that is extended."""

    extends: Name | None = optional(
        "The profile to start from. Checks are added to its own (one of the same name replaces it, "
        "null removes it); its components and values are searched after this profile's own.",
        example="wheeled",
        default="default",
    )
    stale_after: PositiveDuration | None = optional(
        "Time without a message after which a robot is silent.", example="5s", default="10s"
    )
    confirm_after: Duration | None = optional(
        "Time after which a problem is confirmed.", example="30s", default="10s"
    )
    forget_after: PositiveDuration | None = optional(
        "Time without an update after which a component of a silent robot is forgotten if it was "
        "OK, and a discovered robot that never published.",
        example="24h",
        default="24h",
    )
    flap_interval: PositiveDuration | None = optional(
        "Time between two of the 21 states in which changes are counted for "
        "`component_flap_ratio`.",
        example="1m",
        default="15s",
    )
    stale_is_critical: bool | None = optional(
        "Whether STALE counts as CRITICAL; else it is a state of its own between WARNING and "
        "CRITICAL. By default the fleet's `stale_is_critical`.",
        example=True,
    )
    checks: dict[Name, Check | None] | None = optional(
        "Named sets of components. The check `all` always exists and has no words.",
        example={"motors": ["Motor"], "lasers": {"match": ["Laser"], "expect": 2}},
    )
    components: list[ComponentEntry] | None = optional(
        "Settings for some components; the first entry that matches applies.",
        example=[{"match": "Laser", "stale_after": "90s"}],
    )
    values: list[ValueEntry] | None = optional(
        "How key-values are read; the first entry that matches applies.",
        example=[{"key": "PID", "keep": False}],
    )
    tasks: dict[TaskName, Words | None] | None = optional(
        "What the robot does, and words of the names of the components that it needs for it: "
        "notifications say what it can no longer do, and what it still can.",
        example={"drive": ["Motor", "Laser"], "lift": ["Lift"]},
    )


SourceWord = Literal["agg", "raw", "both", "auto"]
MESSAGE_TYPE = "diagnostic_msgs/msg/DiagnosticArray"

_SOURCE = (
    "Where the components are read from: `agg`, the tree of the robot's "
    "diagnostic_aggregator; `raw`, what the drivers publish; `both`, the tree from the aggregate "
    "and changes from raw, because an aggregator hides what is shorter than its period; `auto`, "
    "the aggregate if there is one, else raw, decided once for a robot."
)
_PROFILE = "The robot's profile."
_LABELS = (
    "Labels of `robot_info`. The rules that are shipped put `site`, `robot_group`, `team`, `kind` "
    "and `uplink` on alerts, for routing; any other is for queries of your own. Reserved names are "
    "rejected."
)


class RobotEntry(Entry):
    """A robot that is known by name, also before its first message and while it is silent."""

    name: Name = required("The robot's name, unique in the fleet: its label `robot`.", example="r1")
    namespace: Namespace | None = optional(
        "The ROS namespace in which the robot publishes `diagnostics_agg` and `diagnostics`. "
        "Without `namespace` and `topic` the robot is the one in the root namespace of its domain.",
        example="/robot_1",
        default="/",
    )
    topic: Topic | None = optional(
        "The topic in full, in place of `namespace`. With source `auto` or `both`, a name that "
        "ends in `_agg` is the aggregate's, any other is raw, and the other topic is named after "
        "it. If it is one of `shared`, this is one of the robots there.",
        example="/robot_1/health/diagnostics_agg",
    )
    domain_id: DomainId | None = optional(
        "The ROS_DOMAIN_ID of the robot. 102 to 214 share ports with Linux' outgoing connections "
        "and cause a warning.",
        example=7,
        default=0,
    )
    source: SourceWord | None = optional(_SOURCE, example="raw", default="auto")
    profile: Name | None = optional(_PROFILE, example="turtlebot4", default="default")
    address: Address | None = optional(
        "Host name or IP address for checks of the host (ping, SSH, node_exporter).",
        example="10.0.0.17",
    )
    labels: dict[LabelName, LabelValue] | None = optional(_LABELS, example={"site": "hall"})

    @model_validator(mode="after")
    def _one_topic(self) -> RobotEntry:
        if self.namespace is not None and self.topic is not None:
            raise WrongValueError("has both namespace and topic", "keep one of them")
        return self


class DiscoveryEntry(Entry):
    """Robots that are found by their topics, as they come and go."""

    topic: TopicTemplate | None = optional(
        "The topics to look for: `{robot}` stands for one part of the name and becomes the "
        "robot's name, `*` stands for one part of any name.",
        example="/{robot}/diagnostics_agg",
    )
    type: Literal["diagnostic_msgs/msg/DiagnosticArray"] | None = optional(
        "In place of `topic`: every topic of this message type is a robot's, whatever its "
        "name; the robot's name is the last part of its namespace (`/hall/r1/health` -> `r1`). "
        "With source `agg` only topics that end in `_agg`, with `raw` only the others.",
        example=MESSAGE_TYPE,
    )
    domain_ids: DomainIds | None = optional(
        "The DDS domains to look in: numbers and ranges.", example=[0, "10-19"], default=[0]
    )
    name: NameTemplate | None = optional(
        "The robot's name, made of `{robot}` and `{domain_id}`; for robots in the root namespace "
        "of a domain of their own: `robot_{domain_id}`.",
        example="amr_{robot}",
        default="{robot}",
    )
    include: Wildcards | None = optional(
        "Only robots with these names; `*` stands for anything.", example=["amr_*"]
    )
    exclude: Wildcards | None = optional("No robots with these names.", example=["amr_test*"])
    source: SourceWord | None = optional(_SOURCE, example="agg", default="auto")
    profile: Name | None = optional(_PROFILE, example="turtlebot4", default="default")
    address: NameTemplate | None = optional(
        "The robot's host, made of `{robot}`, the robot's name, and `{domain_id}`.",
        example="{robot}.lan",
    )
    labels: dict[LabelName, LabelValue] | None = optional(_LABELS, example={"site": "hall"})

    @model_validator(mode="after")
    def _names_robots(self) -> DiscoveryEntry:
        if (self.topic is None) == (self.type is None):
            what = "has neither topic nor type" if self.topic is None else "has topic and type"
            raise WrongValueError(what, 'give one, such as topic: "/{robot}/diagnostics_agg"')
        named = self.type is not None or "{robot}" in (self.topic or "")
        if not named and "{robot}" in (self.name or "{robot}"):
            raise WrongValueError(
                "cannot distinguish robots: topic has no {robot}",
                'put {robot} into topic, or name: "robot_{domain_id}"',
            )
        if self.name is not None and "{robot}" not in self.name and named:
            raise WrongValueError("gives all robots of a domain one name", "put {robot} into name")
        return self


class SharedEntry(Entry):
    """Several robots on one topic; each status names its robot."""

    topic: Topic = required("The topic on which they all publish.", example="/diagnostics")
    domain_id: DomainId | None = optional("Its DDS domain.", example=7, default=0)
    source: Literal["agg", "raw"] | None = optional(
        "Whether arrays are complete (`agg`) or partial (`raw`). By default `agg` if the topic's "
        "name ends in `_agg`, else `raw`.",
        example="raw",
    )
    by: Literal["hardware_id", "name"] | None = optional(
        "Where a status names its robot: in its `hardware_id` or in its `name`.",
        example="hardware_id",
        default="hardware_id",
    )
    pattern: Split | None = optional(
        "How to find the robot's name there: text with `{robot}` and, for names, `{component}`; "
        'or {regex: "..."} with groups of these names, `(?P<robot>...)`. Statuses that do not '
        "match are counted as rejected. Needed with by: name; without it the whole hardware_id is "
        "the robot's name.",
        example="{robot}/{component}",
    )
    profile: Name | None = optional(
        "The profile of these robots.", example="arm", default="default"
    )
    labels: dict[LabelName, LabelValue] | None = optional(_LABELS, example={"site": "hall"})

    @model_validator(mode="after")
    def _names_need_a_pattern(self) -> SharedEntry:
        if self.by == "name" and self.pattern is None:
            raise WrongValueError(
                "has by: name and no pattern", 'add pattern: "{robot}/{component}"'
            )
        return self


Count = Annotated[int, Field(ge=1, le=10_000_000)]


class LimitsEntry(Entry):
    """Limits of what is held in memory and served; what is beyond is rejected and counted."""

    robots: Count | None = optional("Robots.", example=500, default=2000)
    components: Count | None = optional("Components of one robot.", example=200, default=500)
    values: Count | None = optional("Key-values of one component.", example=50, default=200)
    label_length: Annotated[int, Field(ge=16, le=4096)] | None = optional(
        "Characters of a label's value.", example=128, default=256
    )
    series: Count | None = optional(
        "Series of the whole exporter.", example=200_000, default=1_000_000
    )
    robot_series: Count | None = optional(
        "Series of one robot's values (with their thresholds); also the limit of its key-values.",
        example=5000,
        default=20_000,
    )


Share = Annotated[float, Field(ge=0, le=1)]
FlapRatio = Annotated[float, Field(ge=0.01, le=1)]


class FlappingEntry(Entry):
    """When something changes too often: Nagios' ratio of changes between its last 21 states."""

    start: FlapRatio | None = optional(
        "From this ratio on it is flapping.", example=0.5, default=0.4
    )
    stop: FlapRatio | None = optional(
        "Below this ratio it no longer is.", example=0.25, default=0.2
    )

    @model_validator(mode="after")
    def _in_order(self) -> FlappingEntry:
        default = FaultSettings()
        start = default.flapping_start if self.start is None else self.start
        stop = default.flapping_stop if self.stop is None else self.stop
        if stop >= start:
            what = f"stop ({stop:g}) is not below start ({start:g})"
            raise WrongValueError(what, "use a stop below start, such as start: 0.4, stop: 0.2")
        return self


class ManyEntry(Entry):
    """When components of one robot that fail at once are one fault."""

    components: Count | None = optional(
        "At least so many of its components.", example=10, default=8
    )
    share: Share | None = optional(
        "At least this share of all that it has, too.", example=0.3, default=0.5
    )
    absolute: Count | None = optional(
        "Or so many components, however many it has.", example=40, default=20
    )


class SiteEntry(Entry):
    """When robots of one site that fall silent at once are one fault."""

    robots: Count | None = optional("At least so many of its robots.", example=3, default=5)
    share: Share | None = optional("At least this share of them, too.", example=0.3, default=0.5)
    absolute: Count | None = optional(
        "Or so many robots, however large the site is.", example=50, default=20
    )


class CommonEntry(Entry):
    """When one component that is CRITICAL on many robots is one fault."""

    robots: Count | None = optional("At least so many robots.", example=3, default=5)
    share: Share | None = optional(
        "At least this share of the fleet, too.", example=0.2, default=0.25
    )
    absolute: Count | None = optional(
        "Or so many robots, however large the fleet is.", example=50, default=20
    )


class WarningHoursEntry(Entry):
    """The hours of the week in which faults of severity warning begin."""

    weekly: Annotated[list[WeeklyTime], Field(min_length=1)] = required(
        "Times of each week, in `time_zone`, also across midnight.",
        example=["Mon-Fri 06:00-18:00"],
    )
    time_zone: TimeZone | None = optional(
        "The IANA time zone of the times.", example="Europe/Berlin", default="UTC"
    )


class FaultsEntry(Entry):
    """How the exporter decides which problems are faults, for the whole fleet."""

    restart_grace: Duration | None = optional(
        "Time after a start of the exporter in which no fault begins for want of data.",
        example="1m",
        default="30s",
    )
    pending_after: Duration | None = optional(
        "Time after which a declared robot that was never received is a fault.",
        example="1h",
        default="15m",
    )
    confirm_after: Duration | None = optional(
        "Time after which a fault of a site, or one that is common to many robots, is confirmed; "
        "for robots and components see the profile.",
        example="30s",
        default="10s",
    )
    flapping: FlappingEntry | None = optional(
        "When components, and robots that come and go, are flapping.", example={"start": 0.5}
    )
    value_hysteresis: Share | None = optional(
        "Share of a threshold by which a value has to come back before its fault ends.",
        example=0.05,
        default=0.02,
    )
    many: ManyEntry | None = optional(
        "When components of one robot that fail at once are one fault.", example={"components": 5}
    )
    site: SiteEntry | None = optional(
        "When robots of one site (their label `site`) that fall silent at once are one fault.",
        example={"robots": 3, "share": 0.3},
    )
    common: CommonEntry | None = optional(
        "When one component that is CRITICAL on many robots is one fault.",
        example={"robots": 10, "absolute": 50},
    )
    warning_hours: WarningHoursEntry | None = optional(
        "The hours of the week in which faults of severity warning begin. By default all.",
        example={"weekly": ["Mon-Fri 06:00-18:00"], "time_zone": "Europe/Berlin"},
    )


class MaintenanceEntry(Entry):
    """A planned downtime: which robots, when and why."""

    name: Name = required("A name for people.", example="hall 2 charges")
    selector: dict[str, Wildcards] = required(
        "The robots: each of these labels (`robot`, `fleet` and those of `labels`) must match one "
        'of its texts, `*` stands for anything; or {regex: "..."}.',
        example={"site": "hall_2", "robot": ["amr_*", "arm_1"]},
    )
    comment: str = required("The reason.", example="batteries, ticket 12")
    start: Moment | None = optional(
        "When it begins (ISO 8601; without an offset, in `time_zone`).", example="2026-03-28T22:00"
    )
    end: Moment | None = optional("When it ends.", example="2026-03-29T06:00:00+02:00")
    weekly: list[WeeklyTime] | None = optional(
        "Times of each week, in `time_zone`, also across midnight; only between `start` and `end` "
        "if these are given.",
        example=["Mon-Fri 22:00-06:00", "Sun 00:00-24:00"],
    )
    time_zone: TimeZone | None = optional(
        "The IANA time zone of the times.", example="Europe/Berlin", default="UTC"
    )

    @model_validator(mode="after")
    def _has_robots_and_time(self) -> MaintenanceEntry:
        if not self.selector:
            raise WrongValueError(
                "selects nothing", 'name a label, such as selector: {robot: "*"} for all'
            )
        if self.start is None and self.end is None and not self.weekly:
            raise WrongValueError("has no time", "add start, end or weekly")
        return self


class FleetFile(Entry):
    """The file fleet.yml."""

    fleet: Name = required("The fleet's name: the label `fleet` of every series.", example="plant1")
    exporter: LabelValue | None = optional(
        "This exporter's name where several share the fleet: the label `exporter` of its faults, "
        "robots and own metrics. Two that receive the same robots have the same name.",
        example="berlin",
    )
    stale_is_critical: bool | None = optional(
        "Whether STALE counts as CRITICAL, in all profiles that do not set it.",
        example=True,
        default=False,
    )
    robots: list[RobotEntry] | None = optional(
        "Robots known by name.", example=[{"name": "robot_1", "namespace": "/robot_1"}]
    )
    robots_folder: Folder | None = optional(
        "A folder, beside this file, of more robots: each `*.yml` in it has one robot or a list. "
        "Add a file to add a robot.",
        example="fleet/robots",
        default="robots.d",
    )
    discovery: list[DiscoveryEntry] | None = optional(
        "Robots found by their topics.", example=[{"topic": "/{robot}/diagnostics_agg"}]
    )
    shared: list[SharedEntry] | None = optional(
        "Topics on which several robots publish.",
        example=[{"topic": "/diagnostics", "by": "hardware_id"}],
    )
    profiles: dict[Name, ProfileEntry | None] | None = optional(
        "Settings for kinds of robots. `default` applies where no profile is named, and is "
        "extended by profiles without `extends`.",
        example={"default": {"stale_after": "5s"}},
    )
    maintenance: list[MaintenanceEntry] | None = optional(
        "Planned downtimes.",
        example=[
            {
                "name": "charging",
                "selector": {"robot": "*"},
                "comment": "every night",
                "weekly": ["daily 22:00-23:00"],
            }
        ],
    )
    maintenance_folder: Folder | None = optional(
        "A folder, beside this file, of more planned downtimes: each `*.yml` in it has one or a "
        "list.",
        example="fleet/maintenance",
        default="maintenance.d",
    )
    faults: FaultsEntry | None = optional(
        "How the exporter decides which problems are faults.", example={"pending_after": "1h"}
    )
    canary: CanaryInterval | None = optional(
        "How often a canary measures the time of a notification (docs/notifications.md), at least "
        "1m. By default never.",
        example="5m",
    )
    limits: LimitsEntry | None = optional("Limits.", example={"components": 200})
