"""A downtime from the command through Alertmanager and exporter to page, commands and mail."""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from ros_diagnostics_tools.main import main
from testbed import http
from testbed.configuration import Clocks
from testbed.polling import until
from testbed.site import Site
from testbed.stack import Plan, running

pytestmark = pytest.mark.slow

MOTORS = ("Motor 1", "Motor 2")
REASON = "(ann: new gears)"


@pytest.fixture
def stack(tmp_path: Path) -> Iterator[Site]:
    with running(tmp_path, Plan(robots=1, clocks=Clocks(confirm_after=2))) as stack:
        yield stack


def run(stack: Site, *arguments: str) -> int:
    urls = ["--alertmanager", f"http://{stack.addresses.alertmanager}"]
    urls += ["--url", f"http://{stack.addresses.exporter}"]
    return main(["downtime", *arguments, "--author", "ann", *urls])


def standings(stack: Site) -> dict[str, tuple[bool, str | None]]:
    """Of each component with a problem whether it is confirmed, and why it is suppressed."""
    (robot,) = http.get_json(stack.addresses.exporter, "/api/v1/fleet")["robots"]
    return {
        each["component"]: (each["confirmed"] is not None, each["suppressed"])
        for each in robot["problems"]
        if each["state"] == "critical"
    }


def test_a_component_in_a_downtime_is_suppressed_and_everybody_can_see_why(
    stack: Site, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    subjects = stack.inbox.subjects
    monkeypatch.setenv("COLUMNS", "200")
    plan = ("robot_1", "Motor 1", "1h", "--comment", "new gears")
    assert run(stack, *plan) == 0, capsys.readouterr().err
    for motor in MOTORS:
        stack.fault("robot_1", motor, "error")

    other = "** PROBLEM ** demo/robot_1 Motor 2 is CRITICAL"
    until(lambda: subjects() == [other], lambda: str(subjects()), 60)
    assert standings(stack) == {"Motor 1": (False, "maintenance"), "Motor 2": (True, None)}

    url = f"http://{stack.addresses.exporter}"
    capsys.readouterr()
    assert main(["status", "--url", url]) == 0
    assert REASON in capsys.readouterr().out
    assert main(["why", "robot_1", "Motor 1", "--url", url]) == 0
    text = capsys.readouterr().out
    assert "suppressed: maintenance until" in text
    assert REASON in text
    assert REASON in http.get(stack.addresses.exporter, "/robots/robot_1").decode()
    assert run(stack, "--list") == 0
    assert "new gears" in capsys.readouterr().out

    assert run(stack, "--cancel", "robot_1", "Motor 1") == 0
    its = "** PROBLEM ** demo/robot_1 Motor 1 is CRITICAL"
    until(lambda: subjects() == [other, its], lambda: str(subjects()), 60)

    assert run(stack, "robot_1", "1h", "--comment", "new wheels") == 0
    began = "** MAINTENANCE ** demo downtime new wheels of robot_1 began"
    until(lambda: subjects() == [other, its, began], lambda: str(subjects()), 60)
    [robot] = http.get_json(stack.addresses.exporter, "/api/v1/fleet")["robots"]
    [planned] = robot["downtimes"]
    at = time.strftime("%Y-%m-%d %H:%M:%S UTC", time.gmtime(planned["until"]))
    assert f", until {at}." in stack.inbox.mails()[-1].text
