"""docs/existing-servers.md: its pieces, added to servers that have jobs and routes of others.

The servers' configuration below is what such sites have; each piece goes, as text, under the key
that its first line names.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from typing import Any

import pytest
import yaml

from support.alerts import post_alerts
from support.existing_site import ALERTMANAGER, OWN_RULES, PROMETHEUS, added
from testbed import servers
from testbed.configuration import CHECKOUT
from testbed.mail import Inbox
from testbed.polling import until
from testbed.site import Site

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

FLEET = """\
fleet: hall
profiles: {{default: {{stale_after: 5s, confirm_after: 2s}}}}
discovery:
  - topic: "/{{robot}}/diagnostics_agg"
    domain_ids: [{domain}]
    labels: {{site: north, team: arms}}
"""


def alert(name: str, severity: str, **labels: str) -> dict[str, Any]:
    return {"labels": {"alertname": name, "severity": severity, "cluster": "prod", **labels}}


class Mails:
    """What the mail server received."""

    def __init__(self, inbox: Inbox) -> None:
        self.to = inbox.subjects

    def subjects(self) -> list[str]:
        """Of the mails about robots."""
        return self.to("robots@localhost")

    def until_robots(self, *subjects: str, seconds: float = 60) -> None:
        """Wait until exactly these were sent about robots, in this order."""
        until(lambda: len(self.subjects()) >= len(subjects), lambda: str(self.subjects()), seconds)
        assert self.subjects() == list(subjects)


@pytest.fixture
def mails(site: Site) -> Mails:
    return Mails(site.inbox)


@pytest.fixture
def alertmanager(site: Site) -> str:
    """The address of an Alertmanager that others use, with the page's pieces."""
    name = "alertmanager.yml"
    config = site.write(name, added(ALERTMANAGER.format(smtp=site.addresses.smtp), name))
    shutil.copytree(CHECKOUT / "alertmanager" / "templates", site.folder / "ros-diagnostics")
    site.start_mail_server()
    address = site.addresses.alertmanager
    site.start(servers.alertmanager(site.folder, config, address)).wait_until_ready()
    return address


def test_what_others_have_goes_on(alertmanager: str, mails: Mails):
    post_alerts(
        alertmanager,
        alert("Watchdog", "none"),
        alert("RosDiagnosticsWatchdog", "info"),
        alert("DiskFull", "warning", disk="sda"),
        alert("DiskFull", "warning", disk="sdb"),
        alert("HostDown", "critical"),
        alert("HostDown", "warning"),
    )
    until(lambda: mails.to("ops@example.org"), "the mail about disks", 120)
    until(lambda: mails.to("pager@example.org"), "the mail about hosts", 60)

    assert mails.to("ops@example.org") == ["[FIRING:2] DiskFull prod (warning)"]
    assert mails.to("pager@example.org") == ["[FIRING:1] HostDown prod (critical)"]
    assert mails.to("heartbeat@example.org")
    assert not mails.subjects()


def test_a_critical_alert_mutes_no_warning_about_another_robot(alertmanager: str, mails: Mails):
    of = {"fleet": "hall", "scope": "robot", "state": "many"}
    critical = alert("RosDiagnosticsManyComponents", "critical", robot="r1", **of)
    post_alerts(alertmanager, critical)
    until(lambda: len(mails.subjects()) == 1, lambda: str(mails.subjects()), 60)
    post_alerts(alertmanager, alert("RosDiagnosticsManyComponents", "warning", robot="r2", **of))
    until(lambda: len(mails.subjects()) == 2, lambda: str(mails.subjects()), 60)

    assert ["r1" in mails.subjects()[0], "r2" in mails.subjects()[1]] == [True, True]


class Chain:
    """Two virtual robots, their exporter, and a Prometheus and an Alertmanager that others use."""

    def __init__(self, site: Site) -> None:
        self.site = site
        site.start_robots(2)
        fleet = site.write("fleet.yml", FLEET.format(domain=site.domain_id))
        self.exporter = site.start_exporter(fleet)
        until(lambda: len(self.exporter.receives()) == 2, "the exporter receives both robots", 120)

    def start(self, interval: str, edit: Callable[[str], str] = str) -> None:
        """Start Prometheus; ``edit`` changes the text of prometheus.yml."""
        site, name = self.site, "prometheus.yml"
        text = PROMETHEUS.format(
            interval=interval,
            prometheus=site.addresses.prometheus,
            alertmanager=site.addresses.alertmanager,
        )
        text = added(text, name).replace("localhost:9877", self.exporter.address)
        site.write("own/rules.yml", OWN_RULES)
        for rules in (CHECKOUT / "prometheus" / "rules").glob("*.yml"):
            if rules.name != "servers.yml":
                shutil.copy(rules, site.folder / "ros-diagnostics" / rules.name)
        config, address = site.write(name, edit(text)), site.addresses.prometheus
        site.start(servers.prometheus(site.folder, config, address)).wait_until_ready()

    def firing(self) -> set[str]:
        return {labels["alertname"] for labels in self.site.engine.firing()}


@pytest.fixture
def chain(site: Site, alertmanager: str) -> Chain:
    return Chain(site)


def test_two_faults_within_a_minute_are_two_mails(chain: Chain, mails: Mails):
    chain.start("60s", lambda text: with_labels(text, chain.exporter.address, "{env: prod}"))
    until(lambda: chain.site.query("ros_diagnostics_exporter_settled == 1"), "a scrape", 120)
    until(lambda: {"Watchdog", "DiskFull"} <= chain.firing(), "the rules of others", 120)

    problems = [
        f"** PROBLEM ** hall/{robot} Motor 1 is CRITICAL" for robot in ("robot_1", "robot_2")
    ]
    chain.site.fault("robot_1", "Motor 1", "error")
    mails.until_robots(problems[0], seconds=150)
    chain.site.fault("robot_2", "Motor 1", "error")
    mails.until_robots(*problems, seconds=150)
    assert {each for each in chain.firing() if each.startswith("Ros")} == {
        "RosDiagnosticsComponentCritical"
    }

    chain.site.fault("robot_1", "Motor 1", "ok")
    recovery = "** RECOVERY ** hall/robot_1 Motor 1 is no longer CRITICAL"
    mails.until_robots(*problems, recovery, seconds=150)
    assert not mails.to("pager@example.org")


def with_labels(text: str, exporter: str, labels: str) -> str:
    """The configuration with labels on the exporter's target."""
    config = yaml.safe_load(text)
    (group,) = next(
        job["static_configs"] for job in config["scrape_configs"] if job["job_name"] == "robots"
    )
    assert group["targets"] == [exporter]
    group["labels"] = yaml.safe_load(labels)
    return yaml.safe_dump(config)


@pytest.mark.parametrize("label", ["fleet: workshop", "team: ops"])
def test_labels_that_hide_the_exporters_own_are_one_alert(chain: Chain, label: str):
    def edit(text: str) -> str:
        text = re.sub(r"^ +honor_labels: true.*\n", "", text, flags=re.MULTILINE)
        return with_labels(text, chain.exporter.address, f"{{{label}}}")

    chain.start("15s", edit)

    until(lambda: "RosDiagnosticsScrapeLabels" in chain.firing(), lambda: str(chain.firing()), 240)
