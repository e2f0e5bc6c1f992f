"""A recording that cannot be read is an error that names the file and the way out."""

from __future__ import annotations

from contextlib import closing

import pytest

from ros_diagnostics_tools.backtest.recordings import (
    Period,
    RecordingError,
    Recordings,
    RecordingSource,
)
from support.bags import BEGIN, every_second, write_bag
from virtual_robots.recording.bags import STATUS


def opened(*paths):
    return Recordings(RecordingSource(path) for path in paths)


def error(*paths):
    with pytest.raises(RecordingError) as raised, closing(opened(*paths)) as recordings:
        list(recordings.messages())
    return str(raised.value)


def test_a_missing_file_is_named(tmp_path):
    assert error(tmp_path / "no") == f"{tmp_path / 'no'}: there is no such file or folder"
    assert "No such file" in error(tmp_path / "no.json")


@pytest.mark.parametrize(
    ("content", "what"),
    [
        ("{", "is not JSON"),
        ("[]", "is no recording of diagnostics"),
        ('{"t0_unix": 1, "topic": "/d"}', "is no recording of diagnostics: KeyError('messages')"),
        ('{"t0_unix": 1, "topic": "/d", "messages": [{"t": 1, "status": [{}]}]}', "'header'"),
        ('{"t0_unix": 1, "topic": "/d", "messages": []}', "holds no diagnostic_msgs"),
    ],
)
def test_a_wrong_json_file_is_named_with_what_is_wrong(tmp_path, content, what):
    path = tmp_path / "recording.json"
    path.write_text(content)

    assert error(path).startswith(f"{path}: ")
    assert what in error(path)


def test_a_bag_without_diagnostics_says_what_to_record(tmp_path):
    bag = write_bag(tmp_path / "bag", every_second(range(3), {"motor": []}), topic_type=STATUS)

    assert (
        error(bag)
        == f"{bag}: holds no diagnostic_msgs/msg/DiagnosticArray; record /diagnostics_agg"
    )


def test_a_damaged_bag_is_named(tmp_path):
    bag = write_bag(tmp_path / "bag", every_second(range(2000), {"motor": []}))
    (file,) = bag.glob("*.mcap")
    content = bytearray(file.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 4096] = b"\xff" * 4096
    file.write_bytes(content)

    assert error(file).startswith(f"{file}: ")


def test_several_are_merged_by_time_and_their_pauses_are_known(tmp_path):
    first = write_bag(tmp_path / "1", every_second([0, 2, 4], {"motor": []}))
    second = write_bag(tmp_path / "2", every_second([1, 3, 5], {"motor": []}))
    third = write_bag(tmp_path / "3", every_second([60, 61], {"motor": []}))
    with closing(opened(third, second, first)) as recordings:
        times = [round(message.at - BEGIN) for message in recordings.messages()]

        assert times == [0, 1, 2, 3, 4, 5, 60, 61]
        assert recordings.count == 8
        periods = [Period(round(b - BEGIN), round(e - BEGIN)) for b, e in recordings.periods]
        assert periods == [(0, 5), (60, 61)]
