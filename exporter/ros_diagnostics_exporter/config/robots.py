"""Where robots are: declared by name, found by topics, on topics that they share, by zenoh."""

import re
from collections.abc import Mapping
from dataclasses import replace
from enum import Enum
from functools import partial
from types import MappingProxyType
from typing import Annotated, Any, Literal

from typing_extensions import override

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.keys import Entry, Written, described, nothing
from ros_diagnostics_exporter.config.links import Links
from ros_diagnostics_exporter.config.patterns import (
    ROBOT,
    KeyTemplate,
    NameTemplate,
    Split,
    TopicTemplate,
    Wildcards,
    topic_pattern,
)
from ros_diagnostics_exporter.config.profiles import DEFAULT, Profile, ProfileName
from ros_diagnostics_exporter.config.scalars import (
    Address,
    DomainId,
    DomainIds,
    File,
    KeyPrefix,
    LabelName,
    LabelValue,
    Locator,
    Name,
    Namespace,
    Topic,
)
from ros_diagnostics_exporter.model import ZENOH

AGGREGATED = "_agg"  # the usual suffix of an aggregator's topic
RAW_NAME = "diagnostics"
MESSAGE_TYPE = "diagnostic_msgs/msg/DiagnosticArray"

Labels = Annotated[Mapping[str, str], Written(dict[LabelName, LabelValue], MappingProxyType)]


class Source(str, Enum):
    """Which of a robot's topics its components are read from."""

    AGG = "agg"
    RAW = "raw"
    BOTH = "both"  # the tree from the aggregate, changes of level from raw
    AUTO = "auto"  # the aggregate if there is one, else raw; see `robots.reading`
    NONE = "none"  # it has no diagnostics: it is judged by what else is asked of it
    QUERIES = "queries"  # none, and it is never silent: a server, for example


AnySource = Annotated[Source, Written(Literal["agg", "raw", "both", "auto", "none"], Source)]
SourceOfOne = Annotated[
    Source, Written(Literal["agg", "raw", "both", "auto", "none", "queries"], Source)
]

_SOURCE = (
    "Where the components are read from. `agg`: the aggregator's tree. `raw`: the topic of the "
    "drivers. `both`: the tree, with changes from raw, and the tree alone while no raw message "
    "comes. `auto`: the tree, if one comes within 5 s of the first raw message, and raw otherwise. "
    "If a tree comes later, `auto` reads both for a minute, and then the tree."
)
# Keys of several entries, each described once.
_profile = partial(described, default_factory=Profile, written=DEFAULT)
_labels = partial(
    described,
    "Labels of `robot_info` and, for routing, of the alerts of the robot's faults. The shipped "
    "rules know `site`, `robot_group`, `team`, `kind` and `uplink`; other labels are for rules of "
    "your own. Reserved names are rejected.",
    example={"site": "hall"},
    default_factory=nothing,
)


def _zenoh(instead_of: str, whose: str, *, example: str) -> Any:
    return described(
        f"In place of `{instead_of}`, if messages come by [zenoh](#zenoh): the part of {whose} "
        "keys before the topic. It is a bridge's `namespace`, the number of rmw_zenoh's domain, or "
        "`/`.",
        example=example,
        default=None,
    )


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
        "The ROS namespace in which the robot publishes `diagnostics_agg` and `diagnostics`. If "
        "you give neither `namespace` nor `topic`, it is the root namespace of its domain.",
        example="/robot_1",
        default="",
        written="/",
    )
    topic_agg: str | None = None  # absolute name, of namespace or topic
    topic_raw: str | None = None
    source: SourceOfOne = described(
        f"{_SOURCE} `none`: the robot has no diagnostics, and is judged by `topics` and `graph` of "
        "its profile. `queries`: it has the components of [queries](#query), and is never silent. "
        "With a `domain_id`, `namespace` or `zenoh` it also has those of its profile's `topics` "
        "and `graph`.",
        example="raw",
        default=Source.AUTO,
    )
    profile: ProfileName = _profile("The robot's profile.", example="turtlebot4")
    address: Address | None = described(
        "Host name or IP address for checks of the host (ping, SSH, node_exporter).",
        example="10.0.0.17",
        default=None,
    )
    labels: Labels = _labels()
    links: Links = described(
        "Links of this robot, beside those of its profile.",
        example={"manual": "https://wiki.example.org/r1"},
        default_factory=nothing,
    )
    topic: Topic | None = described(
        "The full name of the topic, in place of `namespace`. With source `auto` or `both`, a "
        "topic that ends in `_agg` is the aggregator's, and any other is raw; the name of the "
        "second topic follows from it. If `shared` has the topic, this is one of the robots there.",
        example="/robot_1/health/diagnostics_agg",
        default=None,
    )
    zenoh: KeyPrefix | None = _zenoh("domain_id", "its", example="customer_a/robot_1")
    with_ros: bool = False  # with source queries: its place in ROS is given

    @property
    def topics(self) -> tuple[str, ...]:
        """The names of the topics of its diagnostics."""
        return tuple(each for each in (self.topic_agg, self.topic_raw) if each is not None)

    @property
    def in_ros(self) -> bool:
        """Whether its DDS domain is joined for it, or what zenoh connects."""
        return self.with_ros or self.source is not Source.QUERIES

    @override
    def completed(self, given: Mapping[str, Any]) -> "Robot":
        if "namespace" in given and "topic" in given:
            raise WrongValueError("has both namespace and topic", "keep one of them")
        if self.source in (Source.NONE, Source.QUERIES) and "topic" in given:
            what = f"has source {self.source.value}, so no topic of diagnostics, and topic"
            raise WrongValueError(what, "write its namespace in place of topic, or remove source")
        if self.source is Source.QUERIES and {"namespace", "domain_id", "zenoh"} & given.keys():
            self = replace(self, with_ros=True)  # noqa: PLW0642 - the rest is as for others
        if self.zenoh is None:
            return self.reading(self.source)
        _not_both("domain_id", given)
        topic = self.topic and self.zenoh + self.topic
        namespace = self.zenoh + self.namespace
        connected = replace(self, domain_id=ZENOH, topic=topic, namespace=namespace)
        return connected.reading(self.source)

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
        "The topics to look for. `{robot}` stands for one part of the topic, which becomes the "
        "robot's name; `*` stands for one part of any name.",
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
        "In place of `topic`: every topic of this type in a namespace belongs to a robot. The last "
        "part of the namespace is its name (`/hall/r1/health` -> `r1`). With source `agg` only "
        "topics that end in `_agg` count, with `raw` only the others.",
        example=MESSAGE_TYPE,
        default=None,
    )
    name: NameTemplate = described(
        "The robot's name, made of `{robot}` and `{domain_id}`. If each robot is in the root "
        "namespace of a domain of its own, write `robot_{domain_id}`.",
        example="amr_{robot}",
        default=ROBOT,
    )
    include: Wildcards = described(
        "Only robots with these names; `*` stands for anything.", example=["amr_*"], default=()
    )
    exclude: Wildcards = described("No robots with these names.", example=["amr_test*"], default=())
    source: AnySource = described(
        f"{_SOURCE} `none`: the robots have no diagnostics. `topic` is then any small topic of "
        "theirs, whatever its type. Their namespace is the topic up to `{robot}`.",
        example="agg",
        default=Source.AUTO,
    )
    profile: ProfileName = _profile("The robot's profile.", example="turtlebot4")
    address: NameTemplate | None = described(
        "The robot's host, made of `{robot}` (the robot's name) and `{domain_id}`.",
        example="{robot}.lan",
        default=None,
    )
    labels: Labels = _labels()
    zenoh: KeyTemplate | None = _zenoh("domain_ids", "their", example="customer_a/{robot}")

    @override
    def completed(self, given: Mapping[str, Any]) -> "Discovery":
        if bool(self.template) == bool(self.type):
            what = "has topic and type" if self.type else "has neither topic nor type"
            raise WrongValueError(what, 'give one, such as topic: "/{robot}/diagnostics_agg"')
        if self.type and self.source is Source.NONE:
            what = "has source none, so no diagnostics, and type, which finds them"
            raise WrongValueError(what, 'write topic: "/{robot}/battery_state" in place of type')
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
        "Whether arrays are complete (`agg`) or partial (`raw`). By default a topic that ends in "
        "`_agg` is `agg`, and any other is `raw`.",
        example="raw",
        default=None,
    )
    by: Literal["hardware_id", "name"] = described(
        "Where a status names its robot: in its `hardware_id` or in its `name`.",
        example="hardware_id",
        default="hardware_id",
    )
    pattern: Split | None = described(
        "How to find the robot's name there: text with `{robot}`, and with `{component}` for `by: "
        'name`; or {regex: "..."} with groups of these names, `(?P<robot>...)`. A status that does '
        "not match is rejected. Without it the whole hardware_id is the robot's name. `by: name` "
        "needs it.",
        example="{robot}/{component}",
        default=None,
    )
    profile: ProfileName = _profile("The profile of these robots.", example="arm")
    labels: Labels = _labels()
    zenoh: KeyPrefix | None = _zenoh("domain_id", "its", example="customer_a")

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
        "A file in PEM with the authorities that sign the routers' certificates (`tls/`, `quic/`).",
        example="/etc/ros-diagnostics/ca.pem",
        default=None,
    )
    cert_file: File | None = described(
        "The exporter's own certificate, if the router asks for one; needs `key_file`.",
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


def topics_of(topic: str, source: Source) -> tuple[str | None, str | None]:
    """The aggregated and the raw topic of a robot of which one is known.

    With source agg or raw the topic has that kind, whatever its name. Else the name shows which of
    the two it is, and the other is named after it.
    """
    if source in (Source.NONE, Source.QUERIES):
        return None, None
    if source is Source.AGG:
        return topic, None
    if source is Source.RAW:
        return None, topic
    raw = topic.removesuffix(AGGREGATED)
    return raw + AGGREGATED, raw
