"""Serialized arrays are decoded without ROS as rclpy decodes them."""

from __future__ import annotations

import struct
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter.decode.cdr import MAX_CACHED, Decoder, decode, is_cdr
from ros_diagnostics_exporter.model import Array, Status
from ros_diagnostics_exporter.sources import dds as ros
from virtual_robots.model import Status as SentStatus
from virtual_robots.recording.cdr import encode_array

texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=12)
statuses = st.lists(
    st.builds(
        Status,
        st.integers(0, 255),
        texts,
        texts,
        texts,
        st.lists(st.tuples(texts, texts), max_size=4).map(tuple),
    ),
    max_size=5,
)


@given(statuses)
def test_what_was_encoded_is_decoded(sent):
    data = encode_array([SentStatus(*each) for each in sent], 12.5, "frame")

    found = decode(data)

    assert found == Array(12.5, tuple(sent), len(data), data)
    for values in filter(None, (each.values for each in found.statuses)):
        assert max(len(text) for pair in values for text in pair) < values.size


@given(statuses, st.data())
def test_a_message_that_ends_early_is_an_error(sent, data):
    encoded = encode_array([SentStatus(*each) for each in sent], 12.5, "frame")
    end = data.draw(st.integers(0, len(encoded) - 1))

    with pytest.raises(ValueError, match=r"ends within|does not begin"):
        decode(encoded[:end])


@given(st.binary(max_size=200))
def test_any_bytes_are_an_array_or_an_error(content):
    found = None
    with suppress(ValueError):  # and nothing else
        found = decode(b"\0\1\0\0" + content)

    assert found is None or found.size == len(content) + 4


def test_the_other_order_of_bytes_is_read():
    seconds, nanoseconds, length_of_frame, statuses = (3, 0, 1, 0)
    content = [struct.pack(">I", each) for each in (seconds, nanoseconds, length_of_frame)]

    found = decode(b"\0\0\0\0" + b"".join(content) + b"\0\0\0\0" + struct.pack(">I", statuses))

    assert (found.stamp, found.statuses) == (3.0, ())


def encoded(sent: list[Status], stamp: float = 12.5) -> bytes:
    return bytes(encode_array([SentStatus(*each) for each in sent], stamp))


@given(statuses, st.binary(min_size=1, max_size=3), st.data())
def test_rclpy_decodes_the_same_also_where_bytes_of_a_text_are_damaged(sent, bad, data):
    message = encoded([Status(1, "a name", "X" * len(bad), "", (("key", "value"),)), *sent])
    message = message.replace(b"X" * len(bad), bad, 1)

    assert decode(message) == ros.decode(message)


@given(st.lists(statuses, min_size=2, max_size=6), st.booleans())
def test_the_messages_before_change_nothing(arrays, shift):
    """Whatever came before, at the same or another place of the message."""
    decoder = Decoder()
    for number, sent in enumerate(arrays):
        more = [Status(0, "x" * number)] if shift else []
        message = encoded([*more, *arrays[0], *sent])

        assert decoder.decode(message) == decode(message)


@pytest.mark.parametrize("length", range(4))
def test_a_status_that_did_not_change_is_not_decoded_again_wherever_it_begins(length):
    decoder, values = Decoder(), (("k", "v" * length),)
    same, before, now = (Status(0, name, "message", "id", values) for name in "abc")

    first = decoder.decode(encoded([before, same])).statuses
    second = decoder.decode(encoded([now, same], stamp=13.5)).statuses

    assert second == (now, same)
    assert second[1] is first[1]


def test_key_values_are_equal_where_all_of_them_are():
    pairs = ("k", "1"), ("k", "2"), ("l", "1")
    found = [decode(encoded([Status(0, "a", values=(each,))])).statuses[0].values for each in pairs]

    assert [[one == other for one in found] for other in found] == [
        [True, False, False],
        [False, True, False],
        [False, False, True],
    ]


def test_the_same_bytes_at_another_offset_may_be_a_longer_status():
    """Of a status of nothing but zeros only its alignment says how long it is."""
    decoder = Decoder()
    for text, length in (("", 19), ("vvv", 20)):
        message = bytearray(encoded([Status(0, "a", values=(("k", text),))]))
        message[20] = 3
        message += bytes(length) + b"\2" + bytes(19)

        assert [each.level for each in decoder.decode(bytes(message)).statuses] == [0, 0, 2]


def test_after_a_damaged_message_the_next_is_decoded():
    decoder = Decoder()
    message = encoded([Status(0, "a"), Status(1, "b")])

    decoder.decode(message)
    with pytest.raises(ValueError, match="ends within"):
        decoder.decode(message[:-3])

    assert decoder.decode(message) == decode(message)


@pytest.mark.parametrize(
    ("header", "read"),
    [
        pytest.param(b"\0\0", True, id="big-endian"),
        pytest.param(b"\0\1", True, id="little-endian"),
        pytest.param(b"\0\2", False, id="parameter list"),
        pytest.param(b"\1\1", False, id="of a vendor"),
    ],
)
def test_of_the_encodings_that_dds_knows_the_plain_ones_are_read(header, read):
    assert is_cdr(header + b"\xff\xff") is read


def test_a_name_is_stored_once_unless_it_is_long():
    names = ["x" * MAX_CACHED, "x" * (MAX_CACHED + 1)]
    first, second = (decode(encoded([Status(0, name) for name in names])) for _ in range(2))

    short, long = zip(first.statuses, second.statuses, strict=True)
    assert short[0].name is short[1].name
    assert long[0].name is not long[1].name


def test_a_zero_ends_a_text_as_in_the_strings_of_ros():
    sent = Status(0, "name\0x", "message\0x", "id\0x", (("key\0x", "value\0x"),))

    (found,) = decode(encoded([sent])).statuses

    assert found == Status(0, "name", "message", "id", (("key", "value"),))
