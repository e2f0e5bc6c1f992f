"""The commented-out jobs for host checks in prometheus.yml, with real exporters."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from support import host_checks, prometheus_site
from testbed import domains, programs
from testbed.http import answers
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process

FLEET = """
fleet: hall
robots:
  - name: robot_1
    namespace: /robot_1
    domain_id: {domain}
    address: 127.0.0.1
    labels: {{site: north, uplink: ap_1}}
  - {{name: ap_1, source: queries, address: 127.0.0.1}}
"""


def jobs(exporter: str, node: str, blackbox: str, module: str) -> list[dict[str, Any]]:
    """Those for computers, robots and uplinks; ``module`` tcp_connect as the comment says."""
    port = node.rpartition(":")[2]
    replaced = {
        "/sd/node": f"/sd/node?port={port}",
        "localhost:9877": exporter,
        "localhost:9115": blackbox,
    }
    if module == "tcp_connect":
        at_port = {"/sd/ping": f"/sd/tcp?port={port}", "/sd/uplink": f"/sd/uplink?port={port}"}
        replaced |= {"[icmp]": "[tcp_connect]", **at_port}
    services = [f"ros-diagnostics-{name}" for name in ("ssh", "http", "tcp")]
    return host_checks.jobs(replaced, services)


@pytest.fixture(params=["icmp", "tcp_connect"])
def probed(request, tmp_path: Path) -> Iterator[tuple[prometheus_site.Site, str]]:
    """A site whose hosts are probed with either module, and blackbox_exporter's error, if any."""
    exporter = f"127.0.0.1:{free_port()}"
    with domains.lease() as domain, host_checks.running(tmp_path) as (node, blackbox):
        config = tmp_path / "fleet.yml"
        config.write_text(FLEET.format(domain=domain))
        process = Process(
            "exporter",
            [
                programs.own("ros-diagnostics-exporter"),
                f"--config.file={config}",
                f"--web.listen-address={exporter}",
                f"--storage.path={tmp_path / 'exporter.db'}",
            ],
            domains.environment(domain),
            tmp_path / "exporter.log",
        )
        try:
            process.start()
            until(lambda: answers(exporter, "/-/ready"), process.describe, 60)
            probes = jobs(exporter, node, blackbox, request.param)
            with prometheus_site.running(tmp_path, {"hall": exporter}, probes=probes) as running:
                pings = request.param == "icmp"
                yield running, host_checks.ping_error(blackbox) if pings else ""
        finally:
            process.stop()


def test_robots_and_uplinks_are_probed(probed):
    site, error = probed
    success = 0 if error else 1
    robot = {"robot": "robot_1", "site": "north"}
    uplink = {"fleet": "hall", "robot": "ap_1"}
    wanted = {
        'up{job="ros-diagnostics-node"}': robot,
        f'probe_success{{job="ros-diagnostics-ping"}} == {success}': robot,
        f'probe_success{{job="ros-diagnostics-uplink"}} == {success}': uplink,
    }
    if error:  # an ordinary user: docs/alerts.md says what blackbox_exporter needs then
        assert "not permitted" in error or "permission denied" in error
    for expr, labels in wanted.items():
        until(lambda expr=expr: site.query(expr), lambda expr=expr: _why(site, expr), 60)
        (found,) = site.query(expr)
        assert found["metric"].items() >= labels.items(), expr


def _why(site: prometheus_site.Site, expr: str) -> str:
    return f"{expr} finds nothing; up: {site.query('up')}, {site.query('probe_success')}"
