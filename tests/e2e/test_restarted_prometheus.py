"""A Prometheus that is killed in a fault and started after its repair sends nothing about it."""

import json
import time
from collections.abc import Iterator
from contextlib import ExitStack
from datetime import datetime, timezone
from pathlib import Path

import pytest
import yaml

from support.loopback import Request, replying
from support.served_fleet import serving
from testbed import http, short_clocks
from testbed.polling import until
from testbed.site import Site

pytestmark = [pytest.mark.slow, pytest.mark.timeout(240)]

LABELS = (
    'fleet="hall",fault="ec1ed754cf54",scope="component",state="critical",severity="critical",'
    'robot="r1",component="Motor 1",evidence="hot"'
)
SETTLED = 'ros_diagnostics_exporter_settled{fleet="hall"} 1\n'
BROKEN = f"{SETTLED}ros_diagnostics_fault_start_timestamp_seconds{{{LABELS}}} 2\n"
REPAIRED = (
    f'{SETTLED}ros_diagnostics_fault_end_timestamp_seconds{{{LABELS},reason="recovered"}} 20\n'
)
INTERVAL = 20  # seconds between evaluations of escalation; what was repaired has ended by the first
ESCALATED = 'ALERTS{alertname="RosDiagnosticsUnacknowledged", step="1", alertstate="firing"}'


class Hall:
    """One exporter's text, the Prometheus that reads it, and what this sends to Alertmanager."""

    def __init__(self, site: Site, context: ExitStack) -> None:
        self.site = site
        self.text = BROKEN
        self.sent: set[str] = set()  # the names of those that fire
        exporter = context.enter_context(serving(lambda _parts: self.text.encode()))
        alertmanager = context.enter_context(replying(self._receive))
        site.start_prometheus(
            exporters=[exporter], edit=lambda folder: shorten(folder, alertmanager)
        )

    def _receive(self, request: Request) -> bytes:
        """Take alerts as Alertmanager does."""
        now, alerts = datetime.now(timezone.utc).isoformat(), json.loads(request.body)
        self.sent.update(each["labels"]["alertname"] for each in alerts if each["endsAt"] > now)
        return b""

    def evaluated_at(self) -> float:
        """When escalation was last evaluated; it is so at the same times in all processes."""
        groups = http.get_json(self.site.addresses.prometheus, "/api/v1/rules")["data"]["groups"]
        [group] = [each for each in groups if each["name"].endswith(".escalation")]
        return datetime.fromisoformat(group["lastEvaluation"][:19] + "+00:00").timestamp()

    def evaluated(self, times: int) -> bool:
        """Whether escalation was evaluated so often since Prometheus was started."""
        metrics = http.get(self.site.addresses.prometheus, "/metrics").decode()
        counts = [
            float(line.rsplit(" ", 1)[1])
            for line in metrics.splitlines()
            if line.startswith("prometheus_rule_group_iterations_total") and "escalation" in line
        ]
        return counts != [] and counts[0] >= times


def shorten(folder: Path, alertmanager: str) -> None:
    """Let a first escalation be due soon, and alerts be sent to the given address."""
    short_clocks.set_escalation(folder / "rules", {"1": "2s"})
    short_clocks.edit(
        folder / "rules" / "escalation.yml",
        lambda document: document["groups"][0].update(interval=f"{INTERVAL}s"),
    )
    targets = yaml.safe_dump([{"targets": [alertmanager]}])
    (folder / "targets" / "alertmanager.yml").write_text(targets)


@pytest.fixture
def hall(site: Site) -> Iterator[Hall]:
    with ExitStack() as context:
        yield Hall(site, context)


def test_what_was_repaired_while_prometheus_was_away_neither_escalates_nor_fires(hall: Hall):
    hall.site.wait_until_ready()
    until(lambda: hall.site.query(ESCALATED), "it escalates", 60)
    evaluated_at = hall.evaluated_at()
    hall.site.prometheus.process.kill()
    hall.sent.clear()

    hall.text = REPAIRED
    until(lambda: (time.time() - evaluated_at) % INTERVAL < 1, "it is not evaluated soon", 60)
    hall.site.prometheus.process.start()
    hall.site.wait_until_ready()
    until(lambda: hall.evaluated(2), "escalation is evaluated again", 60)
    assert hall.site.query('ros_diagnostics_fault_end_timestamp_seconds{fleet="hall"}')
    wrong = {"RosDiagnosticsUnacknowledged", "RosDiagnosticsComponentCritical"}
    assert wrong.isdisjoint(each["alertname"] for each in hall.site.engine.firing())
    assert wrong.isdisjoint(hall.sent)
