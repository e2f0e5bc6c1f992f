"""Recorded over real DDS and played again: the same messages."""

from __future__ import annotations

import json
import signal
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fleet_demo.processes import Process
from fleet_demo.waiting import until
from virtual_robots.bags import read_recordings

pytestmark = pytest.mark.integration

GOLDEN = Path(__file__).parents[2] / "golden"


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
            recorder.wait_for_output(rf"records {topic}\n")

        def end() -> None:
            recorder.signal(signal.SIGINT)
            until(lambda: not recorder.alive, "the end of the recorder")
            assert recorder.exit_code == 0, recorder.output()

        return end

    return begin


def sent_from_now_on(listener: Any, topic: str, seconds: float) -> Callable[[], bool]:
    """A condition: a message was heard that was sent so many seconds after now."""
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
    bag, heard = tmp_path / "first", "/robot_1/diagnostics"
    listener.listen(heard)
    robots = virtual_robots("--robots", "2")
    end = record(bag, topics_of("robot_1", "robot_2"))
    listener.until(sent_from_now_on(listener, heard, 2.0), "some messages")
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
    done = command("replay", str(a_recording), "--rate", "4", "--wait", "20")
    assert (done.returncode, done.stderr) == (0, "")
    end()
    assert set(contents(a_recording)) == topics_of("robot_1", "robot_2")
    assert contents(second) == contents(a_recording)


def test_only_the_asked_topics_are_recorded(
    virtual_robots: Callable[..., Process],
    record: Callable[..., Callable[[], None]],
    listener: Any,
    tmp_path: Path,
) -> None:
    virtual_robots("--robots", "2")
    bag, topic = tmp_path / "bag", "/robot_2/diagnostics_agg"
    listener.listen(topic)
    end = record(bag, {topic}, "--topic", "/robot_2/*_agg")
    listener.until(sent_from_now_on(listener, topic, 2.0), "messages of robot_2")
    end()
    assert set(contents(bag)) == {topic}


def test_a_json_recording_is_heard_below_a_namespace(
    command: Callable[..., Any], listener: Any
) -> None:
    listener.listen("/robot_7/diagnostics")
    path = GOLDEN / "motor_error.in.json"
    done = command("replay", str(path), "--namespace", "robot_7", "--rate", "5", "--wait", "20")
    assert (done.returncode, done.stderr) == (0, "")
    raw = json.loads(path.read_text())["messages"]
    listener.until(lambda: len(listener.of("/robot_7/diagnostics")) == len(raw), "all of it")
    heard = [[s.level[0] for s in m.status] for m in listener.of("/robot_7/diagnostics")]
    assert heard == [[s["level"] for s in m["status"]] for m in raw]
