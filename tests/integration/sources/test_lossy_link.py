"""A robot on another host, and a network between that loses packets."""

import json
import re
import shutil
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from support import subnets
from support.exposition import parsed
from testbed import domains
from testbed.polling import until

pytestmark = pytest.mark.slow

EXPORTER = Path(sys.executable).with_name("ros-diagnostics-exporter")
PORT = 9877
URL = f"http://127.0.0.1:{PORT}"
FLEET = """\
fleet: f
profiles: {default: {confirm_after: 1s, graph: {mode: "on", learn_after: 5s}}}
robots: [{name: r, namespace: /r, source: raw}]
"""
ROBOT = """
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import QoSProfile, ReliabilityPolicy

rclpy.init()
node = rclpy.create_node("driver", namespace="/r")
profile = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
sender = node.create_publisher(DiagnosticArray, "diagnostics", profile)
array = DiagnosticArray(status=[DiagnosticStatus(name="Motor", level=bytes(1))])
node.create_timer(0.1, lambda: sender.publish(array))
print("ready", flush=True)
rclpy.spin(node)
"""
COUNTED = 30.0  # seconds in which bytes are counted
NOISE = 0.02  # of the bytes: acknowledgements and announcements that fall into one time or another
STEADY = 200.0  # seconds until a minute of so many losses is known, on a busy machine


class Site:
    """A robot that publishes ten times a second by best effort, and an exporter."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self.folder = folder
        self.hosts = subnets.Subnets(stack, folder, ("robot", "office"), subnets.SWITCHED)
        env = domains.environment(0) | {"ROS_LOG_DIR": str(folder / "ros-log")}
        del env["ROS_AUTOMATIC_DISCOVERY_RANGE"]
        (folder / "fleet.yml").write_text(FLEET)
        flags = ["--config.file", folder / "fleet.yml", "--storage.path", "none"]
        argv = [EXPORTER, *flags, "--web.listen-address", f"127.0.0.1:{PORT}"]
        self.exporter = self.hosts.start("office", argv, env)
        self.hosts.start("robot", [sys.executable, "-c", ROBOT], env)

    def lose(self, share: float) -> None:
        """From now on lose this share of the packets that arrive at the exporter."""
        self.hosts.run("office", "iptables", "-F", "INPUT")
        chance = ("--mode", "random", "--probability", str(share))
        rule = ("-A", "INPUT", "-i", "eth0", "-m", "statistic", *chance, "-j", "DROP")
        self.hosts.run("office", "iptables", *rule)

    def sample(self, name: str) -> float | None:
        try:
            found = parsed(self.hosts.fetch("office", f"{URL}/metrics"), name)
        except OSError:
            return None
        return found[0].value if found else None

    def watch(self, mode: str) -> None:
        """Have the exporter look at the graph or not, by a reload."""
        path = self.folder / "fleet.yml"
        path.write_text(re.sub('mode: "[a-z]+"', f'mode: "{mode}"', path.read_text()))
        until(lambda: self.is_watching() == (mode == "on"), self.exporter.describe, 90, 0.5)

    def is_watching(self) -> bool:
        return self.sample("robot_expected_nodes") is not None

    def count_bytes(self) -> int:
        """How many bytes the robot sends and receives in some time."""

        def counted() -> int:
            names = [f"/sys/class/net/eth0/statistics/{each}_bytes" for each in ("rx", "tx")]
            return sum(map(int, self.hosts.output("robot", "cat", *names).split()))

        before = counted()
        time.sleep(COUNTED)
        return counted() - before

    def faults(self) -> list[tuple[str, str]]:
        found = json.loads(self.hosts.fetch("office", f"{URL}/api/v1/faults"))
        return [(each["component"], each["state"]) for each in found["faults"]]

    def began(self) -> set[str]:
        """The components of all faults that ever began."""
        events = self.hosts.fetch("office", f"{URL}/api/v1/events?kind=fault_began")
        return {each.get("component", "") for each in json.loads(events)["events"]}


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    if shutil.which("iptables") is None:
        pytest.skip("needs the program iptables")
    if why := subnets.missing():
        pytest.skip(why)
    with ExitStack() as stack:
        yield Site(stack, tmp_path)


def test_watching_the_graph_adds_no_byte(site):
    until(lambda: site.sample("robot_expected_nodes") == 1, site.exporter.describe, 90, 0.5)
    counted: dict[str, list[int]] = {"on": [], "off": []}
    for mode in ("on", "off", "off", "on"):
        site.watch(mode)
        counted[mode].append(site.count_bytes())
    on, off = sum(counted["on"]), sum(counted["off"])
    assert abs(on - off) < NOISE * off, counted


def test_a_network_that_loses_packets_is_the_fault_of_the_link_alone(site):
    until(lambda: site.sample("robot_expected_nodes") == 1, site.exporter.describe, 90, 0.5)
    assert site.sample("robot_link_lost_ratio") == 0

    site.lose(0.05)
    until(lambda: 0 < site.sample("robot_link_lost_ratio") < 0.15, "some are lost", STEADY, 0.5)
    site.lose(0.45)
    until(
        lambda: 0.3 < site.sample("robot_link_lost_ratio") < 0.6,
        lambda: f"{site.sample('robot_link_lost_ratio')} of the messages are lost",
        STEADY,
        0.5,
    )
    until(lambda: site.faults() == [("link", "critical")], lambda: f"{site.faults()}", STEADY, 0.5)
    site.lose(0.0)
    until(lambda: site.faults() == [], lambda: f"{site.faults()}", STEADY, 0.5)
    assert site.began() == {"link"}
