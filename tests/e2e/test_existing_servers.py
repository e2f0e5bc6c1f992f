"""docs/existing-servers.md: its pieces, added to servers that have jobs and routes of others.

The servers' configuration below is what such sites have; each piece goes, as text, under the key
that its first line names.
"""

import re
import shutil
from collections.abc import Callable
from typing import Any

import pytest
import yaml

from ros_diagnostics_exporter.robots.limits import MAX_TEXT
from support.alerts import post_alerts
from support.existing_site import (
    ALERTMANAGER,
    OWN_RULES,
    PAGE,
    PROMETHEUS,
    STACK,
    added,
    exempted,
)
from support.loopback import replying
from testbed import http, servers
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
    return with_pieces(site, ALERTMANAGER)


def with_pieces(site: Site, others: str) -> str:
    """The address of an Alertmanager with the configuration of others and the page's pieces."""
    name = "alertmanager.yml"
    text = added(others.format(smtp=site.addresses.smtp), name)
    config = site.write(name, exempted(text))
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
        alert("HostDown", "critical", cluster="lab"),
        alert("HostDown", "warning", cluster="lab"),
    )
    until(lambda: mails.to("ops@example.org"), "the mail about disks", 120)
    until(lambda: mails.to("pager@example.org"), "the mail about hosts", 60)

    assert mails.to("ops@example.org") == ["[FIRING:2] DiskFull prod (warning)"]
    assert mails.to("pager@example.org") == ["[FIRING:1] HostDown lab (critical)"]
    assert mails.to("heartbeat@example.org")
    assert not mails.subjects()


def test_a_robot_suppresses_no_warning_of_the_site_and_the_site_none_of_a_robot(
    alertmanager: str,
):
    of = {"fleet": "hall", "scope": "robot", "state": "many"}
    post_alerts(
        alertmanager,
        alert("RosDiagnosticsManyComponents", "critical", robot="r1", **of),
        alert("RobotGripperDown", "critical", robot="r1"),
        alert("RosDiagnosticsManyComponents", "warning", robot="r2", **of),
        alert("RobotDiskFillsUp", "warning", robot="r2"),
        alert("DiskFull", "warning"),
        alert("HostDown", "critical", cluster="lab"),
        alert("RosDiagnosticsManyComponents", "warning", robot="r3", **of, cluster="lab"),
        alert("DiskFull", "warning", cluster="lab"),
    )

    until(lambda: suppressed(alertmanager), "the site's own inhibition", 60)
    assert suppressed(alertmanager) == [("DiskFull", "warning", "lab")]
    groups = http.get_json(alertmanager, "/api/v2/alerts/groups")
    receivers = {
        (each["labels"]["alertname"], group["receiver"]["name"])
        for group in groups
        for each in group["alerts"]
        if each["labels"]["alertname"].startswith("Robot")
    }
    assert receivers == {
        ("RobotGripperDown", "robots"),
        ("RobotDiskFillsUp", "robots"),
    }


def suppressed(alertmanager: str) -> list[tuple[str, str, str]]:
    """Name, severity and cluster of the alerts that are inhibited, in this order."""
    names = ("alertname", "severity", "cluster")
    return sorted(
        tuple(each["labels"][name] for name in names)
        for each in http.get_json(alertmanager, "/api/v2/alerts")
        if each["status"]["inhibitedBy"]
    )


def test_with_the_inhibitions_of_a_cluster_no_alert_about_robots_is_suppressed(
    site: Site,
):
    alertmanager = with_pieces(site, STACK)
    of = {"fleet": "hall", "scope": "robot", "state": "many"}
    post_alerts(
        alertmanager,
        *(
            alert(name, severity, robot=f"r{number}", **of)
            for name in ("RosDiagnosticsManyComponents", "RobotGripperDown")
            for number, severity in enumerate(("critical", "warning", "info"), 1)
        ),
        alert("InfoInhibitor", "none"),
        alert("PodCrashes", "critical", namespace="shop"),
        alert("PodCrashes", "warning", namespace="shop"),
        alert("NodeIsBusy", "info"),
    )
    theirs = [
        ("InfoInhibitor", "none", "prod"),
        ("NodeIsBusy", "info", "prod"),
        ("PodCrashes", "warning", "prod"),
    ]

    until(lambda: len(suppressed(alertmanager)) >= len(theirs), "the cluster's inhibitions", 60)
    assert suppressed(alertmanager) == theirs


def test_a_long_message_stops_the_scrape_below_the_limit_of_the_page(site: Site):
    text = "\N{ROBOT FACE}" * MAX_TEXT  # as long as the exporter lets one be
    body = f'ros_diagnostics_component_message{{message="{text}"}} 1\n'.encode()
    target = site.use(replying(lambda _request: body))
    sentence = r"`label_value_length_limit` .* has to be (\d+) or more"
    (limit,) = re.findall(sentence, PAGE.read_text())
    jobs = "".join(
        f"- job_name: {name}\n"
        f"  scrape_interval: 1s\n"
        f"  label_value_length_limit: {value}\n"
        f'  static_configs: [{{targets: ["{target}"]}}]\n'
        for name, value in (("as_the_page", int(limit)), ("below", int(limit) - 1))
    )
    config = site.write("prometheus.yml", f"scrape_configs:\n{jobs}")
    site.start(
        servers.prometheus(site.folder, config, site.addresses.prometheus)
    ).wait_until_ready()

    until(lambda: site.query('up{job="as_the_page"} == 1'), "the scrape with the limit", 60)
    until(lambda: site.query('up{job="below"} == 0'), "the scrape below the limit", 60)
    assert not site.query('up{job="below"} == 1')


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
