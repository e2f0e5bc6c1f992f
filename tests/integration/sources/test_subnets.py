"""Robots on other hosts: what docs/subnets.md says has to be set where there is no multicast.

Two halls with robots, an office with the exporters, and a host for the discovery server.
"""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from pathlib import Path

import pytest

from support import subnets
from support.exposition import parsed
from testbed import domains
from testbed.polling import until
from testbed.processes import Process

pytestmark = pytest.mark.slow

COMMANDS = Path(sys.executable).parent
SERVER = COMMANDS / "fast-discovery-server"  # of the wheels
HOSTS = ("north", "south", "rendezvous", "office")
CLIENT = {"ROS_DISCOVERY_SERVER": "10.77.3.2:11811"}
SUPER_CLIENT = CLIENT | {"ROS_SUPER_CLIENT": "TRUE"}
DISCOVERY = 'discovery: [{topic: "/{robot}/diagnostics_agg", domain_ids: [0]}]\n'
DECLARED = "robots: [{name: north_1, namespace: /north_1, domain_id: 0}]\n"
ROBOTS = 'duration: 1000\nevents: []\nrobots: [{{kind: thesis, count: 1, name: "{name}_{{n}}"}}]\n'


class Exporter:
    """An exporter in the office."""

    def __init__(self, network: Network, port: int, fleet: str, env: Mapping[str, str]) -> None:
        self._network = network
        self._url = f"http://127.0.0.1:{port}"
        path = network.folder / f"fleet-{port}.yml"
        path.write_text(f"fleet: halls\n{fleet}")
        flags = ["--config.file", path, "--storage.path", "none"]
        argv = [COMMANDS / "ros-diagnostics-exporter", *flags, "--web.listen-address", f":{port}"]
        self.process = network.start("office", argv, env)

    def robots(self) -> dict[str, str]:
        """Why each known robot is silent, "" if it is not; none while the port does not answer."""
        try:
            fleet = json.loads(self._network.subnets.fetch("office", f"{self._url}/api/v1/fleet"))
        except OSError:
            return {}
        return {
            each["robot"]: "" if each["up"] else str(each["silent_reason"])
            for each in fleet["robots"]
        }

    def received(self) -> set[str]:
        """The robots that are received."""
        return {robot for robot, why in self.robots().items() if not why}

    def value(self, name: str, **labels: str) -> float:
        """The value of the only such sample of its metrics."""
        text = self._network.subnets.fetch("office", f"{self._url}/metrics")
        (found,) = parsed(text, name, **labels)
        return found.value

    def arrays(self, robot: str) -> float:
        """How many arrays of a robot were received."""
        return self.value("robot_messages_total", robot=robot)

    def looks(self) -> float:
        """When it has looked at the ROS graph last, in Unix time."""
        return self.value("exporter_discovery_last_run_timestamp_seconds")

    def wait_for(self, *robots: str) -> None:
        def text() -> str:
            return f"{robots}; received: {self.received()}\n{self.process.describe()}"

        until(lambda: self.received() == set(robots), text, 60, every=0.5)

    def wait_for_looks(self) -> None:
        """Wait until it has looked at the graph anew."""
        before = self.looks()
        until(lambda: self.looks() > before + 2, "a later look at the graph", 30, every=0.5)


class Network:
    """The halls, the office and the programs in them."""

    def __init__(self, stack: ExitStack, folder: Path, layout: str) -> None:
        self.folder = folder
        self.subnets = subnets.Subnets(stack, folder, HOSTS, layout)
        kept = domains.environment(0) | {"ROS_LOG_DIR": str(folder / "ros-log")}
        del kept["ROS_AUTOMATIC_DISCOVERY_RANGE"], kept["ROS_DOMAIN_ID"]
        self._environment = kept

    def start(self, host: str, argv: list[str | Path], env: Mapping[str, str]) -> Process:
        return self.subnets.start(host, argv, self._environment | dict(env))

    def server(self, number: int = 0, host: str = "rendezvous") -> Process:
        process = self.start(host, [SERVER, "-i", str(number), "-p", "11811"], {})
        process.wait_for_output("Server is running")
        return process

    def robot(self, host: str, env: Mapping[str, str], name: str = "") -> Process:
        """One robot, named after its host unless ``name`` is given, with the number 1."""
        path = self.folder / f"{name or host}.yaml"
        path.write_text(ROBOTS.format(name=name or host))
        return self.start(host, [COMMANDS / "virtual-robots", "--scenario", path], env)

    def exporter(self, port: int, fleet: str, env: Mapping[str, str]) -> Exporter:
        return Exporter(self, port, fleet, env)


@pytest.fixture
def layout() -> str:
    return subnets.ROUTED


@pytest.fixture
def network(tmp_path: Path, layout: str) -> Iterator[Network]:
    if why := subnets.missing():
        pytest.skip(why)
    if not SERVER.exists():
        pytest.skip("needs fast-discovery-server, which the wheels of the extra [ros] bring")
    with ExitStack() as stack:
        yield Network(stack, tmp_path, layout)


def test_a_super_client_finds_robots_and_a_client_receives_those_it_knows(network):
    network.server()
    for hall in ("north", "south"):
        network.robot(hall, CLIENT)
    everything = network.exporter(9877, DISCOVERY, SUPER_CLIENT)
    declared = network.exporter(9878, DECLARED, CLIENT)
    client = network.exporter(9879, DISCOVERY, CLIENT)
    without_server = network.exporter(9880, DISCOVERY, {})

    everything.wait_for("north_1", "south_1")
    declared.wait_for("north_1")
    for each in (client, without_server):
        each.wait_for_looks()
        assert each.received() == set()


def test_data_flow_without_the_server_and_an_orderly_restart_is_enough(network):
    server = network.server()
    network.robot("north", CLIENT)
    exporter = network.exporter(9877, DISCOVERY, SUPER_CLIENT)
    exporter.wait_for("north_1")

    server.stop()
    before = exporter.arrays("north_1")
    until(lambda: exporter.arrays("north_1") > before + 5, "data without a server", 60)
    network.server()
    network.robot("south", CLIENT)

    exporter.wait_for("north_1", "south_1")


@pytest.mark.timeout(400)
def test_a_killed_server_has_to_be_gone_for_its_lease(network):
    """Clients notice a killed server after 20 s; one that is back before is not their new one."""
    server = network.server()
    network.robot("north", CLIENT)
    exporter = network.exporter(9877, DISCOVERY, SUPER_CLIENT)
    exporter.wait_for("north_1")

    server.kill()
    network.robot("south", CLIENT)
    before = exporter.arrays("north_1")
    until(lambda: exporter.arrays("north_1") > before + 30, "30 s without a server", 90)
    network.server()

    exporter.wait_for("north_1", "south_1")


def test_all_may_start_before_the_server(network):
    network.robot("north", CLIENT)
    exporter = network.exporter(9877, DISCOVERY, SUPER_CLIENT)
    until(lambda: exporter.process.wait_for_output("serving fleet"), "the exporter")
    network.server()
    exporter.wait_for("north_1")


def test_a_second_server_takes_over(network):
    both = {"ROS_DISCOVERY_SERVER": "10.77.3.2:11811;10.77.2.2:11811"}
    first = network.server()
    network.server(1, "south")
    network.robot("north", both)
    exporter = network.exporter(9877, DISCOVERY, both | {"ROS_SUPER_CLIENT": "TRUE"})
    exporter.wait_for("north_1")
    first.kill()
    network.robot("south", both)
    exporter.wait_for("north_1", "south_1")


@pytest.mark.parametrize("side", ["exporter", "robots"])
def test_static_peers_at_one_side_are_enough(network, side):
    peers = {
        "exporter": {"ROS_STATIC_PEERS": "10.77.1.2;10.77.2.2"},
        "robots": {"ROS_STATIC_PEERS": "10.77.4.2"},
    }
    exporter = network.exporter(9877, DISCOVERY, peers["exporter"] if side == "exporter" else {})
    exporter.process.wait_for_output("serving fleet")
    for hall in ("north", "south"):
        network.robot(hall, peers["robots"] if side == "robots" else {})

    exporter.wait_for("north_1", "south_1")


@pytest.mark.parametrize("layout", [subnets.SWITCHED])
def test_in_one_subnet_nothing_has_to_be_set(network):
    network.server()
    network.robot("north", {})
    network.robot("south", CLIENT)  # found through the server only, though multicast would do
    exporter = network.exporter(9877, DISCOVERY, {})

    exporter.wait_for("north_1")
    exporter.wait_for_looks()
    assert exporter.received() == {"north_1"}


@pytest.mark.skipif(shutil.which("iptables") is None, reason="needs iptables")
@pytest.mark.parametrize("layout", [subnets.SWITCHED])
@pytest.mark.parametrize(
    ("open_ports", "expected"),
    [
        (["7400", "7410:7411"], {"north_1": ""}),
        (["7400", "7410"], {"north_1": "mute"}),  # not the port for data
        (["7400"], {"north_1": "never_seen"}),  # multicast only
    ],
)
def test_a_firewall_with_the_documented_ports(network, open_ports, expected):
    """docs/deployment.md#ports-and-firewalls, for domain 0 and one program on each host."""
    for host in ("north", "office"):
        network.subnets.run(host, "iptables", "-A", "INPUT", "-i", "lo", "-j", "ACCEPT")
        for ports in open_ports:
            accept = ["-p", "udp", "--dport", ports, "-j", "ACCEPT"]
            network.subnets.run(host, "iptables", "-A", "INPUT", *accept)
        network.subnets.run(host, "iptables", "-P", "INPUT", "DROP")
    network.robot("north", {}).wait_for_output("ready")
    exporter = network.exporter(9877, DECLARED, {})
    exporter.process.wait_for_output("serving fleet")

    until(lambda: exporter.robots() == expected, lambda: str(exporter.robots()), 60, every=0.5)
    for _ in range(3):  # and it stays so
        exporter.wait_for_looks()
    assert exporter.robots() == expected
