"""An exporter whose network changes receives its robots again, and blames none of them."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from support import subnets
from testbed import domains
from testbed.polling import until

pytestmark = [pytest.mark.integration, pytest.mark.slow]

COMMANDS = Path(sys.executable).parent
FLEET = """fleet: f
profiles: {default: {stale_after: 5s, confirm_after: 10s}}
discovery: [{topic: "/{robot}/diagnostics_agg", domain_ids: [0]}]
"""
ROBOTS = 'duration: 1000\nevents: []\nrobots: [{kind: thesis, count: 3, name: "r_{n}"}]\n'
URL = "http://127.0.0.1:9877/api/v1/"


class Site:
    """Robots in a hall, and an exporter in an office of the same subnet."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self.network = subnets.Subnets(stack, folder, ("hall", "office"), subnets.SWITCHED)
        self._folder = folder
        self._environment = domains.environment(0) | {"ROS_LOG_DIR": str(folder / "ros-log")}
        del self._environment["ROS_AUTOMATIC_DISCOVERY_RANGE"], self._environment["ROS_DOMAIN_ID"]
        (folder / "robots.yaml").write_text(ROBOTS)
        argv = [COMMANDS / "virtual-robots", "--scenario", folder / "robots.yaml"]
        self.network.start("hall", argv, self._environment)

    def start_exporter(self) -> None:
        path = self._folder / "fleet.yml"
        path.write_text(FLEET)
        flags = ["--config.file", path, "--storage.path", "none"]
        argv = [COMMANDS / "ros-diagnostics-exporter", *flags]
        listen = ["--web.listen-address", "127.0.0.1:9877"]
        self.network.start("office", [*argv, *listen], self._environment)

    def ask(self, what: str) -> Any:
        return json.loads(self.network.fetch("office", URL + what))

    def received(self, after: float = 0.0) -> int:
        """How many robots are up, of which a message was received after a Unix time."""
        try:
            robots = self.ask("fleet")["robots"]
        except OSError:
            return 0
        return sum(each["up"] and each["last_message"] > after for each in robots)

    def is_joined(self) -> bool:
        try:
            return self.network.fetch("office", "http://127.0.0.1:9877/-/ready") != ""
        except OSError:
            return False

    def address(self, *arguments: str) -> None:
        self.network.run("office", "ip", "address", *arguments, "dev", "eth0")


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    if why := subnets.missing():
        pytest.skip(why)
    with ExitStack() as stack:
        yield Site(stack, tmp_path)


def test_another_address_is_followed_without_a_fault_of_a_robot(site):
    site.start_exporter()
    until(lambda: site.received() == 3, "all are received", 60, every=0.5)
    site.address("delete", "10.77.2.2/16")
    site.address("add", "10.77.9.9/16")
    changed = site.ask("fleet")["time"]
    until(lambda: site.received(after=changed + 2) == 3, "all are received again", 30, every=0.5)
    events = site.ask("events")["events"]
    assert [each for each in events if each["kind"] == "fault_began"] == []


def test_an_exporter_that_starts_before_its_address_receives_once_it_has_it(site):
    site.address("delete", "10.77.2.2/16")
    site.start_exporter()
    until(site.is_joined, "it is joined", 30, every=0.5)
    site.address("add", "10.77.2.2/16")
    until(lambda: site.received() == 3, "all are received", 30, every=0.5)
