"""The key `graph` of a profile: what of the ROS graph and of the link is judged, and how."""

import re
from typing import Annotated, Any, Literal

from pydantic import Field

from ros_diagnostics_exporter.config.errors import WrongValueError, quoted
from ros_diagnostics_exporter.config.keys import Entry, Value, Written, described
from ros_diagnostics_exporter.config.patterns import Wildcards
from ros_diagnostics_exporter.config.scalars import PositiveDuration

_NODE = r"/?[A-Za-z_][A-Za-z0-9_]*(?:/[A-Za-z_][A-Za-z0-9_]*)*"


def _node_name(value: Any) -> str:
    if not isinstance(value, str) or not re.fullmatch(_NODE, value):
        what = f"{quoted(value)} is not the name of a node"
        raise WrongValueError(what, "write it as `ros2 node list` does, such as /robot_1/amcl")
    return value


NodeName = Annotated[str, Value(_node_name, "name of a node", type="string", pattern=f"^{_NODE}$")]
Loss = Annotated[float, Field(gt=0, le=1)]


class Graph(Entry):
    """What is seen of a robot without its doing: its nodes, its topics' QoS, lost messages."""

    mode: Literal["auto", "on", "shadow", "off"] = described(
        "`on`: what is wrong is a fault. `shadow`: it is shown, and no fault. `auto`: `shadow` in "
        "the first week of a robot, then `on`. `off`: nothing of it is judged.",
        example="on",
        default="auto",
    )
    learn_after: PositiveDuration = described(
        "For how long in all a node has to have been there until it is expected.",
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
        "The share of a robot's messages from which on the link is faulty if they are lost; then "
        "no STALE component of the robot is a fault.",
        example=0.3,
        default=0.2,
    )
