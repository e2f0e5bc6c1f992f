"""Virtual robots, and a command by which Nagios checks them: it asks the robot or the exporter."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from experiments import site
from support import nagios_program
from testbed import configuration, programs
from testbed.polling import until
from testbed.processes import Process

WAYS = ("subscriber", "exporter")
START_SECONDS = 120.0
OBJECTS = """\
define command {{
  command_name check
  command_line {check} -H $HOSTNAME$ -N "$ARG1$"
}}
define command {{
  command_name notify
  command_line {notify}
}}
define command {{
  command_name alive
  command_line /bin/true
}}
define contact {{
  contact_name operator
  host_notifications_enabled 0
  host_notification_period always
  service_notification_period always
  service_notification_options c,r
  host_notification_commands alive
  service_notification_commands notify
}}
"""
HOST = """\
define host {{
  host_name {robot}
  address {robot}
  check_command alive
  active_checks_enabled 0
  max_check_attempts 1
  contacts operator
}}
"""
SERVICE = """\
define service {{
  host_name {robot}
  service_description {service}
  check_command check!{pattern}
  max_check_attempts {attempts}
  check_interval {interval}
  retry_interval {interval}
  notification_period always
  notification_interval 0
  contacts operator
}}
"""
# All services are checked within the first minute.
SETTINGS = "max_service_check_spread=1\nservice_check_timeout=60\n"


@dataclass(frozen=True)
class NagiosFleet:
    """The running robots, and the exporter where it is asked."""

    folder: Path
    environment: dict[str, str]
    domain_id: int
    robots: Process
    exporter: Process | None
    check: str  # the command without its arguments


@contextmanager
def running(robots: int, way: str) -> Iterator[NagiosFleet]:
    """Start so many robots and, for the way `exporter`, an exporter that has received them all.

    Raises:
        TimeoutError: It was not ready in time.
    """
    with site.started() as started:
        domain_id, folder = started.domain_id, started.folder
        fleet = started.start_robots(robots).process
        fleet.wait_for_output("ready: .*\n", START_SECONDS)
        if way == "subscriber":
            plugin = Path(__file__).with_name("check_by_subscription.py")
            check = f"{sys.executable} {plugin}"
            yield NagiosFleet(folder, started.environment(), domain_id, fleet, None, check)
            return
        config = started.write(
            "fleet.yml",
            f"fleet: {configuration.FLEET}\ndiscovery:\n"
            f'  - {{topic: "/{{robot}}/diagnostics_agg", domain_ids: [{domain_id}]}}\n',
        )
        exporter = started.start_exporter(config)
        until(
            lambda: site.up(exporter.address) == robots,
            f"{robots} robots",
            START_SECONDS,
            every=0.5,
        )
        check = f"{programs.own('check_ros_diagnostics')} --url http://{exporter.address}"
        environment = started.environment()
        yield NagiosFleet(folder, environment, domain_id, fleet, exporter.process, check)


def nagios(
    fleet: NagiosFleet,
    robots: int,
    services: dict[str, str],
    *,
    interval: int,
    attempts: int = 4,
    notify: str = "/bin/true",
) -> Process:
    """Return a Nagios, not yet started, with its files in the folder `nagios` of the fleet's.

    Args:
        fleet: What is checked, and how.
        robots: How many.
        services: Of each robot: name -> text in the names of its components.
        interval: Seconds between two checks, and two attempts.
        attempts: Checks that have to fail before a notification.
        notify: The command of a notification.
    """
    names = [f"robot_{number + 1}" for number in range(robots)]
    objects = [nagios_program.ALWAYS, OBJECTS.format(check=fleet.check, notify=notify)]
    for name in names:
        objects.append(HOST.format(robot=name))
        objects += [
            SERVICE.format(
                robot=name, service=service, pattern=pattern, interval=interval, attempts=attempts
            )
            for service, pattern in services.items()
        ]
    folder = fleet.folder / "nagios"
    return nagios_program.prepare(folder, "".join(objects), SETTINGS, fleet.environment)
