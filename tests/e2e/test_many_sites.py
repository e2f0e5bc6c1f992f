"""docs/many-sites.md: two sites and a centre, and what is left of it while a link is cut.

Each site has robots, an exporter and a Prometheus with the shipped configuration and the page's
`remote_write`; the centre is a Prometheus, or VictoriaMetrics with vmalert.
"""

from __future__ import annotations

import json
import re
import shutil
import textwrap
import time
import urllib.request
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
import yaml

from e2e.rule_scenarios.stack import Orders
from support import committed_dashboards, short_clocks, victoriametrics
from support.link import Link
from support.prometheus_site import Site as Engine
from testbed import domains, http, programs, servers
from testbed.configuration import CHECKOUT
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

PAGE = (CHECKOUT / "docs" / "many-sites.md").read_text()
CENTRE = CHECKOUT / "prometheus" / "centre"
SECONDS = 2  # between scrapes and between evaluations
FLEET = """\
fleet: {name}
profiles: {{default: {{stale_after: 4s, confirm_after: 4s}}}}
faults: {{restart_grace: 8s}}
discovery:
  - {{topic: "/{{robot}}/diagnostics_agg", domain_ids: [{domain}], include: ["robot_*"]}}
"""
FAULTS = "fleet:ros_diagnostics_fault_start:held"
EVALUATIONS = "exporter:ros_diagnostics_exporter:held"  # one sample at each evaluation


class Site:
    """Two robots, their exporter and Prometheus, and the link to the centre."""

    def __init__(
        self, stack: ExitStack, folder: Path, name: str, centre: str, *, vmagent: bool
    ) -> None:
        folder.mkdir()
        self.name = name
        self.link = Link(centre)
        stack.callback(self.link.close)
        domain = stack.enter_context(domains.lease())
        self._exporter = self._start_fleet(stack, folder, domain)
        self.orders = Orders(domain)
        stack.callback(self.orders.close)
        to = self.link.address
        if vmagent:
            to = f"127.0.0.1:{free_port()}"
            flags = self._vmagent_flags(folder, to)
            agent = victoriametrics.start_program(stack, folder, to, "vmagent", *flags)
        self.prometheus = f"127.0.0.1:{free_port()}"
        config = self._configuration(folder, to)
        server = servers.prometheus(folder, config, self.prometheus)
        stack.enter_context(servers.running(server))
        self.sender = agent if vmagent else server.process
        self._sender_address = to if vmagent else self.prometheus

    def _start_fleet(self, stack: ExitStack, folder: Path, domain: int) -> str:
        address = f"127.0.0.1:{free_port()}"
        environment = domains.environment(domain) | {"ROS_LOG_DIR": str(folder / "ros-log")}
        (folder / "fleet.yml").write_text(FLEET.format(domain=domain, name=self.name))
        argv = programs.exporter(folder / "fleet.yml", address, folder / "state", "127.0.0.1:1")
        robots = programs.virtual_robots(2, 1, domain)
        for name, command in (("robots", robots), ("exporter", argv)):
            process = Process(name, command, environment, folder / f"{name}.log")
            stack.callback(process.stop)
            process.start()
        return address

    def _vmagent_flags(self, folder: Path, address: str) -> list[str]:
        """Those of the page's command, with other addresses and folders."""
        found = re.search(r"^(vmagent .*?)\n```", PAGE, re.MULTILINE | re.DOTALL)
        assert found
        _, *flags = found[1].replace("\\\n", " ").split()
        ours = {
            "-httpListenAddr": address,
            "-remoteWrite.url": f"http://{self.link.address}/api/v1/write",
            "-remoteWrite.tmpDataPath": str(folder / "queue"),
        }
        return [f"{name}={ours.get(name, value)}" for name, value in map(_split, flags)]

    def _configuration(self, folder: Path, to: str) -> Path:
        """The shipped one with the page's `remote_write`."""
        shutil.copytree(CHECKOUT / "prometheus", folder / "prometheus")
        for path in (folder / "prometheus" / "targets").glob("*.yml"):
            path.write_text("[]")
        targets = folder / "prometheus" / "targets" / "ros-diagnostics.yml"
        targets.write_text(yaml.safe_dump([{"targets": [self._exporter]}]))
        short_clocks.set_interval(folder / "prometheus", SECONDS)
        short_clocks.scale(folder / "prometheus" / "rules")
        piece = re.search(r"```yaml\n# prometheus.yml\n(remote_write:.*?)```", PAGE, re.DOTALL)
        assert piece
        config = folder / "prometheus" / "prometheus.yml"
        text = piece[1].replace("centre:9090", to).replace("yokohama", self.name)
        config.write_text(config.read_text() + textwrap.dedent(text))
        return config

    def ready(self) -> bool:
        """Whether the exporter receives both robots."""
        return http.answers(self._exporter, "/-/ready") and (
            http.get(self._exporter, "/metrics?collect[]=faults").count(b"robot_up{") == 2
        )

    def restart_sender(self) -> None:
        """Stop what sends to the centre, and start it again."""
        self.sender.stop()
        self.sender.start()
        health = "/health" if self.sender.name == "vmagent" else "/-/ready"
        until(lambda: http.answers(self._sender_address, health), self.sender.describe, 60)

    def firing(self) -> set[str]:
        """The alerts that fire here about components."""
        with urllib.request.urlopen(f"http://{self.prometheus}/api/v1/alerts", timeout=10) as found:
            alerts = json.load(found)["data"]["alerts"]
        return {
            f"{each['labels']['robot']} {each['labels']['component']}"
            for each in alerts
            if each["state"] == "firing" and "component" in each["labels"]
        }


def _split(flag: str) -> tuple[str, str]:
    name, _, value = flag.partition("=")
    return name, value


class Centre:
    """What the centre knows."""

    def __init__(self, metrics: str, alerts: str) -> None:
        self.metrics = Engine(metrics, "")
        self._alerts = alerts

    def value(self, promql: str) -> float:
        """Of an expression with one element; 0 for none."""
        found = self.metrics.query(promql)
        assert len(found) <= 1, found
        return float(found[0]["value"][1]) if found else 0

    def firing(self) -> set[str]:
        """The alerts that fire at the centre: name, and site or component."""
        with urllib.request.urlopen(f"http://{self._alerts}/api/v1/alerts", timeout=10) as found:
            alerts = json.load(found)["data"]["alerts"]
        return {
            f"{labels['alertname']} {labels.get('site') or labels['component']}"
            for each in alerts or ()  # vmalert's list is null while none is pending
            for labels in [each["labels"]]
            if each["state"] == "firing"
        }

    def becomes(self, *alerts: str) -> None:
        """Wait until just these fire."""
        wanted = {f"RosDiagnostics{each}" for each in alerts}
        until(
            lambda: self.firing() == wanted,
            lambda: f"{wanted}; firing: {self.firing()}",
            120,
            every=0.5,
        )


def _centre_rules(folder: Path) -> Path:
    """A copy of the folder of the centre with short clocks."""
    shutil.copytree(CENTRE, folder)
    (folder / "targets" / "alertmanager.yml").write_text("[]")
    config = folder / "prometheus.yml"
    config.write_text(re.sub(r"_interval: 15s", f"_interval: {SECONDS}s", config.read_text()))
    rules = folder / "rules" / "sites.yml"
    text = rules.read_text()
    assert "[2m]" in text
    assert "for: 1m" in text
    text = text.replace("[2m]", "[15s]").replace("for: 1m", "for: 4s")
    rules.write_text(text.replace("interval: 15s", f"interval: {SECONDS}s"))
    return config


def _prometheus_centre(stack: ExitStack, folder: Path) -> Centre:
    config = _centre_rules(folder / "centre")
    address = f"127.0.0.1:{free_port()}"
    server = servers.prometheus(folder, config, address, "--web.enable-remote-write-receiver")
    stack.enter_context(servers.running(server))
    return Centre(address, address)


def _victoria_centre(stack: ExitStack, folder: Path) -> Centre:
    config = _centre_rules(folder / "centre")
    return Centre(*victoriametrics.start(stack, folder, str(config.parent / "rules" / "sites.yml")))


@pytest.fixture(params=["prometheus", "victoriametrics"])
def world(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Centre, Site, Site]]:
    """The centre, the site north, and the site south, which has a vmagent at VictoriaMetrics."""
    victoria = request.param == "victoriametrics"
    with ExitStack() as stack:
        centre = (_victoria_centre if victoria else _prometheus_centre)(stack, tmp_path)
        address = centre.metrics.prometheus
        north, south = (
            Site(stack, tmp_path / name, name, address, vmagent=victoria)
            for name in ("north", "south")
        )
        for site in (north, south):
            until(site.ready, f"the exporter of {site.name} receives both robots", 90)
        yield centre, north, south


def test_a_site_that_is_cut_off_goes_on_alone_and_the_centre_catches_up(world):
    centre, north, south = world
    until(
        lambda: centre.value("count(site:ros_diagnostics_site:reached)") == 2,
        lambda: f"both sites at the centre: {centre.metrics.query(EVALUATIONS)}",
        90,
    )
    centre.becomes()
    north.orders.give([("robot_1/Motor 1", "error")])
    until(lambda: _faults(centre, "north") == 1, "the fault of north at the centre", 60)
    assert _problems(centre, "north") == ["robot_1"]
    # As soon as both exporters have settled: before, having no row proves nothing. The row's value
    # is NaN, which VictoriaMetrics leaves out.
    on_victoria = south.sender.name == "vmagent"
    _becomes_problems(centre, "south", [] if on_victoria else ["No problems"])
    robots = _cells(centre, "Robots", {"site": "north|south"})
    assert sorted((each["fleet"], each["robot"]) for each in robots) == [
        (fleet, robot) for fleet in ("north", "south") for robot in ("robot_1", "robot_2")
    ]
    # These sites scrape neither server; both exporters answer.
    [banner] = _cells(centre, "Monitoring", {})
    assert banner["text"].startswith("Prometheus or Alertmanager is not scraped")
    begin = time.time()

    south.link.cut()
    centre.becomes("SiteUnreachable south")
    assert _problems(centre, "north") == ["robot_1"]
    _becomes_problems(centre, "south", [])  # not known
    south.orders.give([("robot_2/Motor 1", "error")])
    until(lambda: south.firing() == {"robot_2 Motor 1"}, "the alert in the south", 60)
    south.restart_sender()
    restarted = time.time()
    until(lambda: south.firing() == {"robot_2 Motor 1"}, "the alert after the restart", 60)
    assert centre.firing() == {"RosDiagnosticsSiteUnreachable south"}

    south.link.heal()
    centre.becomes("SitesCommonCause Motor 1")
    assert north.firing() == {"robot_1 Motor 1"}
    assert south.firing() == {"robot_2 Motor 1"}
    _catches_up(centre, south, restarted + 1)
    lost = _missing(centre, south, begin, time.time() - 1)
    if on_victoria:
        assert lost == 0
    else:  # what Prometheus had not sent before it was stopped
        assert 0 < lost * SECONDS <= restarted - begin

    begin = time.time()
    north.link.cut()
    centre.becomes("SitesCommonCause Motor 1", "SiteUnreachable north")
    north.orders.give([("robot_1/Motor 1", "ok")])
    until(lambda: north.firing() == set(), "the recovery in the north", 60)
    north.link.heal()
    centre.becomes()
    _catches_up(centre, north, begin)


def _faults(centre: Centre, site: str) -> float:
    return centre.value(f'count({FAULTS}{{site="{site}"}})')


def _problems(centre: Centre, site: str) -> list[str]:
    """The rows of the table of problems, with a site chosen: of each its robot, else its text."""
    cells = _cells(centre, "Problems", {"site": site})
    return sorted({each.get("robot") or each["message"] for each in cells})


def _becomes_problems(centre: Centre, site: str, wanted: list[str]) -> None:
    """Wait until the table of problems has just these rows."""
    until(
        lambda: _problems(centre, site) == wanted,
        lambda: f"{wanted} of {site}: {_problems(centre, site)}",
        60,
    )


def _cells(centre: Centre, panel: str, chosen: dict[str, str]) -> list[dict[str, str]]:
    """The labels of the first query of a panel of the fleet's dashboard."""
    [query] = [
        each
        for each in committed_dashboards.queries()
        if (each.board, each.place, each.ref) == ("ros-diagnostics-fleet", panel, "A")
    ]
    found = centre.metrics.query(committed_dashboards.filled(query.expr, chosen))
    return [each["metric"] for each in found]


def _missing(centre: Centre, site: Site, begin: float, end: float) -> int:
    """How many evaluations of the site the centre has no sample of."""
    count = "sum(count_over_time({}[{:.0f}s]))"
    own = Engine(site.prometheus, "").query(count.format(EVALUATIONS, end - begin), at=end)
    of_site = f'{EVALUATIONS}{{site="{site.name}"}}'
    there = centre.metrics.query(count.format(of_site, end - begin), at=end)
    return int(own[0]["value"][1]) - (int(there[0]["value"][1]) if there else 0)


def _catches_up(centre: Centre, site: Site, since: float) -> None:
    """Wait until nothing since then is missing at the centre."""
    end = time.time() - 1
    until(
        lambda: _missing(centre, site, since, end) == 0,
        lambda: f"{_missing(centre, site, since, end)} evaluations of {site.name} at the centre",
        60,
    )
