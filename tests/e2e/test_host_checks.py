"""The checks of rules/hosts.yml, with all real servers, down to the mails.

node_exporter reads a folder in place of /proc, so that the test says what the load is.
"""

from __future__ import annotations

import os
import socketserver
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any

import pytest

from ros_diagnostics_tools.commands import ack
from support import host_checks, prometheus_site, short_clocks
from support.link import Link
from support.loopback import answering, serving
from testbed import domains, programs
from testbed.http import answers, get_json
from testbed.mail import Inbox, MailServer
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process

pytestmark = pytest.mark.slow

FLEET = """
fleet: hall
robots:
  - name: robot_1
    namespace: /robot_1
    domain_id: {domain}
    address: 127.0.0.1
    labels: {{site: north}}
"""
CONFIRM_AFTER = 3  # seconds, of which Prometheus evaluates one after another


class Computer:
    """What node_exporter finds in place of /proc."""

    def __init__(self, folder: Path) -> None:
        self.proc = folder / "proc"
        (self.proc / "sys" / "kernel").mkdir(parents=True)
        for name in ("threads-max", "pid_max"):
            (self.proc / "sys" / "kernel" / name).write_text("32768\n")
        self.load(0.5)
        self.processes(100)
        (self.proc / "1" / "mounts").write_text(f"/dev/disk {folder} ext4 rw 0 0\n")

    def load(self, one: float, five: float = 0.1, fifteen: float = 0.1) -> None:
        """Set the load averages."""
        text = f"{one:.2f} {five:.2f} {fifteen:.2f} 1/100 200\n"
        new = self.proc / "new"
        new.write_text(text)
        new.rename(self.proc / "loadavg")  # never half a file

    def processes(self, number: int) -> None:
        """Let there be processes 1 to ``number``, as this one."""
        stat = Path("/proc/self/stat").read_text().partition(" ")[2]
        for pid in range(1, number + 1):
            (self.proc / str(pid)).mkdir(exist_ok=True)
            (self.proc / str(pid) / "stat").write_text(f"{pid} {stat}")


class Banner(socketserver.BaseRequestHandler):
    """What an SSH server sends first."""

    def handle(self) -> None:
        self.request.sendall(b"SSH-2.0-test\r\n")


class Page(BaseHTTPRequestHandler):
    """A page that is found."""

    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()


class Site:
    """The servers, the robot's computer, links to its services, and mails."""

    def __init__(self, computer: Computer, services: dict[str, Link], inbox: Inbox) -> None:
        self.computer = computer
        self.services = services
        self._inbox = inbox
        self._seen = 0
        self.servers: prometheus_site.Site

    def wait_for(self, *subjects: str) -> None:
        """Wait until just these mails have come since the last time, in any order."""

        def new() -> list[str]:
            return sorted(mail.subject for mail in self._inbox.mails()[self._seen :])

        until(lambda: len(new()) >= len(subjects), lambda: f"{subjects}: {new()}", 60)
        assert new() == sorted(subjects)
        self._seen += len(subjects)

    def evaluate(self, times: int) -> None:
        """Wait until the rules have been evaluated so many times more."""
        expr = "sum(prometheus_rule_group_iterations_total{rule_group=~'.*;ros-diagnostics.hosts'})"

        def iterations() -> float:
            found = self.servers.query(expr)
            return float(found[0]["value"][1]) if found else 0

        wanted = iterations() + times
        until(lambda: iterations() >= wanted, f"{times} evaluations", 60)

    def faults(self) -> set[tuple[str, str]]:
        """Check and state of each fault of a host."""
        found = self.servers.query('fleet:ros_diagnostics_fault_start:held{scope="host"}')
        return {(each["metric"]["check"], each["metric"]["state"]) for each in found}

    def wait_for_faults(self, *faults: tuple[str, str]) -> None:
        until(lambda: self.faults() == {*faults}, lambda: f"{faults}: {self.faults()}", 60)


def thresholds(folder: Path) -> Callable[[Path], None]:
    """Edits the thresholds as a person would: the disk is WARNING as full as it is now."""
    found = os.statvfs(folder)
    used = 100 * (1 - found.f_bavail / found.f_blocks)

    def change(document: dict[str, Any]) -> None:
        for rule in document["groups"][0]["rules"]:
            if rule.get("labels", {}).get("check") == "disk":
                warning = rule["record"].endswith(":warning")
                rule["expr"] = f"vector({used - 1 if warning else 101})"
        document["groups"][0]["rules"][0]["expr"] = f"vector({CONFIRM_AFTER})"

    return lambda prometheus: short_clocks.edit(prometheus / "rules" / "hosts.yml", change)


def mails_to(smtp: str) -> Callable[[dict[str, Any]], None]:
    """Edits Alertmanager's configuration."""

    def change(config: dict[str, Any]) -> None:
        config["global"]["smtp_smarthost"] = smtp
        config["route"]["group_interval"] = "1s"
        for receiver in config["receivers"]:
            receiver.pop("webhook_configs", None)

    return change


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    """A robot whose computer is well but for its disk."""
    inbox, smtp = Inbox(), f"127.0.0.1:{free_port()}"
    with ExitStack() as stack:
        mail_server = MailServer(smtp, inbox)
        stack.callback(mail_server.stop)
        mail_server.start()
        computer = Computer(tmp_path)
        page = stack.enter_context(answering(Page))
        node, blackbox = stack.enter_context(
            host_checks.running(
                tmp_path,
                "--collector.disable-defaults",
                *(f"--collector.{name}" for name in ("loadavg", "processes", "filesystem")),
                "--collector.textfile",
                f"--path.procfs={computer.proc}",
            )
        )
        banner = stack.enter_context(serving(socketserver.TCPServer(("127.0.0.1", 0), Banner)))
        links = {
            name: Link(to)
            for name, to in {"ssh": banner, "http": page, "tcp": page, "node": node}.items()
        }
        for link in links.values():
            stack.callback(link.close)
        found = Site(computer, links, inbox)
        exporter = stack.enter_context(robot_and_exporter(tmp_path))
        found.servers = stack.enter_context(
            prometheus_site.running(
                tmp_path,
                {"hall": exporter},
                probes=host_checks.jobs(
                    {
                        "localhost:9877": exporter,
                        "localhost:9115": blackbox,
                        "/sd/node": f"/sd/node?port={port(links['node'].address)}",
                        "/sd/ssh": f"/sd/ssh?port={port(links['ssh'].address)}",
                        "/sd/http": f"/sd/http?port={port(links['http'].address)}",
                        "?port=11311": f"?port={port(links['tcp'].address)}",
                    },
                    # What may not send pings finds every host down (test_hosts.py).
                    ["ros-diagnostics-ping", "ros-diagnostics-uplink"],
                ),
                prepare=thresholds(tmp_path),
                receivers=mails_to(smtp),
            )
        )
        yield found


def port(address: str) -> str:
    return address.rpartition(":")[2]


@contextmanager
def robot_and_exporter(folder: Path) -> Iterator[str]:
    """A virtual robot and an exporter that receives it; yields the exporter's address."""
    address = f"127.0.0.1:{free_port()}"
    with domains.lease() as domain, ExitStack() as stack:
        (folder / "fleet.yml").write_text(FLEET.format(domain=domain))
        commands = {
            "robots": programs.virtual_robots(1, 1, domain),
            "exporter": programs.exporter(
                folder / "fleet.yml", address, folder / "exporter.db", "127.0.0.1:1"
            ),
        }
        for name, argv in commands.items():
            process = Process(name, argv, domains.environment(domain), folder / f"{name}.log")
            stack.callback(process.stop)
            process.start()
        until(
            lambda: (
                answers(address, "/-/ready")
                and all(each["up"] for each in get_json(address, "/api/v1/fleet")["robots"])
            ),
            "the robot is received",
            120,
        )
        yield address


def mail(kind: str, what: str) -> str:
    return f"** {kind} ** hall/robot_1 {what}"


DISK_WARNING = ("disk", "warning")


def test_a_load_is_a_warning_then_critical_at_once_and_recovers_by_mails(
    site: Site, capsys: pytest.CaptureFixture[str]
):
    site.wait_for_faults(DISK_WARNING)
    site.wait_for(mail("PROBLEM", f"disk {site.computer.proc.parent} is WARNING"))
    site.computer.load(5.0)
    site.evaluate(2 * CONFIRM_AFTER)
    assert site.faults() == {DISK_WARNING}  # at the threshold, not above

    site.computer.load(5.01)
    site.wait_for(mail("PROBLEM", "load is WARNING"))
    site.computer.load(10.01)
    site.wait_for(mail("PROBLEM", "load is CRITICAL"))
    assert site.faults() == {DISK_WARNING, ("load", "warning"), ("load", "critical")}
    who = ("--author", "ann", "--comment", "a map is being built")
    url = f"http://{site.servers.alertmanager}"
    assert ack.main(["robot_1", "load", *who, "--url", url]) == 0
    assert "hall/robot_1 load CRITICAL" in capsys.readouterr().out
    site.computer.load(0.5)
    site.wait_for(
        mail("RECOVERY", "load is no longer CRITICAL"),
        mail("RECOVERY", "load is no longer WARNING"),
    )

    # Averages over 5 and 15 minutes have thresholds of their own; what is critical from its
    # beginning is one mail, and its recovery one.
    site.computer.load(0.5, five=6.01, fifteen=3.5)
    site.wait_for(mail("PROBLEM", "load is CRITICAL"))
    site.computer.load(0.5)
    site.wait_for(mail("RECOVERY", "load is no longer CRITICAL"))


def test_processes_are_counted_and_users_are_those_of_logind(site: Site, tmp_path: Path):
    site.wait_for_faults(DISK_WARNING)
    site.computer.processes(251)
    # This machine has no logind: node_exporter serves from a file what it would count.
    new = tmp_path / "new"
    new.write_text(
        'node_logind_sessions{class="user",remote="true",seat="",type="tty"} 51\n'
        'node_logind_sessions{class="greeter",remote="false",seat="seat0",type="x11"} 1\n'
    )
    new.rename(tmp_path / "sensors" / "users.prom")

    site.wait_for_faults(
        DISK_WARNING, ("processes", "warning"), ("users", "warning"), ("users", "critical")
    )
    found = site.servers.query('fleet:ros_diagnostics_fault_start:held{check="users"}')
    assert {each["metric"]["evidence"] for each in found} == {"51 users"}


def test_services_that_do_not_answer_are_critical_until_they_do(site: Site):
    site.wait_for_faults(DISK_WARNING)
    site.wait_for(mail("PROBLEM", f"disk {site.computer.proc.parent} is WARNING"))
    tcp = f"tcp {port(site.services['tcp'].address)}"
    for name in ("ssh", "http", "tcp"):
        site.services[name].cut()
    site.wait_for(*(mail("PROBLEM", f"{each} is CRITICAL") for each in ("ssh", "http", tcp)))
    for name in ("ssh", "http", "tcp"):
        site.services[name].heal()
    site.wait_for(
        *(mail("RECOVERY", f"{each} is no longer CRITICAL") for each in ("ssh", "http", tcp))
    )


def test_a_fault_goes_on_while_its_computer_does_not_answer(site: Site):
    site.wait_for_faults(DISK_WARNING)
    site.wait_for(mail("PROBLEM", f"disk {site.computer.proc.parent} is WARNING"))
    site.computer.load(11)
    site.wait_for(mail("PROBLEM", "load is CRITICAL"))

    site.services["node"].cut()
    site.wait_for(mail("PROBLEM", "node_exporter is WARNING"))
    site.evaluate(3 * CONFIRM_AFTER)
    assert ("load", "critical") in site.faults()
    site.computer.load(0.5)
    site.services["node"].heal()
    site.wait_for(
        mail("RECOVERY", "load is no longer CRITICAL"),
        mail("RECOVERY", "node_exporter is no longer WARNING"),
    )
