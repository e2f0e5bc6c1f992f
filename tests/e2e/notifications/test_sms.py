"""Text messages by Alertmanager's own sns_configs; Amazon's part is played by moto's server."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml

from support.alerts import hand
from support.sns import sent, with_text_messages
from testbed import http as asking
from testbed.configuration import CHECKOUT
from testbed.polling import until
from testbed.programs import alertmanager


@pytest.fixture
def tell(
    tmp_path: Path, amazon: str, free_port: Callable[[], int], start_process: Callable[..., Any]
) -> Callable[..., None]:
    """Hands an alert to an Alertmanager with the shipped route for text messages switched on."""
    shutil.copytree(CHECKOUT / "alertmanager", tmp_path / "alertmanager")
    path = tmp_path / "alertmanager" / "alertmanager.yml"
    path.write_text(yaml.safe_dump(with_text_messages(amazon)))
    address = f"127.0.0.1:{free_port()}"
    start_process("alertmanager", alertmanager(path, address, tmp_path / "data"))
    until(lambda: asking.answers(address, "/-/ready"), "Alertmanager is ready", 30)

    return partial(hand, address)


def test_a_critical_is_told_by_text_message_and_so_is_its_recovery(tell, amazon):
    alert = {
        "labels": {
            "alertname": "RosDiagnosticsComponentCritical",
            "severity": "critical",
            "fleet": "demo",
            "robot": "robot_1",
            "component": "Motor 1",
        },
        "annotations": {
            "summary": "Motor 1 of robot_1 is CRITICAL.",
            "driver_message": "winding at 131 C " * 20,
        },
    }

    tell(alert)
    until(lambda: len(sent(amazon)) == 1, lambda: f"one text message: {sent(amazon)}", 60)
    tell(alert, over=True)
    until(lambda: len(sent(amazon)) == 2, lambda: f"two text messages: {sent(amazon)}", 60)

    problem, recovery = sent(amazon)
    assert problem.startswith("PROBLEM demo: Motor 1 of robot_1 is CRITICAL. winding at 131 C")
    assert recovery.startswith("RECOVERY demo: no longer: Motor 1 of robot_1 is CRITICAL.")
