"""fleet.yml, resolved: frozen value types that the rest of the exporter reads.

Profiles are merged and patterns compiled; the other packages know neither YAML nor pydantic.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from math import ceil
from pathlib import Path
from types import MappingProxyType

from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_exporter.weekly import Weekly


def _no_labels() -> Mapping[str, str]:
    return MappingProxyType({})


AGGREGATED = "_agg"  # the usual suffix of an aggregator's topic


class Source(str, Enum):
    """Which of a robot's topics its components are read from."""

    AGG = "agg"
    RAW = "raw"
    BOTH = "both"  # the tree from the aggregate, changes of level from raw
    AUTO = "auto"  # the aggregate if there is one, else raw; decided once for a robot


@dataclass(frozen=True)
class Limits:
    """Limits of the state; only what is beyond them is rejected, and counted."""

    robots: int = 2000
    components: int = 500  # of one robot
    values: int = 200  # of one component
    label_length: int = 256  # characters
    series: int = 1_000_000  # of the whole exporter
    robot_series: int = 20_000  # of one robot's values; and as many of its key-values are kept


@dataclass(frozen=True)
class Threshold:
    """A threshold for a value, exported as component_value_threshold."""

    bound: str  # "low" or "high"
    severity: str  # "warning" or "critical"
    value: float


@dataclass(frozen=True)
class Condition:
    """What a component, or a value, of the same robot has to be like; ``text`` is for people.

    Of a value, ``texts`` or at least one of ``below`` and ``above`` is given.
    """

    text: str
    component: tuple[Pattern, ...] = ()  # any searched in the name; () = the component itself
    levels: tuple[int, ...] = ()  # one of these; () = it is about a value
    key: tuple[Pattern, ...] = ()  # any, fullmatch
    texts: tuple[Pattern, ...] = ()  # any, fullmatch on the published text
    below: float | None = None  # of the exported number
    above: float | None = None


@dataclass(frozen=True)
class Conditions:
    """When a component's or a value's trouble is a fault: all of ``when``, none of ``unless``."""

    when: tuple[Condition, ...] = ()
    unless: tuple[Condition, ...] = ()


@dataclass(frozen=True)
class ValueRule:
    """How one key-value is read; the first rule whose patterns match applies."""

    component: Pattern | None = None  # searched in the component's name; None = all
    key: Pattern | None = None  # fullmatch on the key; None = all
    keep: bool = True
    unit: str | None = None  # replaces the unit found in the strings
    enum: Mapping[str, float] | None = None  # the string (case ignored) -> number
    scale: float = 1.0  # to the base unit of `metric`
    offset: float = 0.0
    # a gauge of this name in place of component_value (in addition to it with thresholds)
    metric: str | None = None
    thresholds: tuple[Threshold, ...] = ()
    conditions: Conditions | None = None  # of the faults of its thresholds; None = always


@dataclass(frozen=True)
class ComponentRule:
    """Settings for components whose name matches; the first match applies."""

    pattern: Pattern  # searched in the component's name
    ignore: bool = False
    stale_after: float | None = None  # seconds
    confirm_after: float | None = None  # seconds
    levels: Mapping[int, int] = field(default_factory=dict)  # level published -> level counted
    planned_stale: bool = False  # no notification when it is STALE
    conditions: Conditions | None = None  # of its faults; None = always


@dataclass(frozen=True)
class Check:
    """A named set of components, as a Nagios service was in the thesis (`-N Motor`)."""

    name: str
    patterns: tuple[Pattern, ...] = ()  # any searched in "group/component"; () = all
    expect: int | None = None  # fewer than this many found is CRITICAL


@dataclass(frozen=True)
class Profile:
    """The settings for a kind of robot. Times are seconds."""

    name: str = "default"
    stale_after: float = 10.0
    confirm_after: float = 10.0
    forget_after: float = 86_400.0
    flap_interval: float = 15.0  # between two of the 21 states that flap detection looks at
    stale_is_critical: bool = False
    checks: tuple[Check, ...] = (Check("all"),)  # "all" is always the first
    components: tuple[ComponentRule, ...] = ()
    values: tuple[ValueRule, ...] = ()
    # what the robot does -> components that it needs for it, any searched in the name
    tasks: Mapping[str, tuple[Pattern, ...]] = field(default_factory=dict)

    @cached_property
    def has_conditions(self) -> bool:
        """Whether `when` or `unless` of any component or value asks about levels or values."""
        return any(each.conditions for each in self.components) or any(
            each.conditions for each in self.values
        )


@dataclass(frozen=True)
class Robot:
    """One robot that fleet.yml declares, or that discovery made from a pattern."""

    name: str
    domain_id: int = 0
    namespace: str = ""  # "/robot_1"; "" for a robot in the root namespace
    topic_agg: str | None = None  # absolute name, resolved from namespace or topic
    topic_raw: str | None = None
    source: Source = Source.AUTO
    profile: Profile = field(default_factory=Profile)
    address: str | None = None  # host name or IP address for host checks
    labels: Mapping[str, str] = field(
        default_factory=_no_labels
    )  # site, uplink, robot_group, team, kind, ...


@dataclass(frozen=True)
class Discovery:
    """Robots found by their topics: every topic that `pattern` matches is a robot."""

    pattern: re.Pattern[str]  # fullmatch on the topic; named group "robot" if `name` needs it
    template: str  # as written: "/{robot}/diagnostics_agg", or the message type
    domain_ids: tuple[int, ...] = (0,)
    source: Source = Source.AUTO
    include: tuple[Pattern, ...] = ()  # fullmatch on the robot's name; () = all
    exclude: tuple[Pattern, ...] = ()
    profile: Profile = field(default_factory=Profile)
    address: str | None = None  # "{robot}.lan", "10.0.0.{domain_id}"
    labels: Mapping[str, str] = field(default_factory=_no_labels)
    name: str = "{robot}"  # the robot's name, of {robot} as matched and {domain_id}


@dataclass(frozen=True)
class Shared:
    """One topic on which several robots publish; each status names its robot."""

    topic: str
    raw: bool  # partial arrays (/diagnostics) or complete ones (/diagnostics_agg)
    domain_id: int = 0
    by: str = "hardware_id"  # or "name"
    pattern: Pattern | None = None  # named groups "robot" and, for names, "component"
    profile: Profile = field(default_factory=Profile)
    labels: Mapping[str, str] = field(default_factory=_no_labels)


@dataclass(frozen=True)
class CauseSettings:
    """From how many on several problems are one: ``number`` and ``share``, or ``absolute``."""

    number: int
    share: float
    absolute: int | None = None

    def needed(self, total: int) -> int:
        """How many of ``total`` have to be in trouble."""
        # The tolerance keeps 0.1 of 30 at 3, whatever floating point makes of it.
        needed = max(1, self.number, ceil(self.share * total - 1e-9))
        return needed if self.absolute is None else min(needed, max(1, self.absolute))


@dataclass(frozen=True)
class WarningHours:
    """The hours of the week in which faults of severity warning begin."""

    weekly: Weekly
    time_zone: str = "UTC"


@dataclass(frozen=True)
class FaultSettings:
    """How faults are judged, for the whole fleet. Times are seconds.

    ``confirm_after`` is that of sites and common causes; ``value_hysteresis`` the share of a
    threshold by which a value has to come back.
    """

    confirm_after: float = 10.0
    restart_grace: float = 30.0
    pending_after: float = 900.0
    flapping_start: float = 0.4
    flapping_stop: float = 0.2
    value_hysteresis: float = 0.02
    many: CauseSettings = CauseSettings(8, 0.5, absolute=20)
    site: CauseSettings = CauseSettings(5, 0.5, absolute=20)
    common: CauseSettings = CauseSettings(5, 0.25, absolute=20)
    warning_hours: WarningHours | None = None  # None = always


@dataclass(frozen=True)
class Maintenance:
    """A planned downtime: which robots, and when."""

    name: str
    selector: Mapping[str, tuple[Pattern, ...]]  # label -> any of these, fullmatch
    comment: str
    start: float | None = None  # Unix time; None = since ever
    end: float | None = None  # exclusive; None = for ever
    weekly: Weekly = ()  # () = all the time between start and end
    time_zone: str = "UTC"


@dataclass(frozen=True)
class Fleet:
    """The content of fleet.yml and its folders."""

    name: str
    robots: tuple[Robot, ...] = ()
    discoveries: tuple[Discovery, ...] = ()
    shared: tuple[Shared, ...] = ()
    profiles: Mapping[str, Profile] = field(default_factory=dict)
    maintenance: tuple[Maintenance, ...] = ()
    limits: Limits = Limits()
    faults: FaultSettings = FaultSettings()
    exporter: str = ""  # the label of that name; "" for none
    canary: float | None = None  # seconds from one to the next; None = none
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
    def domain_ids(self) -> tuple[int, ...]:
        """Every DDS domain to join, ascending."""
        found = {robot.domain_id for robot in self.robots}
        found.update(domain for each in self.discoveries for domain in each.domain_ids)
        found.update(each.domain_id for each in self.shared)
        return tuple(sorted(found))


def topics_of(topic: str, source: Source) -> tuple[str | None, str | None]:
    """The aggregated and the raw topic of a robot of which one is known.

    With source agg or raw the topic has that kind, whatever its name. Else the name shows which of
    the two it is, and the other is named after it.
    """
    if source is Source.AGG:
        return topic, None
    if source is Source.RAW:
        return None, topic
    raw = topic.removesuffix(AGGREGATED)
    return raw + AGGREGATED, raw
