"""The shipped rules, unchanged but for short durations, on every engine that may evaluate them.

A fault and its recovery, the death of the exporter in it, and a silent robot, on Prometheus 3 (in
the folder $PROMETHEUS_3) with concurrent evaluation, and on vmalert over VictoriaMetrics; on the
Prometheus in PATH the rule scenarios play them.
"""

import os

import pytest

from support import victoriametrics
from support.orders import Orders
from testbed import configuration, http
from testbed.engine import Engine
from testbed.polling import until
from testbed.processes import Process
from testbed.site import Site

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


class Fleet:
    """Two robots, their exporter and one engine; which alerts fire."""

    def __init__(self, site: Site, engine: Engine) -> None:
        self.exporter: Process = site.exporter.process
        self.address = site.exporter.address
        self.orders = site.use(Orders(site.domain_id))
        self._engine = engine

    def firing(self) -> set[str]:
        """The alerts about the fleet."""
        return {
            " ".join(filter(None, (name, labels.get("robot"), labels.get("component"))))
            for labels in self._engine.firing()
            for name in [labels["alertname"].removeprefix("RosDiagnostics")]
            if labels.get("fleet") == "hall" and name != "ExporterFault"  # it has no Alertmanager
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
        return http.get(self.address, "/metrics?collect[]=faults").count(b"robot_up{") == 2


@pytest.fixture(params=["concurrent", "vmalert"])
def fleet(request: pytest.FixtureRequest, site: Site, monkeypatch: pytest.MonkeyPatch) -> Fleet:
    if request.param == "concurrent":
        if "PROMETHEUS_3" not in os.environ:
            pytest.skip("no Prometheus 3: its folder in PROMETHEUS_3")
        monkeypatch.setenv("PROMETHEUS", f"{os.environ['PROMETHEUS_3']}/prometheus")
    site.start_robots(2)
    site.start_exporter(site.write("fleet.yml", FLEET.format(domain=site.domain_id)))
    if request.param == "vmalert":
        engine = _vmalert(site)
    else:
        concurrently = "--enable-feature=concurrent-rule-eval"
        site.start_prometheus(concurrently, interval=SECONDS, tenth=True)
        engine = site.engine
    site.wait_until_ready()
    return Fleet(site, engine)


def _vmalert(site: Site) -> Engine:
    config = configuration.prometheus(
        site.folder, [site.exporter.address], site.addresses, interval=SECONDS, tenth=True
    )
    scraping = (
        f"-promscrape.config={config}",
        "-promscrape.config.strictParse=false",  # it evaluates no rules itself
    )
    return victoriametrics.start(site, str(config.parent / "rules" / "*.yml"), *scraping).alerts


def test_a_fault_the_death_of_its_exporter_and_a_silent_robot(fleet: Fleet):
    until(fleet.ready, "the exporter receives both robots", 60)
    fleet.becomes()

    fleet.orders.give([("robot_1/Motor 1", "error")])
    fleet.becomes(CRITICAL)

    fleet.exporter.kill()
    fleet.becomes(CRITICAL, DOWN, keeps=CRITICAL)
    fleet.exporter.start()
    fleet.becomes(CRITICAL, keeps=CRITICAL)

    fleet.orders.give([("robot_2", "hang")])
    fleet.becomes(CRITICAL, SILENT, keeps=CRITICAL)
    fleet.orders.give([("robot_1/Motor 1", "ok")])
    fleet.becomes(SILENT)
    fleet.orders.give([("robot_2", "resume")])
    fleet.becomes()
