"""Text messages sent by Alertmanager's sns_configs to moto's server instead of Amazon SNS."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml

from support.alerts import post_alerts
from support.sns import sent, with_text_messages
from testbed import http
from testbed.configuration import CHECKOUT
from testbed.polling import until
from testbed.programs import alertmanager


@pytest.fixture
def post(
    tmp_path: Path, sns_server: str, free_port: Callable[[], int], start_process: Callable[..., Any]
) -> Callable[..., None]:
    """Sends an alert to an Alertmanager with the shipped route for text messages enabled."""
    shutil.copytree(CHECKOUT / "alertmanager", tmp_path / "alertmanager")
    path = tmp_path / "alertmanager" / "alertmanager.yml"
    path.write_text(yaml.safe_dump(with_text_messages(sns_server)))
    address = f"127.0.0.1:{free_port()}"
    start_process("alertmanager", alertmanager(path, address, tmp_path / "data"))
    until(lambda: http.answers(address, "/-/ready"), "Alertmanager is ready", 30)

    return partial(post_alerts, address)


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
