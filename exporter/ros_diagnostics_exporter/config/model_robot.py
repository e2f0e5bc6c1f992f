"""The shape of what names robots in fleet.yml: robots, discovery, shared topics."""

from __future__ import annotations

from typing import Literal

from pydantic import model_validator

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.model_base import Entry, optional, required
from ros_diagnostics_exporter.config.patterns import Wildcards
from ros_diagnostics_exporter.config.scalars import (
    Address,
    DomainId,
    DomainIds,
    LabelName,
    LabelValue,
    Name,
    Namespace,
    Topic,
)
from ros_diagnostics_exporter.config.templates import NameTemplate, Split, TopicTemplate

SourceWord = Literal["agg", "raw", "both", "auto"]
MESSAGE_TYPE = "diagnostic_msgs/msg/DiagnosticArray"

_SOURCE = (
    "Which topic is the truth about the components: `agg`, the tree of the robot's "
    "diagnostic_aggregator; `raw`, what the drivers publish; `both`, the tree from the aggregate "
    "and changes from raw, because an aggregator hides what is shorter than its period; `auto`, "
    "the aggregate where there is one, else raw, decided once for a robot."
)
_PROFILE = "The profile that says how the robot is judged."
_LABELS = (
    "Labels of `robot_info`. The rules that are shipped put `site`, `robot_group`, `team`, `kind` "
    "and `uplink` on alerts, for routing; any other is for queries of your own. Reserved names are "
    "refused."
)


class RobotEntry(Entry):
    """A robot that is known by name, also before it is first heard and while it is away."""

    name: Name = required("The robot's name, unique in the fleet: its label `robot`.", example="r1")
    namespace: Namespace | None = optional(
        "The ROS namespace in which the robot publishes `diagnostics_agg` and `diagnostics`. "
        "Without `namespace` and `topic` the robot is the one in the root namespace of its domain.",
        example="/robot_1",
        default="/",
    )
    topic: Topic | None = optional(
        "The topic in full, in place of `namespace`. With source `auto` or `both` the name says "
        "what it carries: it ends in `_agg` or not, and the other topic is called likewise. If it "
        "is one of `shared`, this is one of the robots there.",
        example="/robot_1/health/diagnostics_agg",
    )
    domain_id: DomainId | None = optional(
        "The ROS_DOMAIN_ID of the robot. 102 to 214 share ports with Linux' outgoing connections "
        "and earn a warning.",
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
    def _one_place(self) -> RobotEntry:
        if self.namespace is not None and self.topic is not None:
            raise WrongValueError("has both namespace and topic", "keep the one that says it")
        return self


class DiscoveryEntry(Entry):
    """Robots that are found by their topics, as they come and go."""

    topic: TopicTemplate | None = optional(
        "The topics to look for: `{robot}` stands for one part of the name and becomes the "
        "robot's name, `*` for one part that does not matter.",
        example="/{robot}/diagnostics_agg",
    )
    type: Literal["diagnostic_msgs/msg/DiagnosticArray"] | None = optional(
        "In place of `topic`: every topic of this message type is a robot's, whatever it is "
        "called; the robot's name is the last part of its namespace (`/hall/r1/health` -> `r1`). "
        "With source `agg` only those count that end in `_agg`, with `raw` only the others.",
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
    def _one_way(self) -> DiscoveryEntry:
        if (self.topic is None) == (self.type is None):
            what = "has neither topic nor type" if self.topic is None else "has topic and type"
            raise WrongValueError(what, 'give one of them, as topic: "/{robot}/diagnostics_agg"')
        named = self.type is not None or "{robot}" in (self.topic or "")
        if not named and "{robot}" in (self.name or "{robot}"):
            raise WrongValueError(
                "cannot tell one robot from another: topic has no {robot}",
                'put {robot} into topic, or name: "robot_{domain_id}"',
            )
        if self.name is not None and "{robot}" not in self.name and named:
            raise WrongValueError("gives all robots of a domain one name", "put {robot} into name")
        return self


class SharedEntry(Entry):
    """Several robots on one topic, told apart by what each status says of itself."""

    topic: Topic = required("The topic on which they all publish.", example="/diagnostics")
    domain_id: DomainId | None = optional("Its DDS domain.", example=7, default=0)
    source: Literal["agg", "raw"] | None = optional(
        "Whether arrays are complete (`agg`) or partial (`raw`). By default `agg` if the topic's "
        "name ends in `_agg`, else `raw`.",
        example="raw",
    )
    by: Literal["hardware_id", "name"] | None = optional(
        "Where a status says which robot it is of: in its `hardware_id` or in its `name`.",
        example="hardware_id",
        default="hardware_id",
    )
    pattern: Split | None = optional(
        "How the robot's name is found there: text with `{robot}` and, for names, `{component}`; "
        'or {regex: "..."} with groups of these names, `(?P<robot>...)`. Statuses that do not '
        "match are counted as rejected. Needed with by: name; without it the whole hardware_id is "
        "the robot's name.",
        example="{robot}/{component}",
    )
    profile: Name | None = optional(
        "The profile that says how these robots are judged.", example="arm", default="default"
    )
    labels: dict[LabelName, LabelValue] | None = optional(_LABELS, example={"site": "hall"})

    @model_validator(mode="after")
    def _names_need_a_pattern(self) -> SharedEntry:
        if self.by == "name" and self.pattern is None:
            raise WrongValueError(
                "has by: name and no pattern", 'add pattern: "{robot}/{component}"'
            )
        return self
