from __future__ import annotations

import json
import signal
import subprocess
import sys

import pytest

from ros_diagnostics_exporter.cli.status import main
from support.web_server import component, fleet, robot, wait_until

FLEET = fleet(
    robot("robot_1", component("Motor 1", "OK"), component("Cam 1", "OK", group="/Camera")),
    robot("robot_2", component("Motor 1", "ERROR", message="Over\ntemperature")),
    robot("robot_3", up=False, silent_reason="mute", maintenance=True),
    robot("spare", up=False, silent_reason="never_seen", last_message=None),
)


# A shell starts background jobs with Ctrl-C ignored, and their children inherit that.
WATCH = """
import signal, sys
from ros_diagnostics_exporter.cli.status import main
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.exit(main())
"""


@pytest.fixture
def show(serve, capsys):
    """Runs the command against a server with ``FLEET``; returns its output."""
    server = serve(fleet_snapshot=lambda: FLEET)

    def run(*arguments: str) -> str:
        assert main([*arguments, "--url", f"http://{server.addresses[0]}"]) == 0
        return capsys.readouterr().out

    return run


def test_the_worst_robots_come_first_with_their_faults(show):
    text = show()
    order = [text.index(name) for name in ("robot_3", "robot_2", "robot_1", "spare")]
    assert order == sorted(order)
    assert "silent: mute" in text
    assert "in maintenance" in text
    assert "Motor 1 ERROR: Over temperature for 1 min" in " ".join(text.split())
    assert "1 UNKNOWN, 1 CRITICAL, 1 OK, 1 PENDING" in text


@pytest.mark.parametrize(
    ("arguments", "shown"),
    [
        (["--state", "critical,pending"], {"robot_2", "spare"}),
        (["--robot", "robot_?"], {"robot_1", "robot_2", "robot_3"}),
        (["--component", "motor"], {"robot_1", "robot_2"}),
        (["--component", "/camera/"], {"robot_1"}),
        (["--component", "motor", "--state", "ok"], {"robot_1"}),
        (["--robot", "nobody"], set()),
    ],
)
def test_filters_by_state_robot_and_component(show, arguments, shown):
    found = json.loads(show(*arguments, "--json"))
    assert {each["robot"] for each in found["robots"]} == shown
    text = show(*arguments)
    names = {each["robot"] for each in FLEET["robots"]}
    assert {name for name in names if name in text} == shown


def test_components_are_shown_with_message_and_values(show):
    text = " ".join(show("--component", "motor", "--robot", "robot_2").split())
    assert "CRITICAL robot_2 /Motor Motor 1 Over" in text
    assert "Level=12.3 V" in text


def test_a_robots_text_cannot_control_the_terminal(serve, capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    evil = "\x1b]0;\x07\x9b[bold]x"
    server = serve(
        fleet_snapshot=lambda: fleet(robot(evil, component(evil, "ERROR", message=evil)))
    )
    for more in ([], ["--component", ""], ["--json"]):
        assert main(["--url", f"http://{server.addresses[0]}", *more]) == 0
        text = capsys.readouterr().out
        assert not set(text) & set("\x1b\x07\x9b")
        assert "[bold]" in "".join(text.split())


def test_states_are_those_of_the_recording_rules(serve, capsys):
    short = {"check": "motors", "found": 1, "expected": 2}
    stale = component("Arm", "STALE", state="CRITICAL")
    planned = component("Pendant", "STALE", planned_stale=True)
    robots = (robot("a", stale), robot("b", planned), robot("c", short_checks=[short]))
    server = serve(fleet_snapshot=lambda: fleet(*robots))
    assert main(["--url", f"http://{server.addresses[0]}"]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "Arm STALE, counts as CRITICAL: Arm reports STALE" in text
    assert "check motors finds 1 of 2" in text
    assert "2 CRITICAL, 1 OK" in text


def test_an_unknown_state_is_rejected(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--state", "bad"])
    assert ended.value.code == 2
    assert "BAD: not one of UNKNOWN, CRITICAL" in capsys.readouterr().err


@pytest.mark.parametrize("flag", ["--watch", "--timeout"])
@pytest.mark.parametrize("time", ["-3", "0", "nan", "inf", "soon"])
def test_an_invalid_duration_is_rejected(flag, time, capsys):
    with pytest.raises(SystemExit) as ended:
        main([flag, time])
    assert ended.value.code == 2
    stderr = capsys.readouterr().err
    assert f"argument {flag}" in stderr or f"/{flag}" in stderr
    assert f"'{time}' is not a duration" in stderr


def test_an_unreachable_exporter_is_an_error_with_its_address(capsys):
    assert main(["--url", "http://127.0.0.1:1"]) == 1
    assert "ros-diagnostics-status: http://127.0.0.1:1/" in capsys.readouterr().err


def test_watch_continues_after_an_outage_until_ctrl_c(serve, tmp_path):
    looks = []

    def look():
        looks.append(1)
        if len(looks) == 2:
            raise RuntimeError
        return FLEET

    server = serve(fleet_snapshot=look)
    arguments = ["--watch", "1.1", "--url", f"http://{server.addresses[0]}"]
    with subprocess.Popen([sys.executable, "-c", WATCH, *arguments], stdout=subprocess.PIPE) as it:
        try:
            wait_until(lambda: len(looks) >= 4)  # then the third, good again, was shown
            it.send_signal(signal.SIGINT)
            out, _ = it.communicate(timeout=20)
        finally:
            it.kill()
    assert it.returncode == 0
    assert b"robot_2" in out
