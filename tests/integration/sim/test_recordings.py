"""Recorded over real DDS and played again: the same messages."""

import errno
import json
import os
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag2 import Writer

from testbed.polling import until
from testbed.processes import Process
from virtual_robots import cli
from virtual_robots.recording.bags import BagWriter, Recorded, read_recordings

GOLDEN = Path(__file__).parents[2] / "data/golden"


def contents(bag: Path) -> dict[str, list[bytes]]:
    """Topic -> the bytes of its messages, in order."""
    topics: dict[str, list[bytes]] = {}
    for message in read_recordings([bag]):
        topics.setdefault(message.topic, []).append(message.data)
    return topics


@pytest.fixture
def record(
    virtual_robots: Callable[..., Process], listener: Any
) -> Callable[..., Callable[[], None]]:
    """A function (bag, topics, options): begins a recording; what it returns ends it."""

    def begin(bag: Path, topics: set[str], *options: str) -> Callable[[], None]:
        recorder = virtual_robots("record", str(bag), *options)
        for topic in topics:
            recorder.wait_for_output(rf"recording {topic}\n")

        def end() -> None:
            recorder.signal(signal.SIGINT)
            until(lambda: not recorder.alive, "the end of the recorder")
            assert recorder.exit_code == 0, recorder.output()

        return end

    return begin


def sent_from_now_on(listener: Any, topic: str, seconds: float) -> Callable[[], bool]:
    """A condition: a message was received that was sent so many seconds after now."""
    later = time.time() + seconds
    return lambda: any(m.header.stamp.sec >= later for m in listener.of(topic))


def topics_of(*robots: str) -> set[str]:
    ends = ("diagnostics", "diagnostics_agg", "diagnostics_toplevel_state")
    return {f"/{robot}/{end}" for robot in robots for end in ends}


@pytest.fixture
def a_recording(
    virtual_robots: Callable[..., Process],
    record: Callable[..., Callable[[], None]],
    listener: Any,
    tmp_path: Path,
) -> Path:
    """A bag of two robots that have gone again."""
    bag, received = tmp_path / "first", "/robot_1/diagnostics"
    listener.listen(received)
    robots = virtual_robots("--robots", "2")
    end = record(bag, topics_of("robot_1", "robot_2"))
    listener.until(sent_from_now_on(listener, received, 2.0), "some messages")
    end()
    robots.stop()
    return bag


def test_a_replayed_bag_recorded_again_equals_the_first(
    command: Callable[..., Any],
    record: Callable[..., Callable[[], None]],
    a_recording: Path,
    tmp_path: Path,
) -> None:
    second = tmp_path / "second"
    end = record(second, set(), "--storage", "sqlite3")
    assert command("replay", str(a_recording), "--rate", "4", "--wait", "20").stderr == ""
    end()
    assert set(contents(a_recording)) == topics_of("robot_1", "robot_2")
    assert contents(second) == contents(a_recording)


def test_a_json_recording_is_received_below_a_namespace(
    command: Callable[..., Any], listener: Any
) -> None:
    listener.listen("/robot_7/diagnostics")
    path = GOLDEN / "motor_error.in.json"
    done = command("replay", str(path), "--namespace", "robot_7", "--rate", "5", "--wait", "20")
    assert done.stderr == ""
    raw = json.loads(path.read_text())["messages"]
    listener.until(lambda: len(listener.of("/robot_7/diagnostics")) == len(raw), "all of it")
    received = [[s.level[0] for s in m.status] for m in listener.of("/robot_7/diagnostics")]
    assert received == [[s["level"] for s in m["status"]] for m in raw]


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_recording_that_an_error_ends_keeps_what_it_had(  # noqa: PLR0917 - fixtures
    virtual_robots: Callable[..., Process],
    dds_environment: dict[str, str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    storage: str,
) -> None:
    """The full disk is simulated; the robots and the recording are real."""
    virtual_robots("--robots", "1")
    written: list[bytes] = []
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    write = Writer.write

    def full_after_five(writer: Writer, connection: Any, at: int, data: bytes) -> None:
        if len(written) == 5:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        write(writer, connection, at, data)
        written.append(bytes(data))

    monkeypatch.setattr(Writer, "write", full_after_five)
    bag = tmp_path / "bag"
    for name, value in dds_environment.items():
        monkeypatch.setenv(name, value)
    assert cli.main(["record", str(bag), "--storage", storage, "--duration", "60"]) == 2
    for number, handler in handlers.items():
        signal.signal(number, handler)
    captured = capsys.readouterr()
    assert captured.err == f"{bag}: cannot be written: [Errno 28] No space left on device\n"
    assert "5 messages of " in captured.out
    assert [message.data for message in read_recordings([bag])] == written


def test_of_a_damaged_recording_what_can_be_read_is_played(
    command: Callable[..., Any], listener: Any, tmp_path: Path
) -> None:
    bag, topic = tmp_path / "bag", "/robot_1/diagnostics"
    message = next(read_recordings([GOLDEN / "motor_error.in.json"]))
    writer = BagWriter(bag, "mcap")
    for number in range(4000):
        writer.write(Recorded(10**18 + number, topic, message.type, message.data))
    writer.close()
    file = bag / "bag.mcap"
    content = bytearray(file.read_bytes())
    middle = len(content) // 2
    content[middle : middle + 8192] = b"\xff" * 8192
    file.write_bytes(content)
    listener.listen(topic)
    done = command("replay", str(file), "--wait", "20", code=2)
    (line,) = done.stderr.splitlines()
    assert line.startswith(f"{file}: is damaged; ")
    listener.until(lambda: listener.of(topic), "what could be read")
