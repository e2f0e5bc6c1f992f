"""The shipped rules, unchanged but for short durations, on every engine that may evaluate them.

A fault and its recovery, the death of the exporter in it, and a silent robot, on the Prometheus in
PATH (or $PROMETHEUS), on Prometheus 3 (in the folder $PROMETHEUS_3) with concurrent evaluation, and
on vmalert over VictoriaMetrics.
"""

from __future__ import annotations

import json
import os
import shutil
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import yaml

from e2e.rule_scenarios.stack import Orders
from support import short_clocks, victoriametrics
from testbed import domains, http, programs, servers
from testbed.configuration import CHECKOUT
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

SECONDS = 2  # between scrapes and between evaluations
FLEET = """\
fleet: hall
profiles: {{default: {{stale_after: 4s, confirm_after: 4s}}}}
faults: {{restart_grace: 8s}}
discovery:
  - {{topic: "/{{robot}}/diagnostics_agg", domain_ids: [{domain}], include: ["robot_*"]}}
"""
CRITICAL = "ComponentCritical robot_1 Motor 1"
SILENT = "RobotSilent robot_2"
DOWN = "ExporterDown"


class Site:
    """Two robots, their exporter and one engine; which alerts fire."""

    def __init__(self, exporter: Process, address: str, alerts: str, orders: Orders) -> None:
        self.exporter = exporter
        self.address = address
        self.orders = orders
        self._alerts = alerts

    def alerts(self) -> list[dict[str, dict[str, str]]]:
        """All alerts of the engine."""
        with urllib.request.urlopen(f"http://{self._alerts}/api/v1/alerts", timeout=10) as answer:
            found: list[dict[str, dict[str, str]]] = json.load(answer)["data"]["alerts"] or []
            return found

    def firing(self) -> set[str]:
        """The alerts about the fleet."""
        alerts = self.alerts()
        return {
            " ".join(filter(None, (_name(each), labels.get("robot"), labels.get("component"))))
            for each in alerts
            for labels in [each["labels"]]
            if each["state"] == "firing"
            and labels.get("fleet") == "hall"
            and labels["alertname"] != "RosDiagnosticsExporterFault"  # it has no Alertmanager
        }

    def becomes(self, *alerts: str, keeps: str = "") -> None:
        """Wait until just these fire; ``keeps`` fires all the time."""

        def reached() -> bool:
            firing = self.firing()
            assert not keeps or keeps in firing, f"{keeps} resolved: {firing}"
            return firing == set(alerts)

        until(reached, lambda: f"{alerts}; firing: {self.firing()}", 90, every=0.5)

    def ready(self) -> bool:
        """Whether the exporter receives both robots."""
        return http.answers(self.address, "/-/ready") and (
            http.get(self.address, "/metrics?collect[]=faults").count(b'robot_up{fleet="hall"') == 2
        )


def _name(alert: dict[str, dict[str, str]]) -> str:
    return alert["labels"]["alertname"].removeprefix("RosDiagnostics")


@pytest.fixture(params=["prometheus", "concurrent", "vmalert"])
def site(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Site]:
    address = f"127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        config = _prometheus(tmp_path, address)
        domain = stack.enter_context(domains.lease())
        environment = domains.environment(domain) | {"ROS_LOG_DIR": str(tmp_path / "ros-log")}
        (tmp_path / "fleet.yml").write_text(FLEET.format(domain=domain))
        argv = programs.exporter(tmp_path / "fleet.yml", address, tmp_path / "state", "127.0.0.1:1")
        exporter = Process("exporter", argv, environment, tmp_path / "exporter.log")
        robots = Process(
            "robots", programs.virtual_robots(2, 1, domain, None), environment, tmp_path / "r.log"
        )
        for process in (robots, exporter):
            stack.callback(process.stop)
            process.start()
        orders = Orders(domain)
        stack.callback(orders.close)
        start = _vmalert if request.param == "vmalert" else _start_prometheus
        alerts = start(stack, tmp_path, config, concurrent=request.param == "concurrent")
        yield Site(exporter, address, alerts, orders)


def _prometheus(folder: Path, exporter: str) -> Path:
    shutil.copytree(CHECKOUT / "prometheus", folder / "prometheus")
    targets = folder / "prometheus" / "targets"
    for path in targets.glob("*.yml"):
        path.write_text("[]")
    (targets / "ros-diagnostics.yml").write_text(yaml.safe_dump([{"targets": [exporter]}]))
    short_clocks.set_interval(folder / "prometheus", SECONDS)
    short_clocks.scale(folder / "prometheus" / "rules")
    return folder / "prometheus" / "prometheus.yml"


def _start_prometheus(stack: ExitStack, folder: Path, config: Path, *, concurrent: bool) -> str:
    address = f"127.0.0.1:{free_port()}"
    options = []
    if concurrent:
        if "PROMETHEUS_3" not in os.environ:
            pytest.skip("no Prometheus 3: its folder in PROMETHEUS_3")
        environment = stack.enter_context(pytest.MonkeyPatch.context())
        environment.setenv("PROMETHEUS", f"{os.environ['PROMETHEUS_3']}/prometheus")
        options = ["--enable-feature=concurrent-rule-eval"]
    stack.enter_context(servers.running(servers.prometheus(folder, config, address, *options)))
    return address


def _vmalert(stack: ExitStack, folder: Path, config: Path, *, concurrent: bool) -> str:
    assert not concurrent
    scraping = (
        f"-promscrape.config={config}",
        "-promscrape.config.strictParse=false",  # it evaluates no rules itself
    )
    rules = str(config.parent / "rules" / "*.yml")
    return victoriametrics.start(stack, folder, rules, *scraping).alerts


def test_a_fault_the_death_of_its_exporter_and_a_silent_robot(site: Site):
    until(site.ready, "the exporter receives both robots", 60)
    site.becomes()

    site.orders.give([("robot_1/Motor 1", "error")])
    site.becomes(CRITICAL)

    site.exporter.kill()
    site.becomes(CRITICAL, DOWN, keeps=CRITICAL)
    site.exporter.start()
    site.becomes(CRITICAL, keeps=CRITICAL)

    site.orders.give([("robot_2", "hang")])
    site.becomes(CRITICAL, SILENT, keeps=CRITICAL)
    site.orders.give([("robot_1/Motor 1", "ok")])
    site.becomes(SILENT)
    site.orders.give([("robot_2", "resume")])
    site.becomes()
