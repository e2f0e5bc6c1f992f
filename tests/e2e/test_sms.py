"""Text messages by Alertmanager's own sns_configs; Amazon's part is played by moto's server."""

from __future__ import annotations

import json
import shutil
import sys
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from fleet_demo import asking
from fleet_demo.programs import alertmanager
from fleet_demo.site import CHECKOUT
from fleet_demo.waiting import until

COMMENTED = """\
    # - matchers: [severity = critical]
    #   receiver: sms
    #   continue: true
"""


@pytest.fixture
def amazon(free_port: Callable[[], int], start_process: Callable[..., Any]) -> str:
    """The address of a server that takes text messages as Amazon SNS does."""
    port = free_port()
    argv = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    start_process("moto", argv)
    address = f"127.0.0.1:{port}"
    until(lambda: asking.answers(address, "/moto-api/data.json"), "moto's server answers", 60)
    return address


@pytest.fixture
def tell(
    tmp_path: Path, amazon: str, free_port: Callable[[], int], start_process: Callable[..., Any]
) -> Callable[..., None]:
    """Hands an alert to an Alertmanager with the shipped route for text messages switched on."""
    shutil.copytree(CHECKOUT / "alertmanager", tmp_path / "alertmanager")
    path = tmp_path / "alertmanager" / "alertmanager.yml"
    text = path.read_text()
    assert COMMENTED in text
    config = yaml.safe_load(text.replace(COMMENTED, COMMENTED.replace("# ", "")))
    [receiver] = [each for each in config["receivers"] if each["name"] == "sms"]
    [sns] = receiver["sns_configs"]
    sns["api_url"] = f"http://{amazon}"
    sns["sigv4"] = {"region": "eu-central-1", "access_key": "any", "secret_key": "any"}
    path.write_text(yaml.safe_dump(config))
    address = f"127.0.0.1:{free_port()}"
    start_process("alertmanager", alertmanager(path, address, tmp_path / "data"))
    until(lambda: asking.answers(address, "/-/ready"), "Alertmanager is ready", 30)

    def post(alert: dict[str, Any]) -> None:
        body = json.dumps([alert]).encode()
        header = {"Content-Type": "application/json"}
        request = urllib.request.Request(f"http://{address}/api/v2/alerts", body, header)
        urllib.request.urlopen(request, timeout=10).close()

    return post


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

    def messages() -> list[str]:
        sent = asking.get_json(amazon, "/moto-api/data.json").get("sns", {}).get("SMS", [])
        return [each["message"] if isinstance(each, dict) else str(each) for each in sent]

    tell(alert)
    until(lambda: len(messages()) == 1, lambda: f"one text message: {messages()}", 60)
    tell({**alert, "endsAt": "2026-01-01T00:00:00Z"})
    until(lambda: len(messages()) == 2, lambda: f"two text messages: {messages()}", 60)

    problem, recovery = messages()
    assert "PROBLEM demo: Motor 1 of robot_1 is CRITICAL. winding at 131 C" in problem
    assert "RECOVERY demo: Motor 1 of robot_1" in recovery
