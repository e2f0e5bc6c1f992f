"""The acknowledgement command against a real Alertmanager; alerts are as the rules make them."""

from __future__ import annotations

import json
import shutil
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from ros_diagnostics_exporter.cli.ack import main
from support.alerts import hand
from testbed.configuration import CHECKOUT
from testbed.http import answers
from testbed.polling import until
from testbed.programs import alertmanager

MOTOR = {"fleet": "f", "robot": "r1", "group": "/Motor", "component": "Motor 1"}
SINCE = "2026-01-01 10:00:00 +0000 UTC"


def fault(name: str, since: str = SINCE, **labels: str) -> dict[str, Any]:
    return {
        "labels": {"alertname": f"RosDiagnostics{name}", **labels},
        "annotations": {"since": since},
    }


def escalation(since: str = SINCE, of: str = "component", **labels: str) -> dict[str, Any]:
    return {
        "labels": {
            "alertname": "RosDiagnosticsUnacknowledged",
            "since": since,
            "of": of,
            "step": "1",
            **labels,
        }
    }


class Alertmanager:
    """One that runs with the shipped configuration."""

    def __init__(self, address: str) -> None:
        self.url = f"http://{address}"

    def tell(self, *alerts: dict[str, Any]) -> None:
        """Hand alerts over as Prometheus does."""
        hand(self.url.removeprefix("http://"), *alerts)

    def states(self) -> dict[str, str]:
        """What Alertmanager makes of each alert, by its name: unprocessed, active, suppressed."""
        with urllib.request.urlopen(f"{self.url}/api/v2/alerts", timeout=10) as answer:
            alerts = json.load(answer)
        return {alert["labels"]["alertname"]: alert["status"]["state"] for alert in alerts}

    def suppressed(self) -> set[tuple[str, str]]:
        """Name and since of all alerts that a silence holds."""
        with urllib.request.urlopen(f"{self.url}/api/v2/alerts", timeout=10) as answer:
            alerts = json.load(answer)
        return {
            (alert["labels"]["alertname"], alert["labels"].get("since", ""))
            for alert in alerts
            if alert["status"]["silencedBy"]
        }


@pytest.fixture
def running(
    tmp_path: Path, free_port: Callable[[], int], start_process: Callable[..., Any]
) -> Alertmanager:
    shutil.copytree(CHECKOUT / "alertmanager", tmp_path / "alertmanager")
    address = f"127.0.0.1:{free_port()}"
    config = tmp_path / "alertmanager" / "alertmanager.yml"
    start_process("alertmanager", alertmanager(config, address, tmp_path / "data"))
    until(lambda: answers(address, "/-/ready"), "Alertmanager is ready", 30)
    return Alertmanager(address)


@pytest.fixture
def ack(running: Alertmanager, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs the command; returns what it printed."""

    def run(*arguments: str, code: int = 0) -> str:
        assert main([*arguments, "--url", running.url, "--author", "ann"]) == code
        said = capsys.readouterr()
        return said.out + said.err

    return run


def test_it_holds_this_faults_escalation_and_nothing_else(running, ack):
    running.tell(
        fault("ComponentCritical", state="critical", **MOTOR),
        escalation(state="critical", **MOTOR),
        escalation("2026-01-02 10:00:00 +0000 UTC", state="critical", **MOTOR),
    )

    assert "acknowledged: f/r1 Motor 1 CRITICAL" in ack("r1", "Motor 1", "--comment", "on it")

    held = {("RosDiagnosticsUnacknowledged", SINCE)}
    until(lambda: running.suppressed() == held, "only the escalation of this fault is held", 10)


def test_it_holds_reminders_of_a_warning_too(running, ack):
    warning = {"state": "warning", **MOTOR}
    running.tell(fault("ComponentWarning", **warning), escalation(step="0", **warning))
    ack("r1", "Motor 1", "--comment", "will look tomorrow")

    expected = {
        "RosDiagnosticsComponentWarning": "active",
        "RosDiagnosticsUnacknowledged": "suppressed",
    }
    until(lambda: running.states() == expected, lambda: f"{running.states()}", 20)


def test_an_acknowledged_warning_that_turns_critical_escalates(running, ack):
    running.tell(fault("ComponentWarning", state="warning", **MOTOR))
    ack("r1", "--comment", "will look tomorrow")
    running.tell(
        fault("ComponentCritical", state="critical", **MOTOR),
        escalation(state="critical", **MOTOR),
    )

    name = "RosDiagnosticsUnacknowledged"
    until(lambda: running.states().get(name) == "active", "the escalation is told", 10)


def test_a_silent_robots_acknowledgement_leaves_its_components_alone(running, ack):
    running.tell(
        fault("RobotSilent", fleet="f", robot="r1"),
        escalation(of="robot", fleet="f", robot="r1"),
        escalation(state="critical", **MOTOR),
    )
    ack("r1", "--comment", "carried to the workshop")

    held = {("RosDiagnosticsUnacknowledged", SINCE)}
    until(lambda: running.suppressed() == held, "the robot's escalation is held", 10)
    assert "workshop" in ack("--list")


def test_the_list_says_who_takes_care(running, ack):
    running.tell(
        fault("ComponentCritical", state="critical", **MOTOR),
        fault("RobotSilent", fleet="f", robot="r2"),
    )
    ack("r1", "--comment", "spare part ordered")

    listed = ack("--list")
    [first, second] = [line for line in listed.splitlines() if "2026" in line]

    assert first.split()[:3] == ["r1", "Motor", "1"]
    assert "ann" in first
    assert "spare part ordered" in first
    assert "nobody" in second
    assert "already" in ack("r1", "--comment", "again")


def test_what_is_not_faulty_cannot_be_acknowledged(running, ack):
    running.tell(fault("RobotSilent", fleet="f", robot="r2"))

    assert "no alert is firing for 'r1'; there are alerts for f/r2" in ack(
        "r1", "--comment", "x", code=1
    )
