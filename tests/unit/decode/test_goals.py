"""Serialized lists of goals are decoded without ROS as rclpy decodes them."""

from __future__ import annotations

from contextlib import suppress

import pytest
from action_msgs.msg import GoalInfo, GoalStatus, GoalStatusArray
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from unique_identifier_msgs.msg import UUID

from ros_diagnostics_exporter.decode.goals import (
    ABORTED,
    CANCELED,
    MOST,
    SUCCEEDED,
    Goal,
    decode_goals,
)
from support.goal_lists import encode_goals

goals = st.lists(
    st.builds(
        Goal,
        st.binary(min_size=16, max_size=16),
        st.integers(0, 2**31 - 1).map(float),
        st.integers(0, 6),
    ),
    max_size=6,
)


def encoded(sent) -> bytes:
    """The goals as ROS serializes them."""
    return serialize_message(
        GoalStatusArray(
            status_list=[
                GoalStatus(
                    goal_info=GoalInfo(
                        goal_id=UUID(uuid=list(each.id)), stamp=Time(sec=int(each.stamp))
                    ),
                    status=each.status,
                )
                for each in sent
            ]
        )
    )


@given(goals)
def test_what_ros_serialized_is_decoded(sent):
    assert decode_goals(encoded(sent)) == decode_goals(encode_goals(sent)) == tuple(sent)


@given(goals.filter(len), st.data())
def test_a_list_that_ends_early_is_an_error(sent, data):
    content = encoded(sent)
    end = data.draw(st.integers(0, 33 + 28 * (len(sent) - 1) - 1))

    with pytest.raises(ValueError, match=r"ends within|does not begin"):
        decode_goals(content[:end])


@given(st.binary(max_size=200))
def test_any_bytes_are_goals_or_an_error(content):
    found = ()
    with suppress(ValueError):  # and nothing else
        found = decode_goals(b"\0\1\0\0" + content)

    assert len(found) <= len(content)


def test_of_a_long_list_the_newest_are_read():
    sent = [Goal(number.to_bytes(16, "big"), float(number), 4) for number in range(MOST + 3)]

    assert decode_goals(encoded(sent)) == tuple(sent[3:])


def test_a_goal_has_ended_by_three_statuses():
    ended = {status for status in range(7) if Goal(b"", 0.0, status).has_ended}

    assert ended == {SUCCEEDED, CANCELED, ABORTED}
