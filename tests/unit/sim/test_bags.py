"""Recordings in and out of files; each byte as it was."""

import json
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from virtual_robots.model import Status
from virtual_robots.recording.bags import (
    ARRAY,
    STATUS,
    BagWriter,
    Recorded,
    read_recordings,
    recorded_topics,
)
from virtual_robots.recording.cdr import encode_array, encode_status
from virtual_robots.schema.documents import DocumentError

GOLDEN = Path(__file__).parents[2] / "data/golden"
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
        ("a.json", "{}", "a.json: topic: is missing"),
        ("a.json", "[]", "a.json: is not a recording of diagnostics: must be an object"),
        ("a.json", "[" * 100_000, "a.json: is not JSON"),
        ("a.json", '{"topic": "/d", "t0_unix": 1, "messages": []}', "holds no message of"),
        ("a.mcap", "junk", "a.mcap: cannot be read as a bag"),
        ("a.txt", "junk", "a.txt: cannot be read as a bag"),
    ],
)
def test_a_file_that_is_no_recording_is_named(tmp_path, name, content, what):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(DocumentError) as caught:
        recorded_topics([path])
    assert what in str(caught.value)


STATUS_JSON = {"level": 2, "name": "M", "message": "", "hardware_id": "", "values": []}
HEADER_JSON = {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": ""}


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"status": [STATUS_JSON, {**STATUS_JSON, "level": 300}]}, "messages.1: status.1.level: "),
        ({"status": {**STATUS_JSON, "level": 300}}, "messages.1: status.level: "),
        ({"status": [{**STATUS_JSON, "values": [{"key": "a", "value": 1}]}]}, "values.0.value: "),
        ({"status": [3]}, "messages.1: status.0: "),
        ({"t": float("nan")}, "messages.1: t: "),
        ({"t": 1e300}, "messages.1: t: "),
        ({"header": {"stamp": {"sec": 2**40, "nanosec": 0}, "frame_id": ""}}, "header.stamp.sec: "),
        ({"header": {}}, "messages.1: header.stamp: is missing"),
    ],
)
def test_a_wrong_message_of_the_json_form_is_named_with_its_place(tmp_path, change, what):
    good = {"t": 0.5, "header": HEADER_JSON, "status": [STATUS_JSON]}
    path = tmp_path / "a.json"
    path.write_text(json.dumps({"topic": "/d", "t0_unix": 1, "messages": [good, good | change]}))
    with pytest.raises(DocumentError) as caught:
        recorded_topics([path])
    assert str(caught.value).startswith(f"{path}: messages.1: ")
    assert what in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("topic", ["d", "/1/d", "/d/"])
def test_a_topic_that_ros_does_not_have_is_named(tmp_path: Path, topic: str) -> None:
    path = tmp_path / "a.json"
    message = {"t": 0, "header": HEADER_JSON, "status": []}
    path.write_text(json.dumps({"topic": topic, "t0_unix": 1, "messages": [message]}))
    with pytest.raises(DocumentError, match=r"a\.json: topic .* is not a full name of ROS"):
        recorded_topics([path])


def long_bag(folder: Path, storage: str) -> Path:
    """The storage file of a bag of several chunks (pages)."""
    writer = BagWriter(folder, storage)
    for number in range(4000):
        data = encode_array([MOTOR._replace(message="hot" * 400)], float(number))
        writer.write(Recorded(10**18 + number, "/d", ARRAY, data))
    writer.close()
    return next(path for path in folder.iterdir() if path.suffix in {".db3", ".mcap"})


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@settings(max_examples=60)
@given(data=st.data())
def test_a_damaged_bag_is_one_error_that_names_it_or_is_read(storage, data, tmp_path_factory):
    folder = tmp_path_factory.getbasetemp() / f"long_{storage}"
    path = long_bag(folder, storage) if not folder.exists() else next(folder.glob("long_*.*"))
    content = bytearray(path.read_bytes())
    at = data.draw(st.integers(0, len(content) - 1) | st.integers(-3000, -9))
    if data.draw(st.booleans()):
        del content[at:]
    else:
        content[at : at + 8] = data.draw(st.binary(min_size=8, max_size=8))
    damaged = tmp_path_factory.getbasetemp() / f"damaged{path.suffix}"
    damaged.write_bytes(content)
    try:
        recorded_topics([damaged])
        list(read_recordings([damaged]))
    except DocumentError as error:
        assert str(error).startswith(f"{damaged}: ")  # noqa: PT017 - or none is raised


def test_the_error_about_a_damaged_recording_has_the_number_of_messages_read(tmp_path):
    """Of mcap: sqlite3's whole file is looked at before its first message."""
    path = long_bag(tmp_path / "bag", "mcap")
    content = bytearray(path.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 8192] = b"\xff" * 8192
    path.write_bytes(content)
    read: list[Recorded] = []
    with pytest.raises(DocumentError) as caught:
        read.extend(read_recordings([path]))
    assert f"{path}: is damaged; {len(read)} messages could be read, then: " in str(caught.value)
    assert 0 < len(read) < 4000


def test_a_file_that_is_not_there_is_named(tmp_path: Path) -> None:
    for name in ("gone", "gone.json", "gone.mcap"):
        with pytest.raises(DocumentError, match=rf"{name}: cannot be read"):
            recorded_topics([tmp_path / name])
