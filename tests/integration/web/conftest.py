"""A real exporter as a process of its own, with virtual robots on real DDS."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from testbed import domains, ports
from testbed.processes import Process

BIN = Path(sys.executable).parent


class Site:
    """A ROS domain, a fleet.yml for it, and the commands that use both."""

    def __init__(self, folder: Path, domain_id: int) -> None:
        self.folder = folder
        self.domain_id = domain_id
        self.port = ports.free_port()
        self.fleet_file = folder / "fleet.yml"
        self.fleet_file.write_text(
            "fleet: hall\n"
            "profiles: {default: {stale_after: 5s, confirm_after: 5s}}\n"
            f'discovery: [{{topic: "/{{robot}}/diagnostics_agg", domain_ids: [{domain_id}]}}]\n'
        )
        environment = domains.environment(domain_id)
        self.environment = environment | {"NOTIFY_SOCKET": str(folder / "notify")}

    def exporter(self, *flags: str | Path) -> Process:
        """The exporter, not yet started."""
        command = [BIN / "ros-diagnostics-exporter", "--config.file", self.fleet_file]
        address = ["--web.listen-address", f"127.0.0.1:{self.port}"]
        log = self.folder / "exporter.log"
        flags = ("--storage.path", self.folder / "exporter.db", *flags)
        return Process("exporter", [*command, *address, *flags], self.environment, log)

    def run(self, *flags: str | Path) -> subprocess.CompletedProcess[str]:
        """Run the exporter until it exits."""
        flags = ("--storage.path", self.folder / "exporter.db", *flags)
        command = [BIN / "ros-diagnostics-exporter", "--config.file", self.fleet_file, *flags]
        return subprocess.run(
            list(map(str, command)), capture_output=True, text=True, timeout=60, check=False
        )

    def robots(self, number: int) -> Process:
        """Virtual robots, not yet started."""
        command = [BIN / "virtual-robots", "--robots", str(number)]
        domain = ["--domain-id", str(self.domain_id)]
        log = self.folder / "robots.log"
        return Process("virtual-robots", [*command, *domain], self.environment, log)

    def fault(self, level: str) -> None:
        """Set the second motor of robot_1 to a level."""
        command = [BIN / "virtual-robots", "fault", "robot_1", "Motor 2", level]
        subprocess.run(
            [*map(str, command), "--domain-id", str(self.domain_id)],
            check=True,
            timeout=60,
            env=os.environ | self.environment,
        )

    def ask(self, path: str, method: str = "GET", port: int = 0) -> Any:
        """JSON from the exporter."""
        address = f"http://127.0.0.1:{port or self.port}"
        request = urllib.request.Request(address + path, method=method)
        with urllib.request.urlopen(request, timeout=20) as answer:
            return json.load(answer)

    def up(self, port: int = 0) -> int:
        """How many robots are up."""
        return sum(robot["up"] for robot in self.ask("/api/v1/fleet", port=port)["robots"])


@pytest.fixture
def site(tmp_path: Path, ros_domain: int) -> Site:
    return Site(tmp_path, ros_domain)


@pytest.fixture
def ends() -> Iterator[Callable[[Process], Process]]:
    """Stops the given processes when the test ends."""
    with ExitStack() as stack:

        def end(process: Process) -> Process:
            stack.callback(process.stop)
            return process

        yield end
