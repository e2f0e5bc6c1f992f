"""An exporter for each subnet of one fleet: two names, two DDS domains, one Prometheus."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from e2e.rule_scenarios.stack import Orders
from support import prometheus_site, short_clocks
from testbed import domains, http, programs
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

FLEET = """
fleet: hall
exporter: {name}
profiles: {{default: {{stale_after: 4s, confirm_after: 2s}}}}
faults: {{restart_grace: 8s}}
robots:
  - {{name: {first}, namespace: /robot_1, domain_id: {domain}}}
  - {{name: {name}_2, namespace: /robot_2, domain_id: {domain}}}
"""
Alert = tuple[str, ...]  # name, exporter, robot


class Subnet:
    """Two virtual robots in a domain of their own, and the exporter that serves them."""

    def __init__(self, stack: ExitStack, folder: Path, name: str) -> None:
        self.name = name
        self.address = f"127.0.0.1:{free_port()}"
        self._config = folder / f"{name}.yml"
        self._domain = stack.enter_context(domains.lease())
        self.write(first=f"{name}_1")
        environment = domains.environment(self._domain)
        robots = Process(
            f"robots of {name}",
            programs.virtual_robots(2, 1, self._domain),
            environment,
            folder / f"{name}-robots.log",
        )
        storage = folder / f"{name}.db"
        argv = programs.exporter(self._config, self.address, storage, "127.0.0.1:1")
        self.exporter = Process(name, argv, environment, folder / f"{name}.log")
        for process in (robots, self.exporter):
            stack.callback(process.stop)
            process.start()
        self.orders = Orders(self._domain)
        stack.callback(self.orders.close)

    def write(self, *, first: str) -> None:
        """Write fleet.yml; ``first`` is the name of its first robot."""
        text = FLEET.format(name=self.name, first=first, domain=self._domain)
        self._config.write_text(text)

    def receives_both(self) -> bool:
        if not http.answers(self.address, "/-/ready"):
            return False
        robots = http.get_json(self.address, "/api/v1/fleet")["robots"]
        return [each["up"] for each in robots] == [True, True]

    def motor(self, level: str) -> None:
        """Set the level of a motor of the first robot."""
        self.orders.give([("robot_1/Motor 1", level)])


class Site:
    """Both subnets, and what fires about the fleet."""

    def __init__(self, north: Subnet, south: Subnet, servers: prometheus_site.Site) -> None:
        self.north, self.south, self.servers = north, south, servers

    def firing(self) -> set[Alert]:
        found = (each["labels"] for each in self.servers.alerts() if each["state"] == "firing")
        return {
            (
                labels["alertname"].removeprefix("RosDiagnostics"),
                labels.get("exporter", ""),
                labels.get("robot", ""),
            )
            for labels in found
            if labels.get("fleet") == "hall"
            and labels["alertname"] != "RosDiagnosticsExporterFault"  # it has no Alertmanager
        }

    def becomes(self, *alerts: Alert, keeps: Alert | None = None) -> None:
        """Wait until just these fire; ``keeps`` fires all the time."""

        def reached() -> bool:
            firing = self.firing()
            assert keeps is None or keeps in firing, f"{keeps} resolved: {firing}"
            return firing == set(alerts)

        until(reached, lambda: f"{alerts}; firing: {self.firing()}", 120, every=0.5)


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with ExitStack() as stack:
        north, south = (Subnet(stack, tmp_path, name) for name in ("north", "south"))
        for each in (north, south):
            until(each.receives_both, f"both robots of {each.name} are received", 120)
        servers = stack.enter_context(
            prometheus_site.running(
                tmp_path,
                {each.name: each.address for each in (north, south)},
                prepare=lambda prometheus: short_clocks.scale(prometheus / "rules"),
            )
        )
        yield Site(north, south, servers)


NORTH = ("ComponentCritical", "", "north_1")
SOUTH = ("ComponentCritical", "", "south_1")


def test_each_exporter_judges_its_robots_and_holds_their_faults_alone(site: Site):
    def robots(expr: str) -> float:
        found = site.servers.query(expr)
        return float(found[0]["value"][1]) if found else 0

    count = 'sum(site_robot_group:ros_diagnostics_robots:count{fleet="hall"})'
    until(lambda: robots(count) == 4, "4", 60)
    site.north.motor("error")
    site.south.motor("error")
    site.becomes(NORTH, SOUTH)

    site.north.exporter.kill()
    site.becomes(NORTH, SOUTH, ("ExporterDown", "north", ""), keeps=NORTH)
    # What south serves and what it no longer serves is nothing that ends a fault of north's robots.
    site.south.motor("ok")
    site.becomes(NORTH, ("ExporterDown", "north", ""), keeps=NORTH)
    well = 'sum(site_robot_group:ros_diagnostics_robots:count{state="ok"})'
    until(lambda: robots(well) == 2, lambda: f"2 robots are OK, not {robots(well)}", 30)
    site.north.exporter.start()
    site.becomes(NORTH, keeps=NORTH)
    site.north.motor("ok")
    site.becomes()


def test_a_robot_that_two_exporters_serve_unasked_fires(site: Site):
    site.south.exporter.stop()
    site.south.write(first="north_1")
    site.south.exporter.start()
    site.becomes(("RobotServedTwice", "", "north_1"))

    site.south.exporter.stop()
    site.south.write(first="south_1")
    site.south.exporter.start()
    site.becomes()
