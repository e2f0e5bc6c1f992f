"""A real exporter as a process of its own, with virtual robots on real DDS."""

import json
import subprocess
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from support.called import called
from testbed import ports, programs
from testbed.polling import until
from testbed.processes import Process
from testbed.servers import Server
from testbed.site import Site

SERVES = "serving fleet"
FLEET = """\
fleet: hall
profiles: {{default: {{stale_after: 5s, confirm_after: 5s}}}}
discovery: [{{topic: "/{{robot}}/diagnostics_agg", domain_ids: [{domain}]}}]
"""


class Hall(Site):
    """A site with a fleet.yml, whose exporter is started with other flags again and again."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder, environment={"NOTIFY_SOCKET": str(folder / "notify")})
        self.address = self.addresses.exporter
        self.port = int(self.address.rpartition(":")[2])
        self.database = folder / "exporter.db"
        self.fleet_file = self.write("fleet.yml", FLEET.format(domain=self.domain_id))

    def _argv(self, *flags: str | Path) -> list[str]:
        argv = programs.exporter(self.fleet_file, self.address, self.database)
        return [*argv, *map(str, flags)]

    def process(self, *flags: str | Path) -> Process:
        """The exporter, not yet started."""
        log = self.folder / "exporter.log"
        return Process("exporter", self._argv(*flags), self.environment(), log)

    def begin(self, process: Process) -> Process:
        """Start a program, which ends with the site."""
        return self.start(Server(process)).process

    def serve(self, *flags: str | Path, process: Process | None = None) -> Process:
        """Start the exporter, or this one, and wait until it serves."""
        started = process or self.process(*flags)
        before = started.output().count(SERVES)
        self.begin(started)
        until(lambda: started.output().count(SERVES) > before, started.describe, 60)
        return started

    def run(self, *flags: str | Path, code: int) -> subprocess.CompletedProcess[str]:
        """Run the exporter until it exits with this code, at a port of its own."""
        address = ("--web.listen-address", f"127.0.0.1:{ports.free_port()}")
        return called(self._argv(*address, *flags), code=code, timeout=60)

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
def site(tmp_path: Path) -> Iterator[Hall]:
    with Hall(tmp_path) as site:
        yield site
