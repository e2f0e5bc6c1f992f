"""The shape of fleet.yml as a pydantic model: the keys, their types and what they mean.

Descriptions here are the documentation: docs/configuration.md and the JSON Schema are generated
from them.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, model_validator

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.model_base import Entry, optional, required
from ros_diagnostics_exporter.config.model_profile import ProfileEntry
from ros_diagnostics_exporter.config.model_robot import DiscoveryEntry, RobotEntry, SharedEntry
from ros_diagnostics_exporter.config.patterns import Wildcards
from ros_diagnostics_exporter.config.scalars import Folder, Name
from ros_diagnostics_exporter.config.times import Moment, TimeZone, WeeklyTime

Bound = Annotated[int, Field(ge=1, le=10_000_000)]


class LimitsEntry(Entry):
    """Bounds of what is held in memory and served; what is beyond is refused and counted."""

    robots: Bound | None = optional("Robots.", example=500, default=2000)
    components: Bound | None = optional("Components of one robot.", example=200, default=500)
    values: Bound | None = optional("Key-values of one component.", example=50, default=200)
    label_length: Annotated[int, Field(ge=16, le=4096)] | None = optional(
        "Characters of a label's value.", example=128, default=256
    )
    series: Bound | None = optional(
        "Series of the whole exporter.", example=200_000, default=1_000_000
    )
    robot_series: Bound | None = optional(
        "Series of one robot's values (one each; with thresholds also those), and as many of its "
        "key-values, numbers or not.",
        example=5000,
        default=20_000,
    )


class MaintenanceEntry(Entry):
    """A planned downtime: which robots, when and why."""

    name: Name = required("A name for people.", example="hall 2 charges")
    selector: dict[str, Wildcards] = required(
        "The robots: each label named (`robot`, `fleet` and those of `labels`) must match one of "
        'its texts, `*` stands for anything; or {regex: "..."}.',
        example={"site": "hall_2", "robot": ["amr_*", "arm_1"]},
    )
    comment: str = required("Why, for the one who asks at night.", example="batteries, ticket 12")
    start: Moment | None = optional(
        "When it begins (ISO 8601; without an offset, in `time_zone`).", example="2026-03-28T22:00"
    )
    end: Moment | None = optional("When it ends.", example="2026-03-29T06:00:00+02:00")
    weekly: list[WeeklyTime] | None = optional(
        "Times that return each week, by the clock of `time_zone`, also across midnight; only "
        "between `start` and `end` where these are given.",
        example=["Mon-Fri 22:00-06:00", "Sun 00:00-24:00"],
    )
    time_zone: TimeZone | None = optional(
        "The IANA time zone of the times.", example="Europe/Berlin", default="UTC"
    )

    @model_validator(mode="after")
    def _sometime(self) -> MaintenanceEntry:
        if not self.selector:
            raise WrongValueError(
                "selects nothing", 'name a label, as selector: {robot: "*"} for all'
            )
        if self.start is None and self.end is None and not self.weekly:
            raise WrongValueError("has no time", "give it start, end or weekly")
        return self


class FleetFile(Entry):
    """The file fleet.yml."""

    fleet: Name = required("The fleet's name: the label `fleet` of every series.", example="plant1")
    stale_is_critical: bool | None = optional(
        "Whether STALE counts as CRITICAL, for all profiles that do not say otherwise.",
        example=True,
        default=False,
    )
    robots: list[RobotEntry] | None = optional(
        "Robots known by name.", example=[{"name": "robot_1", "namespace": "/robot_1"}]
    )
    robots_folder: Folder | None = optional(
        "A folder, beside this file, of more robots: each `*.yml` in it holds one robot or a list. "
        "A robot is registered by dropping a file.",
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
        "How kinds of robots are judged. `default` is used where none is named, and extended by "
        "those that do not say what they extend.",
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
        "A folder, beside this file, of more planned downtimes: each `*.yml` in it holds one or a "
        "list.",
        example="fleet/maintenance",
        default="maintenance.d",
    )
    limits: LimitsEntry | None = optional("Bounds.", example={"components": 200})
