"""The shipped queries of hosts, with all real servers: a host's disk is a row like a motor.

node_exporter reads a folder in place of /proc, so that the test says what the load is.
"""

import os
from pathlib import Path
from typing import Any

import pytest
import yaml

from ros_diagnostics_tools.main import main
from support import host_checks
from support.loopback import replying
from support.replaced import replace_text
from testbed.configuration import CHECKOUT
from testbed.http import get, get_json
from testbed.polling import until
from testbed.site import Site

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


class Host:
    """A robot whose computer is measured; its exporter, Prometheus and mails."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self.folder = site.folder
        self.subjects = site.inbox.subjects
        self.load(0.5)
        (self.folder / "proc" / "1").mkdir()
        mounts = f"/dev/disk {self.folder} ext4 rw 0 0\n"
        (self.folder / "proc" / "1" / "mounts").write_text(mounts)
        page = site.use(replying(lambda _request: b""))
        site.start_mail_server()
        site.start_robots()
        site.write("queries.d/hosts.yml", yaml.safe_dump(queries(self.folder)))
        fleet = site.write("fleet.yml", FLEET.format(domain=site.domain_id))
        self.exporter = site.start_exporter(
            fleet, f"--prometheus.url=http://{site.addresses.prometheus}"
        ).address
        node, blackbox = host_checks.start(
            site,
            "--collector.disable-defaults",
            "--collector.loadavg",
            "--collector.filesystem",
            f"--path.procfs={self.folder / 'proc'}",
        )
        site.wait_until_ready()
        jobs = self._jobs(node, blackbox, _port(page))
        site.start_prometheus(interval=1, tenth=True, probes=jobs)
        site.wait_until_ready(self._not_scraped)
        site.start_alertmanager(edit=lambda it: it["route"].update(group_interval="1s"))
        site.wait_until_ready()

    def _not_scraped(self) -> str:
        """What is not there yet; "" once Prometheus has an exporter, and does not miss one.

        Its first targets come up to 5 s after its start, and a tenth of the hold is 6 s. Mails are
        sent only after that.
        """
        down = 'ALERTS{alertname="RosDiagnosticsExporterDown"}'
        found = self.site.query(f"exporter:ros_diagnostics_exporter:held unless on () {down}")
        return "" if found else "the exporter in Prometheus"

    def _jobs(self, node: str, blackbox: str, page: str) -> list[dict[str, Any]]:
        return host_checks.jobs(
            {
                "localhost:9877": self.exporter,
                "localhost:9115": blackbox,
                "/sd/node": f"/sd/node?port={_port(node)}",
                "/sd/http": f"/sd/http?port={page}",
                "?port=11311": f"?port={page}",
                # Where pings may not be sent, as the comment there says.
                "[icmp]": "[tcp_connect]",
                "/sd/ping": f"/sd/tcp?port={page}",
                "/sd/uplink": f"/sd/uplink?port={page}",
            },
            ["ros-diagnostics-ssh"],  # nobody serves SSH
        )

    def load(self, one: float) -> None:
        """Set the load average."""
        proc = self.folder / "proc"
        proc.mkdir(exist_ok=True)
        replace_text(proc / "loadavg", f"{one:.2f} 0.10 0.10 1/100 200\n")

    def robot(self, name: str = "robot_1") -> dict[str, Any]:
        """A robot as the API has it."""
        robots = get_json(self.exporter, "/api/v1/fleet")["robots"]
        return next(dict(each) for each in robots if each["robot"] == name)

    def component(self, name: str, robot: str = "robot_1") -> dict[str, Any]:
        """A component of a robot; empty if there is none."""
        found = (each for each in self.robot(robot)["components"] if each["component"] == name)
        return next(found, {})

    def level(self, name: str) -> str:
        return str(self.component(name).get("level"))

    def faults(self) -> list[tuple[str, str]]:
        """Component and state of each fault of a robot."""
        return [(each["component"], each["state"]) for each in self._faults() if each["robot"]]

    def own_faults(self) -> list[tuple[str, str]]:
        """The same of the exporter's own."""
        return [(each["component"], each["state"]) for each in self._faults() if not each["robot"]]

    def _faults(self) -> list[dict[str, Any]]:
        found: list[dict[str, Any]] = get_json(self.exporter, "/api/v1/faults")["faults"]
        return found


def _port(address: str) -> str:
    return address.rpartition(":")[2]


def queries(folder: Path) -> list[dict[str, Any]]:
    """The shipped ones, asked often and confirmed soon, of which any STALE could be a fault.

    One scrape in a second that is late confirms nothing: the next answer is there before. The disk
    is WARN as full as it is now.
    """
    found = os.statvfs(folder)
    free = 100 * found.f_bavail / found.f_blocks
    entries: list[dict[str, Any]] = yaml.safe_load(QUERIES.read_text())
    for each in entries:
        each.update({"interval": "5s", "stale_after": "10s", "confirm_after": "10s"})
        each.pop("planned_stale", None)
        if each["component"].startswith("disk"):
            each["thresholds"] = {"low": {"warning": free + 1, "critical": 0}}
    return entries


@pytest.fixture
def host(site: Site) -> Host:
    return Host(site)


def test_a_hosts_disk_load_and_services_are_components_with_a_mail_and_a_recovery(
    host: Host, capsys: pytest.CaptureFixture[str]
):
    disk = f"disk {host.folder}"
    until(lambda: host.level(disk) == "WARN", lambda: str(host.robot()["components"]), 60)
    until(lambda: host.level("load 1m") == "OK", "the load is measured", 60)
    for each in ("http", "node_exporter", "ping"):
        until(lambda each=each: host.level(each) == "OK", f"{each} answers", 60)
    until(lambda: host.component("uplink", "ap_1").get("level") == "OK", "the uplink answers", 60)
    assert host.component(disk)["group"] == "Host"
    text = get(host.exporter, "/metrics").decode()
    assert f'component="{disk}"' in text
    assert disk in get(host.exporter, "/robots/robot_1").decode()

    host.load(11)
    problem = "** PROBLEM ** hall/robot_1 load 1m is CRITICAL"
    until(lambda: problem in host.subjects(), lambda: str(host.subjects()), 90)
    url = f"http://{host.site.addresses.alertmanager}"
    who = ("--author", "ann", "--comment", "a map is being built", "--alertmanager", url)
    assert main(["ack", "robot_1", "load 1m", *who]) == 0
    assert "hall/robot_1 load 1m CRITICAL" in capsys.readouterr().out
    host.load(0.5)
    recovery = "** RECOVERY ** hall/robot_1 load 1m is no longer CRITICAL"
    until(lambda: recovery in host.subjects(), lambda: str(host.subjects()), 90)


def test_while_prometheus_is_killed_no_fault_begins_or_ends_and_none_is_repeated_when_it_is_back(
    host: Host,
):
    disk = f"disk {host.folder}"
    host.load(11)
    problems = {
        f"** PROBLEM ** hall/robot_1 {disk} is WARNING",
        "** PROBLEM ** hall/robot_1 load 1m is CRITICAL",
    }
    until(lambda: problems <= set(host.subjects()), lambda: str(host.subjects()), 120)
    until(lambda: not host.own_faults(), lambda: str(host.own_faults()), 60)
    before = host.faults()

    host.site.prometheus.process.kill()
    until(lambda: host.level(disk) == "STALE", "the disk is STALE", 60)
    until(lambda: host.level("load 1m") == "STALE", "so is the load", 60)
    # A minute, in which all that is STALE could have become a fault.
    until(host.own_faults, "it is a fault that the queries fail", 90)
    assert host.own_faults() == [("queries", "warning")]
    assert host.faults() == before

    # Later than four times the resend delay, Alertmanager would have sent RECOVERY.
    host.site.prometheus.process.start()
    until(lambda: not host.own_faults(), "the queries are answered", 60)
    until(lambda: host.level(disk) == "WARN", "the disk is measured again", 60)
    assert host.faults() == before
    host.load(0.5)
    recovery = "** RECOVERY ** hall/robot_1 load 1m is no longer CRITICAL"
    until(lambda: recovery in host.subjects(), lambda: str(host.subjects()), 90)
    # The exporter's own has a mail where a scrape comes before the next query.
    of_robots = {each for each in host.subjects() if "hall/" in each}
    assert of_robots == {*problems, recovery}
    assert len(set(host.subjects())) == len(host.subjects())
