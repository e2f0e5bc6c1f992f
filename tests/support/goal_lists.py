"""Lists of goals as an action server sends them, without ROS."""

from collections.abc import Sequence
from struct import pack

from ros_diagnostics_exporter.decode.goals import Goal


def encode_goals(goals: Sequence[Goal]) -> bytes:
    """A serialized action_msgs/GoalStatusArray; the stamps are whole seconds."""
    parts = [b"\0\1\0\0", pack("<I", len(goals))]
    for index, each in enumerate(goals):
        parts.append(each.id + (b"\0\0\0" if index else b""))
        parts.append(pack("<iIb", int(each.stamp), 0, each.status))
    return b"".join(parts)
