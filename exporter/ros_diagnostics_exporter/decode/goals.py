"""A serialized action_msgs/GoalStatusArray -> the goals that an action server keeps, without ROS.

CDR, as in `cdr`: a count, then of each goal an id of 16 bytes, when the server accepted it by its
own clock, and a status. Every goal after the first takes 28 bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from struct import Struct
from typing import NamedTuple

from ros_diagnostics_exporter.decode.cdr import is_cdr

ACCEPTED, EXECUTING, CANCELING, SUCCEEDED, CANCELED, ABORTED = range(1, 7)
MOST = 1_000  # goals of one message that are read, the newest; a server keeps far fewer
# Where the first goal begins, its number of seconds, and how many bytes a goal and its id take.
BEGIN, SECONDS, STRIDE, ID = 8, 24, 28, 16

_LITTLE = Struct("<I").unpack_from, Struct("<iIb").unpack_from
_BIG = Struct(">I").unpack_from, Struct(">iIb").unpack_from


Key = tuple[bytes, float]


class Goal(NamedTuple):
    """One goal as its server has it; ``stamp`` is when it was accepted, by the robot's clock."""

    id: bytes
    stamp: float
    status: int

    @property
    def key(self) -> Key:
        """Which goal it is: an id may come again, for another goal."""
        return self.id, self.stamp

    @property
    def has_ended(self) -> bool:
        """Whether nothing more happens to it."""
        return self.status in (SUCCEEDED, CANCELED, ABORTED)


def decode_goals(data: bytes) -> tuple[Goal, ...]:
    """All goals of one serialized message, in its order.

    Raises:
        ValueError: the bytes are no such message.
    """
    if not is_cdr(data) or len(data) < BEGIN:
        raise ValueError("does not begin as a serialized GoalStatusArray does")
    number, goal = _LITTLE if data[1] else _BIG
    (count,) = number(data, 4)
    if count and len(data) <= SECONDS + STRIDE * (count - 1) + 8:
        raise ValueError(f"ends within a GoalStatusArray of {count} goals")
    return tuple(_goal(data, each, goal) for each in range(max(0, count - MOST), count))


def _goal(data: bytes, index: int, numbers: Callable[[bytes, int], tuple[int, ...]]) -> Goal:
    at = SECONDS + STRIDE * index
    # Only the first id begins at its seconds' alignment: the others follow a status of one byte.
    begin = at - ID if index == 0 else at - ID - 3
    seconds, nanoseconds, status = numbers(data, at)
    return Goal(data[begin : begin + ID], seconds + nanoseconds * 1e-9, status)
