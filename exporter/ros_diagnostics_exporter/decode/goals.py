"""A serialized action_msgs/GoalStatusArray -> the goals that an action server keeps, without ROS.

CDR, as in `cdr`: a count, then of each goal an id of 16 bytes, when the server accepted it by its
own clock, and a status. Every goal after the first takes 28 bytes.
"""

from __future__ import annotations

from struct import Struct
from typing import NamedTuple

from ros_diagnostics_exporter.decode.cdr import is_cdr

ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = range(1, 7)
MOST = 1_000  # goals of one message that are read, the newest; a server keeps far fewer
# Id, seconds, nanoseconds and status of the first goal, which begins at its seconds' alignment, and
# of each other one, whose id follows a status of one byte.
_FIRST, _OTHER = "16siIb", "16s3xiIb"
BEGIN, SECOND, STRIDE = 8, 33, 28  # where these two are in the bytes, and how many a goal takes
_LITTLE = Struct("<I"), Struct(f"<{_FIRST}"), Struct(f"<{_OTHER}")
_BIG = Struct(">I"), Struct(f">{_FIRST}"), Struct(f">{_OTHER}")


Key = bytes  # the goal's id and its stamp: two thirds less memory than a tuple of both
_KEY = Struct("<16sd")


class Goal(NamedTuple):
    """One goal as its server has it; ``stamp`` is when it was accepted, by the robot's clock."""

    id: bytes
    stamp: float
    status: int

    @property
    def key(self) -> Key:
        """Which goal it is: an id may come again, for another goal."""
        return key_of(self.id, self.stamp)

    @property
    def has_ended(self) -> bool:
        """Whether nothing more happens to it."""
        return self.status in (SUCCEEDED, CANCELED, ABORTED)


def key_of(goal_id: bytes, stamp: float) -> Key:
    """The key of a goal."""
    return _KEY.pack(goal_id, stamp)


def parts_of(key: Key) -> tuple[bytes, float]:
    """The id and the stamp of a goal."""
    goal_id, stamp = _KEY.unpack(key)
    return goal_id, stamp


def decode_goals(data: bytes) -> tuple[Goal, ...]:
    """All goals of one serialized message, in its order.

    Raises:
        ValueError: the bytes are no such message.
    """
    if not is_cdr(data) or len(data) < BEGIN:
        raise ValueError("does not begin as a serialized GoalStatusArray does")
    number, first, other = _LITTLE if data[1] else _BIG
    (count,) = number.unpack_from(data, 4)
    if count == 0:
        return ()
    end = SECOND + STRIDE * (count - 1)
    if len(data) < end:
        raise ValueError(f"ends within a GoalStatusArray of {count} goals")
    begin = SECOND + STRIDE * max(0, count - MOST - 1)
    found = [*other.iter_unpack(data[begin:end])]
    if count <= MOST:
        found.insert(0, first.unpack_from(data, BEGIN))
    return tuple(
        Goal(goal_id, seconds + nanoseconds * 1e-9, status)
        for goal_id, seconds, nanoseconds, status in found
    )
