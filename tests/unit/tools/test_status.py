import json
import signal
import subprocess
import sys
import time

import pytest

from ros_diagnostics_exporter.events import Event, EventLog
from ros_diagnostics_exporter.severity import short_names
from ros_diagnostics_exporter.web import api
from support.web_server import broken, component, fleet, problem, robot, url_of, wait_until

FLEET = fleet(
    robot("robot_1", component("Motor 1", "OK"), component("Cam 1", "OK", group="/Camera")),
    robot(
        "robot_2",
        component("Motor 1", "ERROR", message="Over\ntemperature"),
        problems=[broken("Motor 1"), broken("Motor 1", "warning")],
    ),
    robot(
        "robot_3",
        up=False,
        silent_reason="mute",
        maintenance=True,
        maintenance_until=90_000.0,
        problems=[problem("robot", "silent", suppressed="maintenance")],
    ),
    robot("spare", up=False, silent_reason="never_seen", last_message=None),
)


# A shell starts background jobs with Ctrl-C ignored, and their children inherit that.
WATCH = """
import signal, sys
from ros_diagnostics_tools.main import main
signal.signal(signal.SIGINT, signal.default_int_handler)
sys.exit(main())
"""


@pytest.fixture
def show(serve, run, wide, in_utc):
    """Runs the command against a server with ``FLEET``; returns its output."""
    server = serve(fleet_snapshot=lambda: FLEET)
    return lambda *arguments: run("status", *arguments, at=server).out


def test_the_worst_robots_come_first_with_their_faults(show):
    text = show()
    order = [text.index(name) for name in ("robot_2", "robot_3", "robot_1", "spare")]
    assert order == sorted(order)
    shown = " ".join(text.split())
    assert (
        "SILENT robot_3 robot is silent suppressed: maintenance until 1970-01-02 01:00 00:16:40, "
        "1 min its publisher sends nothing (mute)"
    ) in shown
    assert ("CRITICAL robot_2 Motor 1 confirmed 00:16:40, 1 min Over temperature") in shown
    assert "OK robot_1 last message 0 s ago" in shown
    assert "PENDING spare never received" in shown
    assert "1 CRITICAL, 1 SILENT, 1 OK, 1 PENDING" in text


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
    found = json.loads(show(*arguments, "--output", "json"))
    assert {each["robot"] for each in found["robots"]} == shown
    text = show(*arguments)
    names = {each["robot"] for each in FLEET["robots"]}
    assert {name for name in names if name in text} == shown


def test_components_are_shown_with_message_and_values(show):
    text = " ".join(show("--component", "motor", "--robot", "robot_2").split())
    assert text.startswith("State Component")  # of one robot there is no column for it
    assert "CRITICAL Motor 1 confirmed 00:16:40, 1 min Over" in text
    assert text.endswith("robot_2 is CRITICAL")
    assert "Level=12.3 V" in text


@pytest.mark.usefixtures("wide")
def test_a_robots_text_cannot_control_the_terminal(serve, run):
    evil = "\x1b]0;\x07\x9b[bold]x"
    part = component(evil, "ERROR", message=evil, group=evil)
    given = fleet(robot(evil, part, problems=[broken(evil, group=evil, suppressed=evil)]))
    server = serve(fleet_snapshot=lambda: given)
    for more in ([], ["--component", ""], ["--output", "json"]):
        text = run("status", *more, at=server).out
        assert not set(text) & set("\x1b\x07\x9b")
        assert "[bold]" in "".join(text.split())


@pytest.mark.usefixtures("wide")
def test_of_many_problems_of_a_robot_the_worst_are_shown(serve, run):
    bad = [broken(f"Motor {n}") for n in range(20)]
    site = problem("site", "silent", site="hall", suppressed="restart")
    given = fleet(robot("a", problems=bad), robot("b"), problems=[site])
    server = serve(fleet_snapshot=lambda: given)
    text = run("status", at=server).out
    assert text.count("Motor ") == 5
    assert "and 15 more" in text
    assert "site hall" in text
    assert "suppressed: the exporter has just started" in text
    assert "site hall" not in run("status", "--robot", "a", at=server).out


NAMES = {
    "/Sensors/lidar:  Laser": "Laser",
    "/Base/left: Motor": "left: Motor",
    "/Base/right: Motor": "right: Motor",
    "/Front/Camera": "/Front/Camera",
    "/Rear/Camera": "/Rear/Camera",
}


def test_a_name_is_as_short_as_it_is_unique():
    parts = [
        component(path.rpartition("/")[2], "OK", group=path.rpartition("/")[0]) for path in NAMES
    ]

    assert short_names(robot("robot_3", *parts)) == NAMES


def test_a_fleet_that_is_well_has_no_empty_columns(serve, run, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    given = fleet(robot("robot_3", component("Motor 1", "OK")))
    lines = run("status", at=serve(fleet_snapshot=lambda: given)).out.splitlines()
    assert lines[0].split() == ["State", "Message"]
    assert lines[-1].strip().endswith(": robot_3 is OK")
    assert len(lines) == 4


def test_it_says_since_when_no_prometheus_reads_the_faults(serve, run, wide, in_utc):
    server = serve(fleet_snapshot=lambda: {**FLEET, "unread_since": 900.0})
    text = run("status", at=server).out
    assert "Prometheus has not read the faults since 00:15:00: nobody is notified" in text


def test_the_history_of_a_robot_has_relative_times_the_newest_last(serve, run, monkeypatch):
    monkeypatch.setattr(api, "PAGE_BYTES", 400)  # so that it takes several pages
    log, now = EventLog(), time.time()
    for ago, level in ((7_300, "WARN"), (600, "ERROR"), (130, "OK")):
        log.record(Event(now - ago, "level", "a", "/Motor", "Motor 1", "OK", level, "\x1b[hot"))
    log.record(Event(now - 50, "robot", "b", after="silent"))
    known = fleet(robot("turtlebot_1"))
    server = serve(find_events=log.find, fleet_snapshot=lambda: known)

    text = " ".join(run("history", "a", at=server).out.split())
    assert text.index("10 min") < text.index("2 min")
    assert r"/Motor/Motor 1 OK → ERROR: \x1b[hot" in text
    assert "WARN" not in text
    assert "silent" not in text
    found = json.loads(run("history", "a", "--since", "3h", "--output", "json", at=server).out)
    assert [each["after"] for each in found] == ["WARN", "ERROR", "OK"]
    for name, code, expected in (
        ("turtlebot_1", 0, "no event of robot 'turtlebot_1' since "),
        ("turtlebot1", 1, "no robot 'turtlebot1'; the nearest is 'turtlebot_1'"),
        ("xyz", 1, "no robot 'xyz'; ros-diagnostics status lists the robots"),
    ):
        said = run("history", name, "--since", "10m", at=server, code=code)
        assert expected in (said.err if code else said.out)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["history", "a", "--since", "soon"], "'soon' is no time; write it as 10m"),
        (["status", "--state", "bad"], "BAD: not one of CRITICAL, SILENT"),
        (["status", "--watch=0s"], "'0s' is not a duration"),
        (["status", "--watch=nan"], "'nan' is not a duration"),
        (["status", "--timeout=3"], "'3' is not a duration"),
    ],
)
def test_a_wrong_time_or_state_is_rejected(arguments, error, run):
    assert error in run(*arguments, code=2).err


def test_watch_continues_after_an_outage_until_ctrl_c(serve, tmp_path):
    looks = []

    def look():
        looks.append(1)
        if len(looks) == 2:
            raise RuntimeError
        return FLEET

    arguments = ["status", "--watch", "1100ms", "--url", url_of(serve(fleet_snapshot=look))]
    with subprocess.Popen([sys.executable, "-c", WATCH, *arguments], stdout=subprocess.PIPE) as it:
        try:
            wait_until(lambda: len(looks) >= 4)  # then the third, good again, was shown
            it.send_signal(signal.SIGINT)
            out, _ = it.communicate(timeout=20)
        finally:
            it.kill()
    assert it.returncode == 130
    assert b"robot_2" in out
