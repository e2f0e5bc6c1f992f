"""The key `graph` of a profile: what of the ROS graph and of the link is judged, and how."""

import re
from collections.abc import Callable
from typing import Annotated, Any, Literal

from pydantic import Field
from typing_extensions import override

from ros_diagnostics_exporter.config.errors import WrongValueError, quoted
from ros_diagnostics_exporter.config.keys import Entry, Value, Written, described
from ros_diagnostics_exporter.config.patterns import Wildcards
from ros_diagnostics_exporter.config.scalars import NAME, PositiveDuration


def _node_name(value: Any) -> str:
    if not isinstance(value, str) or not re.fullmatch(NAME, value):
        what = f"{quoted(value)} is not the name of a node"
        raise WrongValueError(what, "write it as `ros2 node list` does, such as /robot_1/amcl")
    return value


NodeName = Annotated[str, Value(_node_name, "name of a node", type="string", pattern=f"^{NAME}$")]
NO_RATES = (
    "rates cannot be subscribed: this takes a filter in the publisher, which the exporter does not "
    "ask for (rclpy can only from 7.1.8 of ROS 2 Jazzy on)"
)
OTHER_RATES = (
    "remove it, and have the driver report its rate, with TopicDiagnostic of diagnostic_updater"
)
NO_BATTERIES = "batteries are now entries of topics, as fields of any other topic are"
OTHER_BATTERIES = (
    "remove it, and add to the profile topics: [{topic: battery_state, component: Battery, "
    "fields: {percentage: Charge, voltage: Voltage (V)}}]"
)
Loss = Annotated[float, Field(gt=0, le=1)]


class Watched(Entry):
    """What is subscribed of a robot beside its diagnostics. All of it costs bytes of its link."""

    logs: bool = described(
        "Subscribe `/rosout`: messages that the robot's nodes log with ERROR or worse are in the "
        "evidence of its faults. There is one subscription for all robots of a domain, and it "
        "receives messages of lower levels, too.",
        example=True,
        default=False,
    )
    log_faults: Wildcards = described(
        "With `logs`: messages of ERROR or worse that are faults themselves; `*` stands for "
        "anything.",
        example=["*out of memory*"],
        default=(),
    )
    log_ends_after: PositiveDuration = described(
        "The fault ends this long after the last such message. The time runs only while the "
        "robot's nodes are seen, and not in the first minute after they are seen again.",
        example="1h",
        default=600.0,
    )
    transitions: bool = described(
        "Subscribe `~/transition_event` of the robot's nodes. A node that is stuck between two "
        "states of its life cycle, or that an error threw out of them, is a fault.",
        example=True,
        default=False,
    )
    parameters: bool = described(
        "Subscribe `/parameter_events`: each parameter that is set is an event of the robot.",
        example=True,
        default=False,
    )
    bytes_per_second: Annotated[int, Field(ge=1, le=1_000_000_000)] = described(
        "How many bytes a second all this and `topics` may take for each robot, over a minute. If "
        "they take more, the largest topics are not read for an hour. The component `watch` in "
        "`ROS graph` names them.",
        example=5000,
        default=20_000,
    )

    @property
    def asks(self) -> bool:
        """Whether anything is subscribed."""
        return self.logs or self.transitions or self.parameters

    @override
    @classmethod
    def _read(cls, data: Any, handler: Callable[[Any], Any]) -> Any:
        if isinstance(data, dict) and "rates" in data:
            raise WrongValueError(NO_RATES, OTHER_RATES, ("rates",))
        if isinstance(data, dict) and "batteries" in data:
            raise WrongValueError(NO_BATTERIES, OTHER_BATTERIES, ("batteries",))
        return super()._read(data, handler)


class Graph(Entry):
    """What is seen of a robot without its doing: its nodes, its topics' QoS, lost messages."""

    mode: Literal["auto", "on", "shadow", "off"] = described(
        "`on`: problems are faults. `shadow`: problems are shown, and are no faults. `auto`: "
        "`shadow` in the first week of a robot, then `on`. `off`: the graph is not judged. "
        "Problems that `watch` finds are faults with `shadow`, too.",
        example="on",
        default="auto",
    )
    learn_after: PositiveDuration = described(
        "A node is expected after it has been there for this long, all times together.",
        example="8h",
        default=86_400.0,
    )
    ignore: Wildcards = described(
        "Nodes and topics that are not judged: full names, or names in the robot's namespace; `*` "
        "stands for anything.",
        example=["debug_*", "/robot_1/camera/*"],
        default=(),
    )
    expect: Annotated[tuple[str, ...], Written(list[NodeName], tuple)] = described(
        "Nodes that are expected from the beginning: full names, or names in the robot's "
        "namespace.",
        example=["amcl", "nav/controller_server"],
        default=(),
    )
    max_loss: Loss = described(
        "If a larger share of a robot's messages is lost, the link is faulty, until less than half "
        "of this share is lost. Meanwhile a STALE component begins and ends no fault, because its "
        "messages may be among the lost ones. With `shadow`, it does begin and end faults.",
        example=0.3,
        default=0.2,
    )
    watch: Watched = described(
        "Topics that are subscribed beside the robot's diagnostics. By default there are none.",
        example={"logs": True},
        default=Watched(),
    )
