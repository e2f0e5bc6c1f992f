"""The example of a webhook receiver gets the requests of Alertmanager."""

from __future__ import annotations

import json
import sys
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import Any

import pytest

from support.shipped_rules import ALERTMANAGER
from testbed.polling import until

MESSAGE = {
    "version": "4",
    "status": "firing",
    "alerts": [
        {
            "status": "firing",
            "labels": {
                "alertname": "RosDiagnosticsComponentCritical",
                "fleet": "f",
                "robot": "r1",
                "component": "Motor 1",
                "severity": "critical",
            },
        }
    ],
}


@pytest.fixture
def receiver(free_port: Callable[[], int], start_process: Callable[..., Any]) -> Any:
    """The running program, with its address in `.address`."""
    address = f"127.0.0.1:{free_port()}"
    script = ALERTMANAGER / "examples" / "webhook_receiver.py"
    process = start_process("webhook", [sys.executable, script, address])
    process.address = address
    until(lambda: _post(address, b"no JSON") == 400, "the receiver answers", 20)
    return process


def _post(address: str, body: bytes) -> int:
    try:
        with urllib.request.urlopen(f"http://{address}/", body, timeout=10) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        error.close()
        return error.code
    except OSError:
        return 0


def test_each_alert_is_one_line(receiver):
    assert _post(receiver.address, json.dumps(MESSAGE).encode()) == 204

    line = "firing RosDiagnosticsComponentCritical fleet='f' robot='r1' component='Motor 1'"
    until(lambda: line in receiver.output(), "the line in the log", 10)


def test_an_invalid_message_is_rejected(receiver):
    assert _post(receiver.address, b'{"alerts": [{}]}') == 400
