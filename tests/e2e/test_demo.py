"""`./run demo` as a person or a script starts it: what it prints, how it ends, what it leaves."""

import os
import re
import signal
import sys
from pathlib import Path

import pytest

from testbed import grafana, programs, zenoh
from testbed.configuration import CHECKOUT
from testbed.polling import until
from testbed.processes import Process

READY = "smtp://"  # the last of the addresses, printed when all servers are ready
INSTALLED = 4 + (grafana.command() is not None)  # robots, exporter, Prometheus, Alertmanager


@pytest.fixture
def start_demo(start_process, tmp_path):
    """A function: starts the demo, with its temporary files in a folder of the test's."""

    def start(*options: str) -> Process:
        scratch = tmp_path / "scratch"
        scratch.mkdir()
        environment = {**os.environ, "TMPDIR": str(scratch)}
        demo = start_process("demo", [sys.executable, "-m", "demo", *options], environment)
        demo.wait_for_output(READY, seconds=120)
        return demo

    return start


def children(demo: Process) -> dict[str, int]:
    """Return the demo's child processes: the path of each program to its id."""
    pids = Path(f"/proc/{demo.pid}/task/{demo.pid}/children").read_text().split()
    return {Path(f"/proc/{pid}/cmdline").read_text().replace("\0", " "): int(pid) for pid in pids}


def child(demo: Process, program: str) -> int:
    return next(
        pid for command, pid in children(demo).items() if program in command.split(" --")[0]
    )


def test_problems_and_recoveries_are_mailed_and_the_demo_exits_0(start_demo, tmp_path):
    demo = start_demo("--seconds", "120")

    until(lambda: not demo.alive, "the end of the demo", 180, every=0.5)

    assert demo.exit_code == 0, demo.output()
    for line in (
        "mail: Motor 2 of robot_3, /scan topic status (turtlebot4_diagnostics) of turtlebot_1",
        "virtual robots: robot_3 Motor 2 fails",
        "exporter: robot_3 Motor 2 is ERROR",
        "Alertmanager: RosDiagnosticsComponentCritical robot_3 Motor 2 is active",
        "Subject: ** PROBLEM ** demo/robot_3 Motor 2 is CRITICAL",
        "virtual robots: robot_3 Motor 2 is repaired",
        "Subject: ** RECOVERY ** demo/robot_3 Motor 2 is no longer CRITICAL",
        "exporter: turtlebot_1 navigate_to_pose is WARN: aborted 2 of the last ",
        "also faulty: /scan topic status STALE",
        "Subject: ** RECOVERY ** demo/turtlebot_1 navigate_to_pose is no longer WARNING",
        "demo finished: 3 problems, 3 recoveries",
    ):
        assert line in demo.output()
    assert re.search(shown_mail(), demo.output()), demo.output()
    assert not list((tmp_path / "scratch").iterdir())


def shown_mail() -> str:
    """A pattern for the mail that README.md shows: its lines, at any time and temperature."""
    readme = (CHECKOUT / "README.md").read_text()
    found = re.search(r"^email ─+\n(From:.*?)\n\[\.\.\.", readme, re.MULTILINE | re.DOTALL)
    assert found
    pattern = re.escape(found[1])
    pattern = re.sub(r"\d{4}\\-\d\d\\-\d\d\\ \d\d:\d\d:\d\d", r"[-\\d]+ [:\\d]+", pattern)
    return re.sub(r"\d+\\\.\d", r"\\d+\\.\\d", pattern)


def test_a_program_killed_for_good_makes_it_exit_1_and_name_it(start_demo):
    demo = start_demo("--seconds", "8")

    os.kill(child(demo, "virtual-robots"), signal.SIGKILL)
    until(lambda: not demo.alive, "the end of the demo", 60)

    assert demo.exit_code == 1
    assert "demo: virtual-robots was killed by sigkill" in demo.output().lower()


@pytest.mark.parametrize(
    "number",
    [
        signal.SIGINT,
        pytest.param(signal.SIGTERM, marks=pytest.mark.slow),
        pytest.param(signal.SIGKILL, marks=pytest.mark.slow),
    ],
)
def test_nothing_is_left_running_however_it_ends(start_demo, number):
    demo = start_demo()
    started = children(demo)
    assert len(started) == INSTALLED

    os.kill(demo.pid, number)
    until(lambda: not demo.alive, "the end of the demo", 60)

    until(
        lambda: not any(Path(f"/proc/{pid}").exists() for pid in started.values()),
        "the end of all programs",
    )
    assert demo.exit_code == (-signal.SIGKILL if number == signal.SIGKILL else 0)


@pytest.mark.slow
def test_robots_are_received_through_zenoh(start_demo):
    try:
        zenoh.program("zenohd")
    except programs.MissingProgram as error:
        pytest.skip(str(error))
    demo = start_demo("--zenoh", "--seconds", "90")

    until(lambda: not demo.alive, "the end of the demo", 150, every=0.5)

    assert demo.exit_code == 0, demo.output()
    assert "demo finished: 1 problem, 1 recovery" in demo.output()
