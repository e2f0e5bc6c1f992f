"""Text messages sent by Alertmanager's sns_configs to moto's server instead of Amazon SNS."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest

from support.alerts import post_alerts
from support.sns import sent, with_text_messages
from testbed.polling import until
from testbed.site import Site


@pytest.fixture
def post(site: Site, sns_server: str) -> Callable[..., None]:
    """Sends an alert to an Alertmanager with the shipped route for text messages enabled."""
    site.start_alertmanager(edit=lambda it: it.update(with_text_messages(sns_server)))
    site.wait_until_ready()
    return partial(post_alerts, site.addresses.alertmanager)


def test_a_critical_and_its_recovery_are_sent_as_text_messages(post, sns_server):
    alert = {
        "labels": {
            "alertname": "RosDiagnosticsComponentCritical",
            "severity": "critical",
            "fleet": "demo",
            "robot": "robot_1",
            "component": "Motor 1",
            "scope": "component",
            "state": "critical",
        },
        "annotations": {
            "summary": "Motor 1 of robot_1 is CRITICAL.",
            "evidence": "winding at 131 C " * 20,
        },
    }

    post(alert)
    until(lambda: len(sent(sns_server)) == 1, lambda: f"one text message: {sent(sns_server)}", 60)
    post(alert, resolved=True)
    until(lambda: len(sent(sns_server)) == 2, lambda: f"two text messages: {sent(sns_server)}", 60)

    problem, recovery = sent(sns_server)
    assert problem.startswith("PROBLEM demo: Motor 1 of robot_1 is CRITICAL. winding at 131 C")
    assert recovery.startswith(
        "RECOVERY demo: Motor 1 of robot_1 is no longer CRITICAL. It lasted "
    )
