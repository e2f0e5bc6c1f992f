"""Three robots and an exporter in namespaces of one subnet, with a /dev/shm of their own."""

import json
import sys
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from support import subnets
from testbed import domains
from testbed.processes import Process

COMMANDS = Path(sys.executable).parent
FLEET = """fleet: f
profiles: {default: {stale_after: 5s, confirm_after: 10s}}
discovery: [{topic: "/{robot}/diagnostics_agg", domain_ids: [0]}]
"""
ROBOTS = 'duration: 1000\nevents: []\nrobots: [{kind: thesis, count: 3, name: "r_{n}"}]\n'
ADDRESS = "127.0.0.1:9877"
LAYOUT = f"mount -t tmpfs -o size=64m tmpfs /dev/shm\n{subnets.SWITCHED}"


class OneSubnet:
    """Robots in a hall, or beside the exporter, which is in an office of the same subnet."""

    def __init__(self, stack: ExitStack, folder: Path, robots_at: str = "hall") -> None:
        self.network = subnets.Subnets(stack, folder, ("hall", "office"), LAYOUT)
        self._folder = folder
        self._environment = domains.environment(0) | {"ROS_LOG_DIR": str(folder / "ros-log")}
        del self._environment["ROS_DOMAIN_ID"]
        if robots_at == "hall":  # else by shared memory
            del self._environment["ROS_AUTOMATIC_DISCOVERY_RANGE"]
        (folder / "robots.yaml").write_text(ROBOTS)
        argv = [COMMANDS / "virtual-robots", "--scenario", folder / "robots.yaml"]
        self.network.start(robots_at, argv, self._environment)

    def start_exporter(self) -> Process:
        path = self._folder / "fleet.yml"
        path.write_text(FLEET)
        flags = ["--config.file", path, "--storage.path", "none"]
        argv = [COMMANDS / "ros-diagnostics-exporter", *flags, "--web.listen-address", ADDRESS]
        return self.network.start("office", argv, self._environment)

    def ask(self, what: str) -> Any:
        return json.loads(self.network.fetch("office", f"http://{ADDRESS}/api/v1/{what}"))

    def received(self, after: float = 0.0) -> int:
        """How many robots are up, of which a message was received after a Unix time."""
        try:
            robots = self.ask("fleet")["robots"]
        except OSError:
            return 0
        return sum(each["up"] and each["last_message"] > after for each in robots)

    def is_joined(self) -> bool:
        try:
            return self.network.fetch("office", f"http://{ADDRESS}/-/ready") != ""
        except OSError:
            return False

    def run(self, *argv: str) -> None:
        """Run a command beside the exporter."""
        self.network.run("office", *argv)

    def faults(self) -> list[dict[str, Any]]:
        """The events of all faults that ever began."""
        return [each for each in self.ask("events")["events"] if each["kind"] == "fault_began"]
