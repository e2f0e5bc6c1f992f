"""The shipped queries of hosts, with all real servers: a host's disk is a row like a motor.

node_exporter reads a folder in place of /proc, so that the test says what the load is.
"""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
from contextlib import ExitStack
from http.server import BaseHTTPRequestHandler
from math import inf
from pathlib import Path
from typing import Any

import pytest
import yaml

from ros_diagnostics_tools.main import main
from support import host_checks, prometheus_site, short_clocks
from support.link import Link
from support.loopback import answering
from testbed import domains, programs
from testbed.configuration import CHECKOUT
from testbed.http import answers, get, get_json
from testbed.mail import Inbox, MailServer
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process

pytestmark = pytest.mark.slow

QUERIES = CHECKOUT / "docs" / "examples" / "queries" / "queries.d" / "hosts.yml"
FLEET = """
fleet: hall
robots:
  - name: robot_1
    namespace: /robot_1
    domain_id: {domain}
    address: 127.0.0.1
    labels: {{uplink: ap_1}}
  - {{name: ap_1, source: queries, address: 127.0.0.1}}
faults: {{restart_grace: 1s}}
"""


class Page(BaseHTTPRequestHandler):
    """A page that is found."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()


class Site:
    """A robot whose computer is measured; its exporter, Prometheus and mails."""

    def __init__(self, folder: Path, inbox: Inbox) -> None:
        self.folder = folder
        self.inbox = inbox
        self.exporter = ""
        self.prometheus: Link  # as the exporter reaches it
        self.uplink: Link  # as it is probed
        self.robots: Process
        self.alertmanager = ""
        self.servers: prometheus_site.Site
        self.load(0.5)

    def load(self, one: float) -> None:
        """Set the load average."""
        proc = self.folder / "proc"
        proc.mkdir(exist_ok=True)
        new = proc / "new"
        new.write_text(f"{one:.2f} 0.10 0.10 1/100 200\n")
        new.rename(proc / "loadavg")  # never half a file

    def robot(self) -> dict[str, Any]:
        """The robot as the API has it."""
        robots = get_json(self.exporter, "/api/v1/fleet")["robots"]
        return next(dict(each) for each in robots if each["robot"] == "robot_1")

    def component(self, name: str) -> dict[str, Any]:
        """A component of the robot; empty if there is none."""
        found = (each for each in self.robot()["components"] if each["component"] == name)
        return next(found, {})

    def level(self, name: str) -> str:
        return str(self.component(name).get("level"))

    def subjects(self) -> list[str]:
        return [mail.subject for mail in self.inbox.mails()]


def queries(folder: Path) -> list[dict[str, Any]]:
    """The shipped ones, asked often and confirmed soon; the disk is WARN as full as it is now."""
    found = os.statvfs(folder)
    free = 100 * found.f_bavail / found.f_blocks
    entries: list[dict[str, Any]] = yaml.safe_load(QUERIES.read_text())
    for each in entries:
        each.update({"interval": "5s", "stale_after": "10s", "confirm_after": "1s"})
        if each["component"].startswith("disk"):
            each["thresholds"] = {"low": {"warning": free + 1, "critical": 0}}
    return entries


def mails_to(smtp: str) -> Any:
    """Edits Alertmanager's configuration."""

    def change(config: dict[str, Any]) -> None:
        config["global"]["smtp_smarthost"] = smtp
        config["route"]["group_interval"] = "1s"
        for receiver in config["receivers"]:
            receiver.pop("webhook_configs", None)

    return change


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    inbox, smtp = Inbox(), f"127.0.0.1:{free_port()}"
    found = Site(tmp_path, inbox)
    (tmp_path / "proc" / "1").mkdir()
    (tmp_path / "proc" / "1" / "mounts").write_text(f"/dev/disk {tmp_path} ext4 rw 0 0\n")
    exporter, prometheus = (f"127.0.0.1:{free_port()}" for _ in range(2))
    found.exporter = exporter
    with ExitStack() as stack:
        mail_server = MailServer(smtp, inbox)
        stack.callback(mail_server.stop)
        mail_server.start()
        page = stack.enter_context(answering(Page))
        node, blackbox = stack.enter_context(
            host_checks.running(
                tmp_path,
                "--collector.disable-defaults",
                "--collector.loadavg",
                "--collector.filesystem",
                f"--path.procfs={tmp_path / 'proc'}",
            )
        )
        domain = stack.enter_context(domains.lease())
        (tmp_path / "queries.d").mkdir()
        (tmp_path / "queries.d" / "hosts.yml").write_text(yaml.safe_dump(queries(tmp_path)))
        (tmp_path / "fleet.yml").write_text(FLEET.format(domain=domain))
        found.prometheus, found.uplink = Link(prometheus), Link(page)
        stack.callback(found.prometheus.close)
        stack.callback(found.uplink.close)
        commands = {
            "robots": programs.virtual_robots(1, 1, domain),
            "exporter": [
                *programs.exporter(
                    tmp_path / "fleet.yml", exporter, tmp_path / "db", "127.0.0.1:1"
                ),
                f"--prometheus.url=http://{found.prometheus.address}",
            ],
        }
        for name, argv in commands.items():
            process = Process(name, argv, domains.environment(domain), tmp_path / f"{name}.log")
            stack.callback(process.stop)
            process.start()
            if name == "robots":
                found.robots = process
        until(lambda: answers(exporter, "/-/ready"), "the exporter is ready", 120)
        port = page.rpartition(":")[2]
        jobs = host_checks.jobs(
            {
                "localhost:9877": exporter,
                "localhost:9115": blackbox,
                "/sd/node": f"/sd/node?port={node.rpartition(':')[2]}",
                "/sd/http": f"/sd/http?port={port}",
                "?port=11311": f"?port={port}",
                # What may not send pings finds every host down (test_hosts.py).
                "[icmp]": "[tcp_connect]",
                "/sd/uplink": f"/sd/uplink?port={found.uplink.address.rpartition(':')[2]}",
            },
            ["ros-diagnostics-ping", "ros-diagnostics-ssh"],  # nobody serves SSH
        )
        servers = stack.enter_context(
            prometheus_site.running(
                tmp_path,
                {"hall": exporter},
                probes=jobs,
                receivers=mails_to(smtp),
                prepare=lambda prometheus: short_clocks.scale(prometheus / "rules"),
                prometheus=prometheus,
            )
        )
        found.servers, found.alertmanager = servers, servers.alertmanager
        yield found


def test_a_hosts_disk_load_and_services_are_components_with_a_mail_and_a_recovery(
    site: Site, capsys: pytest.CaptureFixture[str]
):
    disk = f"disk {site.folder}"
    until(lambda: site.level(disk) == "WARN", lambda: str(site.robot()["components"]), 60)
    until(lambda: site.level("load 1m") == "OK", "the load is measured", 60)
    until(lambda: site.level("http") == site.level("node_exporter") == "OK", "the services", 60)
    assert site.component(disk)["group"] == "Host"
    text = get(site.exporter, "/metrics").decode()
    assert f'component="{disk}"' in text
    assert disk in get(site.exporter, "/robots/robot_1").decode()

    site.load(11)
    problem = "** PROBLEM ** hall/robot_1 load 1m is CRITICAL"
    until(lambda: problem in site.subjects(), lambda: str(site.subjects()), 90)
    url = f"http://{site.alertmanager}"
    who = ("--author", "ann", "--comment", "a map is being built", "--alertmanager", url)
    assert main(["ack", "robot_1", "load 1m", *who]) == 0
    assert "hall/robot_1 load 1m CRITICAL" in capsys.readouterr().out
    site.load(0.5)
    recovery = "** RECOVERY ** hall/robot_1 load 1m is no longer CRITICAL"
    until(lambda: recovery in site.subjects(), lambda: str(site.subjects()), 90)


def test_without_prometheus_components_are_stale_no_fault_begins_or_ends_and_one_alert_fires(
    site: Site,
):
    disk = f"disk {site.folder}"

    def faults() -> list[tuple[str, str]]:
        found = get_json(site.exporter, "/api/v1/faults")["faults"]
        return [(each["component"], each["state"]) for each in found if each["robot"]]

    until(lambda: (disk, "warning") in faults(), lambda: str(faults()), 60)

    def errors() -> dict[str, str]:
        queries = get_json(site.exporter, "/api/v1/fleet")["queries"]
        return {each["name"]: each["error"] for each in queries if each["error"]}

    def alerts() -> list[str]:
        """What the exporter says of its queries, of each alert."""
        found = site.servers.alerts()
        own = [each for each in found if each["labels"]["alertname"].endswith("ExporterFault")]
        fails = [each for each in own if each["labels"]["component"] == "queries"]
        return [each["annotations"]["evidence"] for each in fails if each["state"] == "firing"]

    until(lambda: not errors() and not alerts(), lambda: str(errors()), 60)
    before = faults()

    # The exporter no longer reaches Prometheus, which itself goes on.
    site.prometheus.cut()
    until(lambda: site.level(disk) == "STALE", "the disk is STALE", 60)
    until(lambda: site.level("load 1m") == "STALE", "so is the load", 60)
    until(alerts, "it fires that the queries fail", 120)
    (all_queries,) = alerts()
    number = len(queries(site.folder))
    assert f"{number} of {number} have no answer" in all_queries
    assert site.robot()["up"]
    assert faults() == before
    site.prometheus.heal()
    until(lambda: site.level(disk) == "WARN", "the disk is measured again", 60)
    until(lambda: not alerts(), "the queries are answered", 60)
    assert faults() == before

    wrong = [*queries(site.folder), {"expr": "no_such(", "component": "wrong"}]
    (site.folder / "queries.d" / "hosts.yml").write_text(yaml.safe_dump(wrong))
    until(lambda: "parse error" in errors().get("Host/wrong", ""), lambda: str(errors()), 60)
    until(alerts, "it fires that one fails", 120)
    assert errors().keys() == {"Host/wrong"}
    assert f"1 of {number + 1} have no answer: Host/wrong: " in " ".join(alerts())
    fired = site.servers.query('ALERTS_FOR_STATE{component="queries"}[1h]')
    assert len({value for series in fired for _at, value in series["values"]}) == 2


def test_an_uplink_that_is_gone_is_one_mail_and_its_robot_none(site: Site):
    until(lambda: site.robot()["up"] and site.level("http") == "OK", "the robot is well", 90)
    site.uplink.cut()
    site.robots.stop()
    problem = "** PROBLEM ** hall/ap_1 uplink is CRITICAL"
    until(lambda: problem in site.subjects(), lambda: str(site.subjects()), 90)

    def silence() -> dict[str, Any]:
        found = (each for each in site.robot()["problems"] if each["state"] == "silent")
        return next(found, {"due": inf, "quiet": ""})

    # All that could have made it a fault is over.
    until(lambda: time.time() > silence()["due"], lambda: str(silence()), 90)
    assert silence()["quiet"] == "unreachable"
    assert site.robot()["silent_reason"] == "uplink_down"

    site.uplink.heal()
    site.robots.start()
    recovery = "** RECOVERY ** hall/ap_1 uplink is no longer CRITICAL"
    until(lambda: recovery in site.subjects(), lambda: str(site.subjects()), 90)
    until(lambda: site.robot()["up"], "the robot is back", 90)
    disk = "** PROBLEM ** hall/robot_1 disk"
    assert [each for each in site.subjects() if not each.startswith(disk)] == [problem, recovery]


def test_in_maintenance_a_hosts_fault_is_quiet_and_one_that_outlives_it_a_mail_at_its_end(
    site: Site,
):
    until(lambda: site.robot()["up"] and site.level("load 1m") == "OK", "the load", 120)
    folder = site.folder / "maintenance.d"
    folder.mkdir()
    window = folder / "robot_1.yml"
    weekly = ["daily 00:00-24:00"]
    of = {"name": "computer", "comment": "new one", "selector": {"robot": "robot_1"}}
    window.write_text(yaml.safe_dump({**of, "weekly": weekly}))
    until(lambda: site.robot()["maintenance"], "the maintenance", 60)
    site.load(11)

    def problem() -> dict[str, Any]:
        found = (each for each in site.robot()["problems"] if each["component"] == "load 1m")
        return next(found, {"due": inf, "quiet": ""})

    until(lambda: time.time() > problem()["due"], lambda: str(problem()), 90)
    assert problem()["quiet"] == "maintenance"
    subject = "** PROBLEM ** hall/robot_1 load 1m is CRITICAL"
    assert subject not in site.subjects()
    window.unlink()
    until(lambda: subject in site.subjects(), lambda: str(site.subjects()), 120)
    assert site.subjects().count(subject) == 1
