"""`virtual-robots` over real DDS."""

import signal
import subprocess
import time
from collections.abc import Callable
from typing import Any

import pytest

from testbed.polling import until
from testbed.processes import Process

Command = Callable[..., subprocess.CompletedProcess[str]]


def level(message: Any, name: str) -> int | None:
    return next((s.level[0] for s in message.status if s.name == name), None)


def test_robots_are_received_raw_and_aggregated(
    virtual_robots: Callable[..., Process], listener: Any
) -> None:
    for robot in ("robot_1", "robot_2"):
        listener.listen(f"/{robot}/diagnostics")
        listener.listen(f"/{robot}/diagnostics_agg")
        listener.listen(f"/{robot}/diagnostics_toplevel_state", "DiagnosticStatus")
    virtual_robots("--robots", "2", "--seed", "1")
    for robot in ("robot_1", "robot_2"):
        raw = listener.until(lambda r=robot: listener.of(f"/{r}/diagnostics"), "raw")[0]
        assert len(raw.status) == 10
        assert raw.header.stamp.sec > 1_700_000_000
        full = listener.until(
            lambda r=robot: [
                m for m in listener.of(f"/{r}/diagnostics_agg") if len(m.status) == 15
            ],
            "a full tree",
        )[0]
        assert {s.level for s in full.status} == {b"\0"}
        top = listener.until(
            lambda r=robot: listener.of(f"/{r}/diagnostics_toplevel_state"), "a top-level state"
        )[-1]
        assert top.name == "toplevel_state"


def test_without_an_aggregator_its_topics_are_left_to_another_program(
    virtual_robots: Callable[..., Process], listener: Any
) -> None:
    listener.listen("/robot_1/diagnostics")
    virtual_robots("--robots", "1", "--aggregator", "none")
    listener.until(lambda: len(listener.of("/robot_1/diagnostics")) >= 2, "two messages")
    names = listener.node.get_topic_names_and_types()
    assert [n for n, _ in names if n.startswith("/robot_1/")] == ["/robot_1/diagnostics"]


def test_a_fault_is_injected_and_repaired_by_command(
    virtual_robots: Callable[..., Process], command: Command, listener: Any
) -> None:
    listener.listen("/robot_1/diagnostics_agg")
    virtual_robots("--robots", "1")
    name = "/Motor/Motor 2"

    def latest_is(expected: int) -> bool:
        received = listener.of("/robot_1/diagnostics_agg")
        return bool(received) and level(received[-1], name) == expected

    listener.until(lambda: latest_is(0), "an OK motor")
    done = command("fault", "robot_1", "Motor 2", "error", "--message", "Over temperature")
    assert done.stderr == ""
    listener.until(lambda: latest_is(2), "a faulty motor")
    status = next(s for s in listener.received[-1][1].status if s.name == name)
    assert status.message == "Over temperature"
    command("fault", "robot_1", "Motor 2", "ok")
    listener.until(lambda: latest_is(0), "a repaired motor")


def test_a_fault_of_an_unknown_robot_is_rejected_with_the_known_ones(
    virtual_robots: Callable[..., Process], command: Command
) -> None:
    virtual_robots("--robots", "1")
    done = command("fault", "robot_9", "Motor 2", "error", code=1)
    assert done.stderr == "virtual-robots: there is no robot 'robot_9', only robot_1\n"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_cleanly(
    virtual_robots: Callable[..., Process], number: signal.Signals
) -> None:
    process = virtual_robots("--robots", "3")
    process.signal(number)
    until(lambda: not process.alive, "the end", seconds=10)
    assert process.exit_code == 0
    assert "Traceback" not in process.output()


@pytest.mark.parametrize("participants", ["fleet", "robot"])
def test_a_robot_that_is_off_cannot_go_on_but_join(
    virtual_robots: Callable[..., Process],
    command: Command,
    listener: Any,
    participants: str,
) -> None:
    """`resume` would publish on topics that left the graph with the robot."""
    listener.listen("/robot_1/diagnostics")
    listener.listen("/robot_2/diagnostics")
    process = virtual_robots("--robots", "2", "--participants", participants)

    def sent_since(robot: str, moment: float) -> int:
        received = listener.of(f"/{robot}/diagnostics")
        return sum(m.header.stamp.sec + m.header.stamp.nanosec / 1e9 > moment for m in received)

    listener.until(lambda: sent_since("robot_1", 0.0), "robot_1")
    for order in ("crash", "resume", "hang"):
        assert command("fault", "robot_1", order).stderr == ""
    then = time.time()
    listener.until(lambda: sent_since("robot_2", then) >= 3, "robot_2 to continue")
    assert sent_since("robot_1", then) == 0
    command("fault", "robot_1", "join")
    listener.until(lambda: sent_since("robot_1", then) >= 3, "robot_1 again")
    assert process.alive
    assert "Traceback" not in process.output()
