"""The plug-in under the distribution's real Nagios 4, checking robots through the real exporter."""

from __future__ import annotations

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from support import nagios_program
from testbed import domains, ports
from testbed.polling import until
from testbed.processes import Process

pytestmark = [pytest.mark.e2e, pytest.mark.slow]

BIN = Path(sys.executable).parent
SERVICES = {"motors": "Motor", "lasers": "Laser", "grippers": "Gripper"}

OBJECTS = """\
define timeperiod {{
  timeperiod_name always
  alias always
  monday 00:00-24:00
}}
define contact {{
  contact_name nobody
  host_notifications_enabled 0
  service_notifications_enabled 0
  host_notification_period always
  service_notification_period always
  host_notification_commands check_alive
  service_notification_commands check_alive
}}
define command {{
  command_name check_ros_diagnostics
  command_line {plugin} --url {url} -H $HOSTNAME$ -N "$ARG1$"
}}
define command {{
  command_name check_alive
  command_line /bin/true
}}
define host {{
  host_name robot_1
  address robot_1
  check_command check_alive
  max_check_attempts 1
  check_interval 60
  contacts nobody
}}
"""
SERVICE = """\
define service {{
  host_name robot_1
  service_description {name}
  check_command check_ros_diagnostics!{pattern}
  max_check_attempts 1
  check_interval 2
  retry_interval 2
  contacts nobody
}}
"""


def objects(url: str) -> str:
    text = OBJECTS.format(plugin=BIN / "check_ros_diagnostics", url=url)
    return text + "".join(
        SERVICE.format(name=name, pattern=pattern) for name, pattern in SERVICES.items()
    )


class Nagios:
    """The services in Nagios' status file."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "status.dat"

    def service(self, name: str) -> tuple[str, str, str]:
        """State (Nagios' number), output and performance data; empty before its first check."""
        text = self._path.read_text() if self._path.exists() else ""
        for block in re.findall(r"servicestatus \{(.*?)\n\t\}", text, re.DOTALL):
            fields = dict(line.strip().partition("=")[::2] for line in block.splitlines())
            if fields.get("service_description") == name and fields["has_been_checked"] == "1":
                return fields["current_state"], fields["plugin_output"], fields["performance_data"]
        return "", "", ""


@pytest.fixture
def site(tmp_path: Path) -> Iterator[tuple[Nagios, int, Process]]:
    """Nagios, the ROS domain, and the exporter; one virtual robot is there."""
    address = f"127.0.0.1:{ports.free_port()}"
    nagios = nagios_program.prepare(tmp_path / "nagios", objects(f"http://{address}"))
    with domains.lease() as domain:
        (tmp_path / "fleet.yml").write_text(
            "fleet: hall\nprofiles: {default: {stale_after: 5s}}\n"
            f"robots: [{{name: robot_1, namespace: /robot_1, domain_id: {domain}}}]\n"
        )
        commands = {
            "robots": [BIN / "virtual-robots", "--robots", "1", "--domain-id", str(domain)],
            "exporter": [
                *(BIN / "ros-diagnostics-exporter", "--config.file", tmp_path / "fleet.yml"),
                *("--web.listen-address", address, "--storage.path", tmp_path / "exporter.db"),
            ],
        }
        running = {
            name: Process(name, command, domains.environment(domain), tmp_path / f"{name}.log")
            for name, command in commands.items()
        }
        running["nagios"] = nagios
        try:
            for each in running.values():
                each.start()
            yield Nagios(tmp_path / "nagios"), domain, running["exporter"]
        finally:
            for each in reversed(running.values()):
                each.stop()


def test_nagios_shows_faults_and_recoveries_and_a_lost_exporter(site):
    nagios, domain, exporter = site

    def becomes(name: str, state: str, output: str) -> None:
        until(
            lambda: nagios.service(name)[0] == state and output in nagios.service(name)[1],
            lambda: f"{name} in state {state} with {output!r}, is {nagios.service(name)}",
            60,
        )

    fine = "OK - OK sensor(s) list: /Motor/Motor 1, /Motor/Motor 2, /Motor/Motor 3"
    becomes("motors", "0", fine)
    becomes("lasers", "0", "OK - OK sensor(s) list: /Laser/Laser 1, /Laser/Laser 2")
    becomes("grippers", "2", "CRITICAL - no sensor matches 'Gripper'")
    assert nagios.service("motors")[2].startswith("critical=0;;;0 stale=0;;;0 warning=0;;;0 ok=3")

    fault(domain, "error")
    becomes(
        "motors",
        "2",
        "CRITICAL - CRITICAL sensor(s) list: /Motor/Motor 2 (not confirmed yet, ",
    )
    # The service's state is what it was; only the text says that the exporter has confirmed it.
    becomes("motors", "2", "CRITICAL - CRITICAL sensor(s) list: /Motor/Motor 2 (confirmed, for ")
    output = nagios.service("motors")[1]
    assert output.endswith("), OK sensor(s) list: /Motor/Motor 1, /Motor/Motor 3")
    fault(domain, "ok")
    becomes("motors", "0", fine)

    exporter.stop()
    becomes("motors", "3", "UNKNOWN - http://127.0.0.1")


def fault(domain: int, level: str) -> None:
    command = [BIN / "virtual-robots", "fault", "robot_1", "Motor 2", level]
    subprocess.run(
        [*map(str, command), "--domain-id", str(domain)],
        check=True,
        timeout=60,
        env=domains.environment(domain),
    )
