"""fleet.yml as frozen value types: the whole file, and the types of all its parts.

The other packages read these types; they know neither YAML nor pydantic. A key is added here,
or in the file of its part, as a field that is `described`; what loads, checks and documents it
follows from that.
"""

from collections.abc import Mapping
from dataclasses import field, replace
from functools import cached_property
from itertools import starmap
from pathlib import Path
from types import MappingProxyType
from typing import Annotated, Any
from zoneinfo import ZoneInfo

from pydantic import Field
from typing_extensions import override

from ros_diagnostics_exporter.config.capabilities import FleetCapability
from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.faults import (
    CauseSettings,
    Common,
    Falling,
    FaultSettings,
    Flapping,
    Intermittent,
    Many,
    RecordingSettings,
    Site,
    WarningHours,
)
from ros_diagnostics_exporter.config.keys import Entry, Written, described, nothing
from ros_diagnostics_exporter.config.patterns import Wildcards
from ros_diagnostics_exporter.config.profiles import (
    ALL,
    DEFAULT,
    Bound,
    Check,
    ComponentRule,
    Profile,
    ProfileName,
    Threshold,
    Thresholds,
    ValueRule,
)
from ros_diagnostics_exporter.config.queries import Query
from ros_diagnostics_exporter.config.robots import (
    AGGREGATED,
    MESSAGE_TYPE,
    Discovery,
    Robot,
    Shared,
    Source,
    Zenoh,
    topics_of,
)
from ros_diagnostics_exporter.config.scalars import (
    CanaryInterval,
    CapabilityName,
    Count,
    Folder,
    LabelValue,
    Moment,
    Name,
    TimeZone,
    WeeklyTimes,
)
from ros_diagnostics_exporter.config.shard import Shard
from ros_diagnostics_exporter.model import ZENOH, Domain
from ros_diagnostics_exporter.model import Topic as DdsTopic

__all__ = [
    "AGGREGATED",
    "ALL",
    "DEFAULT",
    "MESSAGE_TYPE",
    "Bound",
    "CauseSettings",
    "Check",
    "Common",
    "ComponentRule",
    "Discovery",
    "Falling",
    "FaultSettings",
    "Flapping",
    "Fleet",
    "Intermittent",
    "Limits",
    "Maintenance",
    "Many",
    "Profile",
    "ProfileName",
    "Query",
    "RecordingSettings",
    "Robot",
    "Shared",
    "Site",
    "Source",
    "Threshold",
    "Thresholds",
    "ValueRule",
    "WarningHours",
    "Zenoh",
    "topics_of",
]

UnixTime = Annotated[float, Written(Moment)]  # of a time zone: `Maintenance.completed`


class Limits(Entry):
    """Limits of what is held in memory and served; what is beyond is rejected or cut."""

    robots: Count = described("Robots.", example=500, default=2000)
    new_robots: Count = described(
        "How many robots that are not in fleet.yml may be found at once, and then again in each "
        "ten minutes. Robots of the first two minutes do not count, unless this many of them are "
        "gone again. Robots that were known before never count.",
        example=20,
        default=50,
    )
    components: Count = described("Components of one robot.", example=200, default=500)
    values: Count = described("Key-values of one component.", example=50, default=200)
    label_length: Annotated[int, Field(ge=16, le=4096)] = described(
        "Characters of the name of a component, group or key in labels.", example=128, default=256
    )
    message_bytes: Count = described(
        "Bytes of one message; a larger one is not decoded.",
        example=4_194_304,
        default=1_048_576,
    )
    series: Count = described(
        "Series of all robots, components and values. Robots that count for `new_robots` may have "
        "at most half of them.",
        example=200_000,
        default=1_000_000,
    )
    robot_series: Count = described(
        "Series of one robot's values (with their thresholds); also the limit of its key-values.",
        example=5000,
        default=20_000,
    )


class Maintenance(Entry):
    """A planned downtime: which robots, when and why."""

    name: Name = described("A name for people.", example="hall 2 charges")
    selector: Annotated[
        Mapping[str, Wildcards], Written(dict[str, Wildcards], MappingProxyType)
    ] = described(
        "The robots, by their labels: `robot`, `fleet` and those of `labels`. Each label that you "
        'name must match one of its texts; `*` stands for anything. Or {regex: "..."}.',
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
        "The fleet's name. Every series has it as its label `fleet`, except `process_*` and "
        "`python_*`.",
        example="plant1",
        key="fleet",
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
        default_factory=nothing,
    )
    robots_folder: Folder = described(
        "A folder, beside this file, of more robots: each `*.yml` or `*.yaml` in it has one robot "
        "or a list. Add a file to add a robot.",
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
        "A folder, beside this file, of more planned downtimes: each `*.yml` or `*.yaml` in it has "
        "one or a list.",
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
        "Jobs of the fleet that need enough robots. You get a warning before too few robots can do "
        "one ([capabilities](capabilities.md#of-a-fleet)).",
        example={
            "lifting in hall 2": {
                "at_least": {"k": 3, "of": {"can": "lifting", "robots": {"site": "hall_2"}}}
            }
        },
        default_factory=nothing,
    )
    queries: Annotated[tuple[Query, ...], Written(list[Query], tuple)] = described(
        "Questions to Prometheus (`--prometheus.url`). The answers become components of the "
        "robots.",
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
        "A folder, beside this file, of more queries: each `*.yml` or `*.yaml` in it has one or a "
        "list.",
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
    recordings: RecordingSettings = described(
        "How long before and after the begin of a fault messages are kept.",
        example={"before": "2m"},
        default=RecordingSettings(),
    )
    exporter: LabelValue = described(
        "This exporter's name, if several share the fleet. Its faults, robots and own metrics have "
        "it as their label `exporter`. Two exporters that receive the same robots have one name.",
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
    sources: tuple[Path, ...] = field(
        default=(), compare=False
    )  # the files and folders it is read from
    shard: Shard | None = None  # of the exporters that share the file: `part`

    @property
    def entries(self) -> "tuple[Robot | Discovery | Shared, ...]":
        """All that robots are of: declared ones, what finds them, and topics that they share."""
        return (*self.robots, *self.discoveries, *self.shared)

    @property
    def together(self) -> str:
        """The name by which exporters judge what concerns robots of several of them."""
        return self.exporter if self.shard is None else self.shard.together

    def has(self, robot: str) -> bool:
        """Whether a robot of this name is one of this exporter's."""
        return self.shard is None or self.shard.has(robot)

    def part(self, shard: Shard) -> "Fleet":
        """What the exporter of a shard has of the fleet, by a name of its own."""
        uplinks = (each.labels["uplink"] for each in self.entries if "uplink" in each.labels)
        own = replace(shard, together=self.exporter or "shard", uplinks=frozenset(uplinks))
        others = [each for each in self.robots if not own.has(each.name)]
        topics = [(each.domain_id, topic) for each in others for topic in each.topics]
        return replace(
            self,
            robots=tuple(each for each in self.robots if own.has(each.name)),
            exporter=own.name,
            shard=replace(own, elsewhere=frozenset(starmap(DdsTopic, topics))),
        )

    @property
    def longest_confirm_after(self) -> float:
        """The longest time, in seconds, after which anything that is wrong is a fault."""
        found = [self.faults.confirm_after]
        for each in self.entries:
            found.append(each.profile.confirm_after)
            found += (rule.confirm_after or 0.0 for rule in each.profile.components)
        found += (query.confirm_after or 0.0 for query in self.queries)
        return max(found)

    @cached_property  # asked for at each scrape and look
    def domain_ids(self) -> tuple[Domain, ...]:
        """Every domain to join: those of DDS, ascending, then zenoh."""
        found = {each.domain_id for each in self.robots if each.in_ros}
        found.update(each.domain_id for each in self.shared)
        found.update(domain for each in self.discoveries for domain in each.domain_ids)
        return (*sorted(each for each in found if isinstance(each, int)), *(found & {ZENOH}))
