"""What docs/receivers.md shows, on a real Alertmanager that posts to a server of this test."""

from __future__ import annotations

import json
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest

from support.alerts import post_alerts
from support.receivers_page import documented, written
from testbed.http import answers
from testbed.polling import until
from testbed.processes import Process
from testbed.programs import alertmanager

# Where each service is: the key of its address.
ADDRESSES = {
    "pagerduty": "url",
    "opsgenie": "api_url",
    "slack": "api_url",
    "telegram": "api_url",
    "own": "url",
}
FAULT = {
    "labels": {
        "alertname": "RosDiagnosticsComponentCritical",
        "fleet": "f",
        "robot": "r1",
        "component": "Motor 1",
        "scope": "component",
        "state": "critical",
        "severity": "critical",
        "fault": "a",
    },
    "annotations": {"summary": "Motor 1 of r1 is CRITICAL.", "evidence": "over current"},
}


class Services:
    """What was posted to each service, by the first part of the path."""

    def __init__(self, address: str) -> None:
        self.posted: defaultdict[str, list[str]] = defaultdict(list)
        posted = self.posted

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers["Content-Length"])).decode()
                posted[self.path.split("/")[1].partition("?")[0]].append(f"{self.path} {body}")
                answer = json.dumps({"ok": True, "result": {"chat": {"id": 1}}}).encode()
                self.send_response(202 if "pagerduty" in self.path else 200)
                self.send_header("Content-Length", str(len(answer)))
                self.end_headers()
                self.wfile.write(answer)

            def log_message(self, *_: object) -> None:
                """Say nothing of every post."""

        host, _, port = address.partition(":")
        self._server = ThreadingHTTPServer((host, int(port)), Handler)
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.05,))
        self._thread.start()

    def stop(self) -> None:
        """Stop listening."""
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


@pytest.fixture
def services(free_port: Callable[[], int]) -> Iterator[tuple[str, Services]]:
    address = f"127.0.0.1:{free_port()}"
    found = Services(address)
    yield f"http://{address}", found
    found.stop()


def pointed_at(url: str, folder: Path) -> list[dict[str, Any]]:
    """The receivers of the page, with keys, and each at a path of its own below the address."""
    (folder / "key").write_text("secret")
    receivers = documented()
    for receiver in receivers:
        [[config]] = [configs for key, configs in receiver.items() if key != "name"]
        for key in [each for each in config if each.endswith("_file")]:
            config[key] = str(folder / "key")
        config.pop("api_url_file", None)
        config[ADDRESSES[receiver["name"]]] = f"{url}/{receiver['name']}/"
    return receivers


def test_a_problem_and_its_recovery_are_sent_by_each_service(
    tmp_path: Path,
    free_port: Callable[[], int],
    start_process: Callable[..., Process],
    services: tuple[str, Services],
) -> None:
    url, found = services
    address = f"127.0.0.1:{free_port()}"
    file = written(tmp_path, pointed_at(url, tmp_path))
    start_process("alertmanager", alertmanager(file, address, tmp_path / "data"))
    until(lambda: answers(address, "/-/ready"), "Alertmanager is ready", 30)

    post_alerts(address, FAULT)
    until(lambda: set(found.posted) == set(ADDRESSES), "all services have the problem", 60)
    problems = {name: posts[0] for name, posts in found.posted.items()}
    post_alerts(address, FAULT, resolved=True)
    until(lambda: all(len(posts) > 1 for posts in found.posted.values()), "and the recovery", 60)

    assert all("over current" in problem for problem in problems.values())
    named = {"pagerduty": "resolve", "opsgenie": "/close", "own": '"resolved"'}
    for name, posts in found.posted.items():
        assert named.get(name, "RECOVERY") in posts[-1], name
