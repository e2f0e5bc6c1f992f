"""The acknowledgement command against a real Alertmanager; alerts are as the rules make them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from ros_diagnostics_tools.main import main
from support.alerts import post_alerts
from testbed.http import get_json
from testbed.polling import until
from testbed.site import Site

# As the rules make them: a fault's alert and its escalation have the labels of the fault.
MOTOR = {
    "fleet": "f",
    "scope": "component",
    "robot": "r1",
    "group": "/Motor",
    "component": "Motor 1",
}
CRITICAL = {**MOTOR, "state": "critical", "severity": "critical", "team": "blue"}
WARNING = {**MOTOR, "state": "warning", "severity": "warning", "team": "blue"}
SILENT = {"fleet": "f", "scope": "robot", "state": "silent", "severity": "critical"}
SINCE = "2026-01-01 10:00:00 +0000 UTC"


def fault(name: str, since: str = SINCE, **labels: str) -> dict[str, Any]:
    return {
        "labels": {"alertname": f"RosDiagnostics{name}", **labels},
        "annotations": {"since": since},
    }


def escalation(since: str = SINCE, **labels: str) -> dict[str, Any]:
    return {
        "labels": {
            "alertname": "RosDiagnosticsUnacknowledged",
            "since": since,
            "step": "1",
            **labels,
        },
        "annotations": {"since": since},
    }


class Alertmanager:
    """A running Alertmanager with the shipped configuration."""

    def __init__(self, address: str) -> None:
        self.url = f"http://{address}"
        self.post = partial(post_alerts, address)

    def _alerts(self) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = get_json(self.url.removeprefix("http://"), "/api/v2/alerts")
        return found

    def states(self) -> dict[str, str]:
        """The state of each alert by its name: unprocessed, active, suppressed."""
        return {each["labels"]["alertname"]: each["status"]["state"] for each in self._alerts()}

    def silenced(self) -> list[dict[str, str]]:
        """The labels of all alerts that are silenced."""
        return [each["labels"] for each in self._alerts() if each["status"]["silencedBy"]]

    def suppressed(self) -> set[tuple[str, str]]:
        """Name and since of all alerts that are silenced."""
        return {(each["alertname"], each.get("since", "")) for each in self.silenced()}


@pytest.fixture
def running(site: Site) -> Alertmanager:
    site.start_alertmanager()
    site.wait_until_ready()
    return Alertmanager(site.addresses.alertmanager)


@pytest.fixture
def ack(running: Alertmanager, capsys: pytest.CaptureFixture[str]) -> Callable[..., str]:
    """Runs the command; returns what it printed."""

    def run(*arguments: str, code: int = 0) -> str:
        assert main(["ack", *arguments, "--alertmanager", running.url, "--author", "ann"]) == code
        printed = capsys.readouterr()
        return printed.out + printed.err

    return run


def test_ack_silences_the_escalation_of_this_fault_only(running, ack):
    running.post(fault("ComponentCritical", **CRITICAL))

    assert "acknowledged: f/r1 Motor 1 CRITICAL" in ack("r1", "Motor 1", "--comment", "on it")

    running.post(
        escalation(**CRITICAL),
        escalation("2026-01-02 10:00:00 +0000 UTC", **CRITICAL),
    )
    silenced = {("RosDiagnosticsUnacknowledged", SINCE)}
    until(
        lambda: running.suppressed() == silenced,
        "only the escalation of this fault is silenced",
        10,
    )


def test_ack_silences_the_next_steps_and_not_the_end_of_one_that_was_sent(running, ack):
    running.post(fault("ComponentCritical", **CRITICAL), escalation(step="1", **CRITICAL))
    until(
        lambda: running.states().get("RosDiagnosticsUnacknowledged") == "active",
        "the first step is sent",
        20,
    )
    ack("r1", "Motor 1", "--comment", "on it")
    running.post(*(escalation(step=step, **CRITICAL) for step in "120"))

    until(
        lambda: {each["step"] for each in running.silenced()} == {"2", "0"},
        lambda: f"{running.silenced()}",
        20,
    )
    assert "ann" in ack("--list")


def test_ack_silences_reminders_of_a_warning(running, ack):
    running.post(fault("ComponentWarning", **WARNING), escalation(step="0", **WARNING))
    ack("r1", "Motor 1", "--comment", "will look tomorrow")

    expected = {
        "RosDiagnosticsComponentWarning": "active",
        "RosDiagnosticsUnacknowledged": "suppressed",
    }
    until(lambda: running.states() == expected, lambda: f"{running.states()}", 20)


def test_an_acknowledged_warning_that_turns_critical_escalates(running, ack):
    running.post(fault("ComponentWarning", **WARNING))
    ack("r1", "--comment", "will look tomorrow")
    running.post(
        fault("ComponentCritical", **CRITICAL),
        escalation(**CRITICAL),
    )

    name = "RosDiagnosticsUnacknowledged"
    until(lambda: running.states().get(name) == "active", "the escalation is active", 10)


def test_acknowledging_a_silent_robot_does_not_acknowledge_its_components(running, ack):
    running.post(fault("RobotSilent", robot="r1", **SILENT))
    ack("r1", "--comment", "carried to the workshop")
    running.post(escalation(robot="r1", **SILENT), escalation(**CRITICAL))

    silenced = {("RosDiagnosticsUnacknowledged", SINCE)}
    until(lambda: running.suppressed() == silenced, "the robot's escalation is silenced", 10)
    assert "workshop" in ack("--list")


def test_the_list_names_author_and_comment(running, ack):
    running.post(
        fault("ComponentCritical", **CRITICAL),
        fault("RobotSilent", robot="r2", **SILENT),
    )
    ack("r1", "--comment", "spare part ordered")

    listed = ack("--list")
    [first, second] = [line for line in listed.splitlines() if "2026" in line]

    assert first.split()[:4] == ["f", "r1", "Motor", "1"]
    assert "ann" in first
    assert "spare part ordered" in first
    assert "nobody" in second
    assert "already" in ack("r1", "--comment", "again")


def test_what_is_not_faulty_cannot_be_acknowledged(running, ack):
    running.post(fault("RobotSilent", robot="r2", **SILENT))

    assert "no alert is firing for 'r1'; there are alerts for f/r2 SILENT" in ack(
        "r1", "--comment", "x", code=1
    )


def test_what_has_no_robot_is_acknowledged_by_its_own_name(running, ack):
    site = {**SILENT, "scope": "site", "site": "hall"}
    down = {"fleet": "f", "exporter": "berlin", "severity": "critical"}
    name = "RosDiagnosticsExporterDown"
    running.post(fault("FleetPartDown", **site), fault("ExporterDown", **down))
    ack("--site", "hall", "--comment", "the switch")
    ack("--alert", "ExporterDown", "--comment", "the server is being moved")
    running.post(
        escalation(**site),
        escalation(**(site | {"site": "yard"})),
        escalation("", of=name, **down),
        escalation("", of="RosDiagnosticsScrapeFailing", **down),
    )

    until(lambda: len(running.silenced()) == 2, "two escalations are silenced", 10)
    assert {each.get("site", each.get("of")) for each in running.silenced()} == {"hall", name}
