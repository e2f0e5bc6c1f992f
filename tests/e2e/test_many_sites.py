"""docs/many-sites.md: two sites and a centre, and what is left of it while a link is cut.

Each site has robots, an exporter and a Prometheus with the shipped configuration and the page's
`remote_write`; the centre is a Prometheus, or VictoriaMetrics with vmalert.
"""

import re
import shutil
import textwrap
import time
from contextlib import closing
from functools import partial
from pathlib import Path

import pytest

from support import committed_dashboards, victoriametrics
from support.link import Link
from support.orders import Orders
from testbed import http, servers
from testbed.configuration import CHECKOUT
from testbed.engine import Engine
from testbed.polling import until
from testbed.site import Site, free_address

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


class Branch:
    """A site: two robots, their exporter and Prometheus, and the link to the centre."""

    def __init__(self, site: Site, centre: str, *, vmagent: bool) -> None:
        self.name = site.folder.name
        self.engine = site.engine
        self.link = site.use(closing(Link(centre)))
        site.start_robots(2)
        fleet = FLEET.format(domain=site.domain_id, name=self.name)
        self._exporter = site.start_exporter(site.write("fleet.yml", fleet)).address
        self.orders = site.use(Orders(site.domain_id))
        to = free_address() if vmagent else self.link.address
        if vmagent:
            self.sender = site.start_program(
                "vmagent", self._vmagent_argv(site.folder, to), to, "/health"
            )
        edit = partial(self._add_remote_write, to)
        prometheus = site.start_prometheus(interval=SECONDS, tenth=True, edit=edit)
        if not vmagent:
            self.sender = prometheus
        site.wait_until_ready()

    def _vmagent_argv(self, folder: Path, address: str) -> list[str]:
        """The page's command, with other addresses and folders."""
        found = re.search(r"^(vmagent .*?)\n```", PAGE, re.MULTILINE | re.DOTALL)
        assert found
        program, *flags = found[1].replace("\\\n", " ").split()
        ours = {
            "-httpListenAddr": address,
            "-remoteWrite.url": f"http://{self.link.address}/api/v1/write",
            "-remoteWrite.tmpDataPath": str(folder / "queue"),
        }
        named = [flag.partition("=")[::2] for flag in flags]
        return [program, *(f"{name}={ours.get(name, value)}" for name, value in named)]

    def _add_remote_write(self, to: str, prometheus: Path) -> None:
        """Add the page's `remote_write`; the site has no Alertmanager."""
        for job in ("prometheus", "alertmanager"):
            (prometheus / "targets" / f"{job}.yml").write_text("[]")
        piece = re.search(r"```yaml\n# prometheus.yml\n(remote_write:.*?)```", PAGE, re.DOTALL)
        assert piece
        config = prometheus / "prometheus.yml"
        text = piece[1].replace("centre:9090", to).replace("yokohama", self.name)
        config.write_text(config.read_text() + textwrap.dedent(text))

    def ready(self) -> bool:
        """Whether the exporter receives both robots."""
        return http.get(self._exporter, "/metrics?collect[]=faults").count(b"robot_up{") == 2

    def firing(self) -> set[str]:
        """The alerts that fire here about components."""
        return {
            f"{labels['robot']} {labels['component']}"
            for labels in self.engine.firing()
            if "component" in labels
        }


class Centre:
    """What the centre knows."""

    def __init__(self, metrics: Engine, alerts: Engine) -> None:
        self.metrics = metrics
        self._alerts = alerts

    def firing(self) -> set[str]:
        """The alerts that fire at the centre: name, and site or component."""
        return {
            f"{labels['alertname']} {labels.get('site') or labels['component']}"
            for labels in self._alerts.firing()
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


def _prometheus_centre(site: Site) -> Centre:
    config, address = _centre_rules(site.folder / "centre"), site.addresses.prometheus
    option = "--web.enable-remote-write-receiver"
    site.start(servers.prometheus(site.folder, config, address, option))
    return Centre(site.engine, site.engine)


def _victoria_centre(site: Site) -> Centre:
    config = _centre_rules(site.folder / "centre")
    return Centre(*victoriametrics.start(site, str(config.parent / "rules" / "sites.yml")))


@pytest.fixture(params=["prometheus", "victoriametrics"])
def world(request: pytest.FixtureRequest, site: Site) -> tuple[Centre, Branch, Branch]:
    """The centre, the site north, and the site south, which has a vmagent at VictoriaMetrics."""
    victoria = request.param == "victoriametrics"
    centre = (_victoria_centre if victoria else _prometheus_centre)(site)
    site.wait_until_ready()
    branches = []
    for name in ("north", "south"):
        (site.folder / name).mkdir()
        branch = site.use(Site(site.folder / name))
        branches.append(Branch(branch, centre.metrics.address, vmagent=victoria))
    for each in branches:
        until(each.ready, f"the exporter of {each.name} receives both robots", 90)
    return centre, *branches


def test_a_site_that_is_cut_off_goes_on_alone_and_the_centre_catches_up(world):
    centre, north, south = world
    until(
        lambda: centre.metrics.value("count(site:ros_diagnostics_site:reached)") == 2,
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
    south.sender.restart()
    restarted = time.time()
    until(lambda: south.firing() == {"robot_2 Motor 1"}, "the alert after the restart", 60)
    assert centre.firing() == {"RosDiagnosticsSiteUnreachable south"}

    south.link.heal()
    centre.becomes("SitesCommonCause Motor 1")
    assert north.firing() == {"robot_1 Motor 1"}
    assert south.firing() == {"robot_2 Motor 1"}
    _catches_up(centre, south, restarted + 1)
    if on_victoria:
        _catches_up(centre, south, begin)
    else:  # what Prometheus had not sent before it was stopped
        lost = _missing(centre, south, begin, time.time() - 1)
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
    return centre.metrics.value(f'count({FAULTS}{{site="{site}"}})')


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
    return [each.labels for each in found]


def _missing(centre: Centre, site: Branch, begin: float, end: float) -> int:
    """How many evaluations of the site the centre has no sample of."""
    count = "sum(count_over_time({}[{:.0f}s]))"
    [own] = site.engine.query(count.format(EVALUATIONS, end - begin), at=end)
    of_site = f'{EVALUATIONS}{{site="{site.name}"}}'
    there = centre.metrics.query(count.format(of_site, end - begin), at=end)
    return int(own.value) - (int(there[0].value) if there else 0)


def _catches_up(centre: Centre, site: Branch, since: float) -> None:
    """Wait until nothing since then is missing at the centre."""
    end = time.time() - 1
    until(
        lambda: _missing(centre, site, since, end) == 0,
        lambda: f"{_missing(centre, site, since, end)} evaluations of {site.name} at the centre",
        60,
    )
