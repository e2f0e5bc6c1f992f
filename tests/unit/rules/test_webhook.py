"""The example of a webhook receiver gets the requests of Alertmanager."""

import json
import sys
import urllib.error
import urllib.request
from collections.abc import Callable
from typing import Any

from support.shipped_rules import ALERTMANAGER
from testbed.polling import until


def _post(address: str, body: bytes) -> int:
    try:
        with urllib.request.urlopen(f"http://{address}/", body, timeout=10) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        error.close()
        return error.code
    except OSError:
        return 0


def test_each_alert_is_one_line(free_port: Callable[[], int], start_process: Callable[..., Any]):
    address = f"127.0.0.1:{free_port()}"
    script = ALERTMANAGER / "examples" / "webhook_receiver.py"
    receiver = start_process("webhook", [sys.executable, script, address])
    until(lambda: _post(address, b"no JSON") == 400, "the receiver answers", 20)
    assert _post(address, b'{"alerts": [{}]}') == 400
    labels = {"alertname": "DiskFull", "fleet": "f", "robot": "r1", "component": "Motor 1"}
    alert = {"status": "firing", "labels": labels}
    message = {"version": "4", "status": "firing", "alerts": [alert]}
    assert _post(address, json.dumps(message).encode()) == 204

    line = "firing DiskFull fleet='f' robot='r1' component='Motor 1'"
    until(lambda: line in receiver.output(), "the line in the log", 10)
