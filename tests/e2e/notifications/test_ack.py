"""The acknowledgement command against a real Alertmanager; alerts are as the rules make them."""

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from ros_diagnostics_tools.main import main
from support.alerts import fault, post_alerts
from testbed.http import get_json
from testbed.polling import until
from testbed.site import Site

SINCE = "2026-01-01 10:00:00 +0000 UTC"
NAME = "RosDiagnosticsUnacknowledged"
Running = tuple[Callable[..., None], Callable[[str], list[dict[str, str]]], Callable[..., None]]


def motor(state: str = "critical", since: str = SINCE, **labels: str) -> dict[str, Any]:
    return {**fault("Motor 1", state, **labels), "annotations": {"evidence": f"since {since}"}}


def escalation(step: str = "1", since: str = SINCE) -> dict[str, Any]:
    alert = motor(since=since, alertname=NAME, step=step)
    alert["labels"]["since"] = since
    return alert


@pytest.fixture
def running(site: Site) -> Running:
    """Functions: send alerts; the labels of those in a state; acknowledge the motor of r1."""
    site.start_alertmanager()
    site.wait_until_ready()
    address = site.addresses.alertmanager

    def having(state: str) -> list[dict[str, str]]:
        found = get_json(address, "/api/v2/alerts")
        return [each["labels"] for each in found if each["status"]["state"] == state]

    def ack() -> None:
        who = ("--author", "ann", "--comment", "on it", "--alertmanager", f"http://{address}")
        assert main(["ack", "r1", "Motor 1", *who]) == 0

    return partial(post_alerts, address), having, ack


def test_ack_silences_the_escalation_of_this_fault_only(running: Running):
    post, having, ack = running
    post(motor())
    ack()
    post(escalation(), escalation(since="2026-01-02 10:00:00 +0000 UTC"))
    until(lambda: len(having("active")) == 2, "the fault, and the escalation of another time", 20)
    assert [each["since"] for each in having("suppressed")] == [SINCE]


def test_ack_silences_the_next_steps_and_not_the_end_of_one_that_was_sent(running: Running):
    post, having, ack = running
    post(motor(), escalation("1"))
    until(lambda: len(having("active")) == 2, "the first step is sent", 20)
    ack()
    post(*map(escalation, "120"))

    def silenced() -> set[str]:
        return {each["step"] for each in having("suppressed")}

    until(lambda: silenced() == {"2", "0"}, lambda: f"{silenced()}", 20)


def test_an_acknowledged_warning_that_turns_critical_escalates(running: Running):
    post, having, ack = running
    post(motor("warning"))
    ack()
    post(motor(), escalation())
    names = {"RosDiagnosticsComponentCritical", NAME}
    until(lambda: {each["alertname"] for each in having("active")} >= names, "both are active", 20)
