"""docs/existing-servers.md: its pieces, added to servers that have jobs and routes of others.

The servers' configuration below is what such sites have; each piece goes, as text, under the key
that its first line names.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
import yaml

from support.alerts import post_alerts
from support.existing_site import ALERTMANAGER, OWN_RULES, PROMETHEUS, added
from support.prometheus_site import Site
from testbed import domains, http, programs, servers
from testbed.configuration import CHECKOUT
from testbed.mail import Inbox, Mail, MailServer
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process

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

    def __init__(self) -> None:
        self.inbox = Inbox()

    def to(self, recipient: str) -> list[Mail]:
        return [mail for mail in self.inbox.mails() if mail.recipients == (recipient,)]

    def subjects(self) -> list[str]:
        """Of the mails about robots."""
        return [mail.subject for mail in self.to("robots@localhost")]

    def until_robots(self, *subjects: str, seconds: float = 60) -> None:
        """Wait until exactly these were sent about robots, in this order."""
        until(lambda: len(self.subjects()) >= len(subjects), lambda: str(self.subjects()), seconds)
        assert self.subjects() == list(subjects)


@pytest.fixture
def mails() -> Mails:
    return Mails()


@pytest.fixture
def alertmanager(tmp_path: Path, mails: Mails) -> Iterator[str]:
    """The address of an Alertmanager that others use, with the page's pieces."""
    smtp = f"127.0.0.1:{free_port()}"
    config = tmp_path / "alertmanager.yml"
    config.write_text(added(ALERTMANAGER.format(smtp=smtp), config.name))
    shutil.copytree(CHECKOUT / "alertmanager" / "templates", tmp_path / "ros-diagnostics")
    mail_server = MailServer(smtp, mails.inbox)
    mail_server.start()
    server = servers.alertmanager(tmp_path, config, f"127.0.0.1:{free_port()}")
    try:
        with servers.running(server):
            yield server.address
    finally:
        mail_server.stop()


def broken(robot: str) -> dict[str, Any]:
    of = {"fleet": "hall", "robot": robot, "scope": "component", "state": "critical"}
    return alert("RosDiagnosticsComponentCritical", "critical", **of, component="Motor 1")


def test_every_fault_is_a_mail_of_its_own_at_once(alertmanager: str, mails: Mails):
    """The group's second mail would come after group_interval, 5 minutes: later than waited for."""
    post_alerts(alertmanager, broken("r1"))
    mails.until_robots("** PROBLEM ** hall/r1 Motor 1 is CRITICAL")
    post_alerts(alertmanager, broken("r2"))
    mails.until_robots(
        "** PROBLEM ** hall/r1 Motor 1 is CRITICAL", "** PROBLEM ** hall/r2 Motor 1 is CRITICAL"
    )
    assert not mails.to("pager@example.org")


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

    assert [mail.subject for mail in mails.to("ops@example.org")] == [
        "[FIRING:2] DiskFull prod (warning)"
    ]
    assert [mail.subject for mail in mails.to("pager@example.org")] == [
        "[FIRING:1] HostDown prod (critical)"
    ]
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

    def __init__(self, folder: Path, mails: Mails, alertmanager: str) -> None:
        self.folder = folder
        self.mails = mails
        self.exporter = f"127.0.0.1:{free_port()}"
        self.site = Site(f"127.0.0.1:{free_port()}", alertmanager)
        self._ending = ExitStack()
        self._domain = self._ending.enter_context(domains.lease())
        log = {"ROS_LOG_DIR": str(folder / "ros-log")}
        self._environment = domains.environment(self._domain) | log

    def start(self, interval: str, edit: Callable[[str], str] = str) -> None:
        """Start all; ``edit`` changes the text of prometheus.yml."""
        (self.folder / "fleet.yml").write_text(FLEET.format(domain=self._domain))
        storage = self.folder / "state"
        self._run("robots", programs.virtual_robots(2, 1, self._domain))
        self._run(
            "exporter",
            programs.exporter(
                self.folder / "fleet.yml", self.exporter, storage, self.site.alertmanager
            ),
        )
        until(self._receives_both, "the exporter receives both robots", 120)
        config = self.folder / "prometheus.yml"
        text = PROMETHEUS.format(interval=interval, **self._servers())
        config.write_text(edit(added(text, config.name).replace("localhost:9877", self.exporter)))
        self._copy_rules()
        server = servers.prometheus(self.folder, config, self.site.prometheus)
        self._ending.enter_context(servers.running(server))

    def _servers(self) -> dict[str, str]:
        return {"prometheus": self.site.prometheus, "alertmanager": self.site.alertmanager}

    def _copy_rules(self) -> None:
        (self.folder / "own").mkdir()
        (self.folder / "own" / "rules.yml").write_text(OWN_RULES)
        for rules in (CHECKOUT / "prometheus" / "rules").glob("*.yml"):
            if rules.name != "servers.yml":
                shutil.copy(rules, self.folder / "ros-diagnostics" / rules.name)

    def _run(self, name: str, argv: list[str]) -> None:
        process = Process(name, argv, self._environment, self.folder / f"{name}.log")
        self._ending.callback(process.stop)
        process.start()

    def _receives_both(self) -> bool:
        if not http.answers(self.exporter, "/-/ready"):
            return False
        robots = http.get_json(self.exporter, "/api/v1/fleet")["robots"]
        return [each["up"] for each in robots] == [True, True]

    def fault(self, robot: str, level: str) -> None:
        argv = programs.fault(robot, "Motor 1", level, "", self._domain)
        done = Process("fault", argv, self._environment, self.folder / f"{robot}-{level}.log")
        done.start()
        until(lambda: not done.alive, done.describe, 60)
        assert done.exit_code == 0, done.describe()

    def firing(self) -> set[str]:
        alerts = self.site.alerts()
        return {each["labels"]["alertname"] for each in alerts if each["state"] == "firing"}

    def stop(self) -> None:
        self._ending.close()


@pytest.fixture
def chain(tmp_path: Path, mails: Mails, alertmanager: str) -> Iterator[Chain]:
    chain = Chain(tmp_path, mails, alertmanager)
    yield chain
    chain.stop()


@pytest.mark.parametrize("interval", ["15s", "60s"])
def test_two_faults_within_a_minute_are_two_mails(chain: Chain, interval: str):
    chain.start(interval, lambda text: with_labels(text, chain.exporter, "{env: prod}"))
    until(lambda: chain.site.query("ros_diagnostics_exporter_settled == 1"), "a scrape", 120)
    until(lambda: {"Watchdog", "DiskFull"} <= chain.firing(), "the rules of others", 120)

    problems = [
        f"** PROBLEM ** hall/{robot} Motor 1 is CRITICAL" for robot in ("robot_1", "robot_2")
    ]
    chain.fault("robot_1", "error")
    chain.mails.until_robots(problems[0], seconds=150)
    chain.fault("robot_2", "error")
    chain.mails.until_robots(*problems, seconds=150)
    assert {each for each in chain.firing() if each.startswith("Ros")} == {
        "RosDiagnosticsComponentCritical"
    }

    chain.fault("robot_1", "ok")
    recovery = "** RECOVERY ** hall/robot_1 Motor 1 is no longer CRITICAL"
    chain.mails.until_robots(*problems, recovery, seconds=150)
    assert not chain.mails.to("pager@example.org")


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
        return with_labels(text, chain.exporter, f"{{{label}}}")

    chain.start("15s", edit)

    until(lambda: "RosDiagnosticsScrapeLabels" in chain.firing(), lambda: str(chain.firing()), 240)
