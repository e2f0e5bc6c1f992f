"""Recordings in and out of files; each byte as it was."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from virtual_robots.bags import (
    ARRAY,
    STATUS,
    BagWriter,
    Recorded,
    read_recordings,
    recorded_topics,
)
from virtual_robots.cdr import encode_array, encode_status
from virtual_robots.diagnostics import Status
from virtual_robots.documents import DocumentError

GOLDEN = Path(__file__).parents[2] / "golden"
MOTOR = Status(2, "Motor 1", "hot", "mc-01", (("Temperature (°C)", "91.5"),))
MESSAGES = [
    Recorded(
        1_000_000_000 + i, f"/robot_{i % 2}/diagnostics", ARRAY, encode_array([MOTOR], float(i))
    )
    for i in range(20)
] + [Recorded(2_000_000_000, "/robot_0/diagnostics_toplevel_state", STATUS, encode_status(MOTOR))]


def written(path: Path, storage: str) -> Path:
    writer = BagWriter(path, storage)
    for message in MESSAGES:
        writer.write(message)
    writer.close()
    return path


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_bag_gives_back_what_was_written_to_it(tmp_path: Path, storage: str) -> None:
    path = written(tmp_path / "bag", storage)
    assert list(read_recordings([path])) == MESSAGES
    assert recorded_topics([path]) == {m.topic: m.type for m in MESSAGES}


@pytest.mark.parametrize(("storage", "suffix"), [("sqlite3", "db3"), ("mcap", "mcap")])
def test_a_bag_s_single_file_is_enough(tmp_path: Path, storage: str, suffix: str) -> None:
    file = next(written(tmp_path / "bag", storage).glob(f"*.{suffix}"))
    assert list(read_recordings([file])) == MESSAGES


def test_files_are_merged_in_order_of_time(tmp_path: Path) -> None:
    files = [GOLDEN / "all_ok.in.json", GOLDEN / "all_ok.agg.json", GOLDEN / "all_ok.top.json"]
    messages = list(read_recordings(files))
    assert [m.at for m in messages] == sorted(m.at for m in messages)
    assert set(recorded_topics(files)) == {
        "/diagnostics",
        "/diagnostics_agg",
        "/diagnostics_toplevel_state",
    }


def test_the_json_form_becomes_the_messages_that_it_tells_of() -> None:
    serialization = pytest.importorskip("rclpy.serialization", reason="needs ROS 2's messages")
    messages = pytest.importorskip("diagnostic_msgs.msg", reason="needs ROS 2's messages")
    raw = json.loads((GOLDEN / "motor_error.in.json").read_text())["messages"]
    read = list(read_recordings([GOLDEN / "motor_error.in.json"]))
    assert len(read) == len(raw)
    array = serialization.deserialize_message(read[3].data, messages.DiagnosticArray)
    assert [s.name for s in array.status] == [s["name"] for s in raw[3]["status"]]
    assert [s.level[0] for s in array.status] == [s["level"] for s in raw[3]["status"]]
    assert array.header.stamp.sec == raw[3]["header"]["stamp"]["sec"]


def test_a_recording_never_overwrites_one(tmp_path: Path) -> None:
    with pytest.raises(DocumentError, match="is there already"):
        BagWriter(tmp_path, "mcap")


@pytest.mark.parametrize(
    ("name", "content", "what"),
    [
        ("a.json", "{", "a.json: is not JSON"),
        ("a.json", "{}", "a.json: is not a recording of diagnostics: KeyError('topic')"),
        ("a.json", '{"topic": "/d", "t0_unix": 1, "messages": []}', "holds no message of"),
        ("a.mcap", "junk", "a.mcap: cannot be read as a bag"),
        ("a.txt", "junk", "a.txt: cannot be read as a bag"),
    ],
)
def test_a_file_that_is_no_recording_is_named(
    tmp_path: Path, name: str, content: str, what: str
) -> None:
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(DocumentError) as caught:
        recorded_topics([path])
    assert what in str(caught.value)


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    for name in ("gone", "gone.json", "gone.mcap"):
        with pytest.raises(DocumentError, match=rf"{name}: cannot be read"):
            recorded_topics([tmp_path / name])
