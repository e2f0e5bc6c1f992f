"""Hand-made serialized messages are what ROS itself reads."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from virtual_robots.model import Status
from virtual_robots.recording.cdr import encode_array, encode_status

serialization = pytest.importorskip("rclpy.serialization", reason="needs ROS 2's message types")
messages = pytest.importorskip("diagnostic_msgs.msg", reason="needs ROS 2's message types")

# ROS strings hold no zero byte; a lone surrogate is not UTF-8.
texts = st.text(st.characters(exclude_categories=("Cs",), exclude_characters="\0"), max_size=9)
pairs = st.lists(st.tuples(texts, texts), max_size=4).map(tuple)
statuses = st.builds(Status, st.integers(0, 255), texts, texts, texts, pairs)


def read(message: object) -> Status:
    values = tuple((v.key, v.value) for v in message.values)
    return Status(message.level[0], message.name, message.message, message.hardware_id, values)


@given(st.lists(statuses, max_size=5), st.integers(0, 2**31 - 1), st.integers(0, 999_999), texts)
def test_ros_reads_an_encoded_array_as_it_was(given_statuses, seconds, microseconds, frame_id):
    data = encode_array(given_statuses, seconds + microseconds / 1e6, frame_id)
    array = serialization.deserialize_message(data, messages.DiagnosticArray)
    assert [read(status) for status in array.status] == given_statuses
    assert array.header.stamp.sec + array.header.stamp.nanosec / 1e9 == pytest.approx(
        seconds + microseconds / 1e6, abs=1e-6
    )
    assert array.header.frame_id == frame_id


def test_text_that_is_no_unicode_is_replaced() -> None:
    data = encode_status(Status(0, "half \ud800"))
    message = serialization.deserialize_message(data, messages.DiagnosticStatus)
    assert message.name == "half ?"


@pytest.mark.parametrize(("stamp", "seconds"), [(9e9, 2**31 - 1), (-9e9, -(2**31))])
def test_a_clock_that_jumps_beyond_what_a_stamp_can_hold_stands_at_its_end(stamp, seconds):
    array = encode_array([], stamp)
    assert int.from_bytes(array[4:8], "little", signed=True) == seconds
