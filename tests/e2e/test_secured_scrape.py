"""A real Prometheus scrapes the real exporter over TLS with basic auth, and uses its discovery."""

import base64
import json
import ssl
import urllib.request
from pathlib import Path
from typing import Any

import bcrypt
import trustme

from support.shipped_rules import run_tool
from testbed import http, servers
from testbed.polling import until
from testbed.site import Site

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


def test_prometheus_scrapes_over_tls_with_basic_auth_and_finds_the_robots(site: Site):
    write_secrets(site.folder)
    site.start_robots(2)
    config = site.write("fleet.yml", FLEET.format(domain=site.domain_id))
    exporter = site.start_exporter(config, f"--web.config.file={site.folder / 'web.yml'}").address
    config = site.write("prometheus.yml", PROMETHEUS.format(exporter=exporter))
    address = site.addresses.prometheus
    site.start(servers.prometheus(site.folder, config, address)).wait_until_ready()

    def value(query: str) -> dict[str, float]:
        found = site.query(query)
        return {each.labels.get("robot") or each.labels["job"]: each.value for each in found}

    def targets() -> list[dict[str, Any]]:
        return list(http.get_json(address, "/api/v1/targets")["data"]["activeTargets"])

    def nodes() -> list[dict[str, Any]]:
        return [each for each in targets() if each["labels"]["job"] == "node"]

    def why() -> str:
        return json.dumps(targets(), indent=1)[-4000:]

    until(lambda: value("ros_diagnostics_robot_up") == {"robot_1": 1, "robot_2": 1}, why, 60)
    expected = {"right": 1, "wrong_password": 0, "wrong_ca": 0}
    until(lambda: value('up{job!="node"}') == expected, why)

    until(nodes, why)
    (target,) = nodes()
    assert target["scrapeUrl"] == "http://127.0.0.1:9100/metrics"
    labels = {"robot": "robot_1", "fleet": "hall", "site": "north"}
    assert target["labels"].items() >= labels.items()

    def errors() -> str:
        return " ".join(each["lastError"] for each in targets())

    until(lambda: "401 Unauthorized" in errors(), errors)
    until(lambda: "certificate signed by unknown authority" in errors(), errors)
    run_tool("promtool", "check", "metrics", stdin=scrape(exporter, site.folder))


def scrape(exporter: str, folder: Path) -> str:
    login = base64.b64encode(f"prometheus:{PASSWORD}".encode()).decode()
    headers = {"Authorization": f"Basic {login}"}
    request = urllib.request.Request(f"https://{exporter}/metrics", headers=headers)
    trusted = ssl.create_default_context(cafile=folder / "ca.crt")
    with urllib.request.urlopen(request, timeout=20, context=trusted) as answer:
        return str(answer.read().decode())
