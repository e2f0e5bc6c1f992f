"""The commented-out jobs for host checks in prometheus.yml, with real exporters."""

from __future__ import annotations

import pytest

from support import host_checks
from testbed.polling import until
from testbed.site import Site

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


@pytest.fixture
def ping_error(site: Site) -> str:
    """A site whose hosts are probed: blackbox_exporter's error where it may not send pings."""
    node, blackbox = host_checks.start(site)
    site.start_exporter(site.write("fleet.yml", FLEET.format(domain=site.domain_id)))
    site.wait_until_ready()
    site.start_alertmanager()
    replaced = {
        "/sd/node": f"/sd/node?port={node.rpartition(':')[2]}",
        "localhost:9877": site.exporter.address,
        "localhost:9115": blackbox,
    }
    services = [f"ros-diagnostics-{name}" for name in ("ssh", "http", "tcp")]
    site.start_prometheus(interval=1, probes=host_checks.jobs(replaced, services))
    site.wait_until_ready()
    return host_checks.ping_error(blackbox)


def test_robots_and_uplinks_are_probed(site: Site, ping_error: str):
    success = 0 if ping_error else 1
    robot = {"robot": "robot_1", "site": "north"}
    uplink = {"fleet": "hall", "robot": "ap_1"}
    wanted = {
        'up{job="ros-diagnostics-node"}': robot,
        f'probe_success{{job="ros-diagnostics-ping"}} == {success}': robot,
        f'probe_success{{job="ros-diagnostics-uplink"}} == {success}': uplink,
    }
    if ping_error:  # an ordinary user: docs/alerts.md says what blackbox_exporter needs then
        assert "not permitted" in ping_error or "permission denied" in ping_error
    for expr, labels in wanted.items():
        until(lambda expr=expr: site.query(expr), lambda expr=expr: _why(site, expr), 60)
        (found,) = site.query(expr)
        assert found.labels.items() >= labels.items(), expr


def _why(site: Site, expr: str) -> str:
    return f"{expr} finds nothing; up: {site.query('up')}, {site.query('probe_success')}"
