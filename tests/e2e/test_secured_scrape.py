"""A real Prometheus scrapes the real exporter over TLS with basic auth, and uses its discovery."""

from __future__ import annotations

import base64
import json
import ssl
import subprocess
import sys
import urllib.parse
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import bcrypt
import pytest
import trustme

from testbed import domains, ports
from testbed.polling import until
from testbed.processes import Process

pytestmark = pytest.mark.e2e

BIN = Path(sys.executable).parent
PASSWORD = "correct horse"

FLEET = """
fleet: hall
robots:
  - name: robot_1
    namespace: /robot_1
    domain_id: {domain}
    address: 127.0.0.1
    labels: {{site: north}}
  - {{name: robot_2, namespace: /robot_2, domain_id: {domain}}}
"""
PROMETHEUS = """
global: {{scrape_interval: 1s}}
scrape_configs:
  - job_name: right
    honor_labels: true
    scheme: https
    tls_config: {{ca_file: ca.crt}}
    basic_auth: {{username: prometheus, password_file: password}}
    static_configs: [{{targets: ["{exporter}"], labels: {{fleet: hall}}}}]
  - job_name: wrong_password
    scheme: https
    tls_config: {{ca_file: ca.crt}}
    basic_auth: {{username: prometheus, password: guessed}}
    static_configs: [{{targets: ["{exporter}"]}}]
  - job_name: wrong_ca
    scheme: https
    basic_auth: {{username: prometheus, password_file: password}}
    static_configs: [{{targets: ["{exporter}"]}}]
  - job_name: node
    http_sd_configs:
      - url: https://{exporter}/sd/node
        refresh_interval: 1s
        tls_config: {{ca_file: ca.crt}}
        basic_auth: {{username: prometheus, password_file: password}}
"""


@pytest.fixture
def secured(tmp_path: Path) -> Iterator[tuple[Callable[[str], Any], str]]:
    """A function that queries Prometheus' API, and the address of the exporter."""
    exporter, prometheus = (f"127.0.0.1:{ports.free_port()}" for _ in range(2))
    write_secrets(tmp_path)
    (tmp_path / "prometheus.yml").write_text(PROMETHEUS.format(exporter=exporter))
    with domains.lease() as domain:
        (tmp_path / "fleet.yml").write_text(FLEET.format(domain=domain))
        commands = {
            "robots": [BIN / "virtual-robots", "--robots", "2", "--domain-id", str(domain)],
            "exporter": [
                *(BIN / "ros-diagnostics-exporter", "--config.file", tmp_path / "fleet.yml"),
                *("--web.listen-address", exporter, "--web.config.file", tmp_path / "web.yml"),
                *("--storage.path", tmp_path / "exporter.db"),
            ],
            "prometheus": [
                *("prometheus", f"--config.file={tmp_path}/prometheus.yml"),
                *(f"--storage.tsdb.path={tmp_path}/data", f"--web.listen-address={prometheus}"),
            ],
        }
        running = [
            Process(name, command, domains.environment(domain), tmp_path / f"{name}.log")
            for name, command in commands.items()
        ]
        try:
            for each in running:
                each.start()
            running[2].wait_for_output("Server is ready to receive web requests")
            yield lambda path: get_json(prometheus, path), exporter
        finally:
            for each in reversed(running):
                each.stop()


def write_secrets(folder: Path) -> None:
    """A web config with TLS and one user, and the files that Prometheus needs."""
    ca = trustme.CA()
    issued = ca.issue_cert("127.0.0.1")
    ca.cert_pem.write_to_path(folder / "ca.crt")
    issued.private_key_pem.write_to_path(folder / "server.key")
    issued.cert_chain_pems[0].write_to_path(folder / "server.crt")
    (folder / "password").write_text(PASSWORD)
    hashed = bcrypt.hashpw(PASSWORD.encode(), bcrypt.gensalt(10)).decode()
    (folder / "web.yml").write_text(
        "tls_server_config: {cert_file: server.crt, key_file: server.key, min_version: TLS13}\n"
        f"basic_auth_users: {{prometheus: {hashed}}}\n"
    )


def get_json(server: str, path: str) -> Any:
    with urllib.request.urlopen(f"http://{server}{path}", timeout=20) as answer:
        return json.load(answer)["data"]


def test_prometheus_scrapes_over_tls_with_basic_auth_and_finds_the_robots(secured, tmp_path):
    prometheus, exporter = secured

    def value(query: str) -> dict[str, float]:
        found = prometheus("/api/v1/query?" + urllib.parse.urlencode({"query": query}))["result"]
        return {
            each["metric"].get("robot") or each["metric"].get("job", ""): float(each["value"][1])
            for each in found
        }

    def why() -> str:
        return json.dumps(prometheus("/api/v1/targets"), indent=1)[-4000:]

    until(
        lambda: value("ros_diagnostics_robot_up") == {"robot_1": 1, "robot_2": 1},
        why,
    )
    expected = {"right": 1, "wrong_password": 0, "wrong_ca": 0}
    until(lambda: value('up{job!="node"}') == expected, why)

    until(lambda: node_targets(prometheus), why)
    (target,) = node_targets(prometheus)
    assert target["scrapeUrl"] == "http://127.0.0.1:9100/metrics"
    assert (
        target["labels"].items() >= {"robot": "robot_1", "fleet": "hall", "site": "north"}.items()
    )

    errors = {each["lastError"] for each in prometheus("/api/v1/targets")["activeTargets"]}
    assert any("401 Unauthorized" in error for error in errors)
    assert any("certificate signed by unknown authority" in error for error in errors)

    text = scrape(exporter, tmp_path)
    checked = subprocess.run(
        ["promtool", "check", "metrics"], input=text, capture_output=True, timeout=60, check=False
    )
    assert (checked.returncode, checked.stderr.decode()) == (0, "")


def node_targets(prometheus: Callable[[str], Any]) -> list[Any]:
    targets = prometheus("/api/v1/targets")["activeTargets"]
    return [each for each in targets if each["labels"]["job"] == "node"]


def scrape(exporter: str, folder: Path) -> bytes:
    login = base64.b64encode(f"prometheus:{PASSWORD}".encode()).decode()
    request = urllib.request.Request(
        f"https://{exporter}/metrics", headers={"Authorization": f"Basic {login}"}
    )
    trusted = ssl.create_default_context(cafile=folder / "ca.crt")
    with urllib.request.urlopen(request, timeout=20, context=trusted) as answer:
        return answer.read()
