"""The shipped jobs for host checks, their comment signs taken away, with real exporters."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

import host_checks
import prometheus_site
from fleet_demo import domains, programs
from fleet_demo.asking import answers
from fleet_demo.ports import free_port
from fleet_demo.processes import Process
from fleet_demo.waiting import until

FLEET = """
fleet: hall
robots:
  - name: robot_1
    namespace: /robot_1
    domain_id: {domain}
    address: 127.0.0.1
    labels: {{site: north, uplink: ap_1}}
"""


def jobs(exporter: str, node: str, blackbox: str) -> list[dict]:
    """What stands in comments at the end of prometheus.yml; only addresses are this machine's."""
    text = (prometheus_site.ROOT / "prometheus" / "prometheus.yml").read_text()
    _rest, mark, end = text.partition("  # --- Hosts:")
    assert mark
    lines = [re.sub(r"^  # (?!---)", "  ", line) for line in end.splitlines()[1:]]
    shown = "\n".join(lines)
    port = node.rpartition(":")[2]
    for old, new in (
        ("/sd/node", f"/sd/node?port={port}"),
        ("localhost:9877", exporter),
        ("localhost:9115", blackbox),
        ("30s", "1s"),
    ):
        assert old in shown
        shown = shown.replace(old, new)
    found = yaml.safe_load(shown)
    for job in found:
        for sd in job.get("http_sd_configs", ()):
            sd["refresh_interval"] = "1s"
        job.pop("scrape_interval", None)
    return found


@pytest.fixture
def site(tmp_path: Path) -> Iterator[prometheus_site.Site]:
    if missing := host_checks.missing_program():
        pytest.skip(f"{missing} is not installed")
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
            ],
            domains.environment(domain),
            tmp_path / "exporter.log",
        )
        try:
            process.start()
            until(lambda: answers(exporter, "/-/ready"), process.describe, 60)
            probes = jobs(exporter, node, blackbox)
            with prometheus_site.running(
                tmp_path, {"hall": exporter}, {}, probes=probes
            ) as running:
                uplinks = tmp_path / "prometheus" / "targets" / "uplinks.yml"
                uplinks.write_text(_uncommented(uplinks).replace("ap-1.lan", "127.0.0.1"))
                yield running
        finally:
            process.stop()


def _uncommented(path: Path) -> str:
    """The example in the shipped file, as a site would use it."""
    example = re.findall(r"^# ((?:- |  ).*)$", path.read_text(), re.MULTILINE)
    assert example
    return "\n".join(example).replace("ap-1}", "ap_1}").replace("warehouse", "hall")


def test_robots_and_uplinks_are_asked_for_and_rules_know_the_answers(site):
    wanted = {
        'up{job="ros-diagnostics-node"}': {"robot": "robot_1", "site": "north"},
        'probe_success{job="ros-diagnostics-ping"} == 1': {"robot": "robot_1", "site": "north"},
        'probe_success{job="ros-diagnostics-uplink"} == 1': {"fleet": "hall", "uplink": "ap_1"},
        'robot:ros_diagnostics_ping:info{answers="yes"}': {"fleet": "hall", "robot": "robot_1"},
        "uplink:ros_diagnostics_reachable:start": {"fleet": "hall", "uplink": "ap_1"},
    }
    for expr, labels in wanted.items():
        until(lambda expr=expr: site.query(expr), lambda expr=expr: _why(site, expr), 60)
        (found,) = site.query(expr)
        assert found["metric"].items() >= labels.items(), expr


def _why(site: prometheus_site.Site, expr: str) -> str:
    return f"{expr} finds nothing; up: {site.query('up')}, {site.query('probe_success')}"
