"""When an escalation begins, in the distribution's Nagios and in what `nagios import` says."""

import re
import time
from pathlib import Path

import pytest

from ros_diagnostics_tools.nagios.importer.convert import REPORT, ImportOptions, convert
from support import nagios_program
from testbed.polling import until

pytestmark = pytest.mark.slow

INTERVAL, FIRST = 5, 3  # seconds between two notifications, and the number of the escalation's
OBJECTS = f"""\
define command {{
  command_name check_ros
  command_line /opt/check_ros -N Motor
}}
define command {{
  command_name nothing
  command_line /bin/true
}}
define contact {{
  name everybody
  register 0
  host_notification_period always
  service_notification_period always
  host_notification_options d,u,r
  service_notification_options w,u,c,r
  host_notification_commands nothing
  service_notification_commands nothing
}}
define contact {{
  use everybody
  contact_name ops
  email ops@example.org
}}
define contact {{
  use everybody
  contact_name boss
  email boss@example.org
}}
define host {{
  host_name arm_1
  address 127.0.0.1
  max_check_attempts 1
  active_checks_enabled 0
  notification_period always
  contacts ops
}}
define service {{
  host_name arm_1
  service_description Motors
  check_command check_ros
  max_check_attempts 1
  active_checks_enabled 0
  notification_interval {INTERVAL}
  notification_period always
  contacts ops
}}
define serviceescalation {{
  host_name arm_1
  service_description Motors
  contacts boss
  first_notification {FIRST}
  last_notification 0
  notification_interval 3600
}}
"""


def contacts(folder: Path) -> list[str]:
    """Who was notified of the service, in order."""
    log = folder / "nagios.log"
    text = log.read_text(errors="replace") if log.exists() else ""
    return re.findall(r"SERVICE NOTIFICATION: ([^;]+);arm_1;Motors;CRITICAL", text)


def test_it_begins_after_the_interval_of_the_service_and_not_its_own(tmp_path: Path):
    """Nagios asks which interval holds by the number of the notification that it sent last."""
    folder = tmp_path / "nagios"
    objects = nagios_program.ALWAYS + OBJECTS
    settings = "check_external_commands=1\nenable_notifications=1\nexecute_host_checks=0\n"
    process = nagios_program.prepare(folder, objects, settings)

    def is_escalated() -> bool:
        """With another result of the service: they are what Nagios notifies by."""
        if (folder / "nagios.cmd").exists():
            line = f"[{int(time.time())}] PROCESS_SERVICE_CHECK_RESULT;arm_1;Motors;2;broken\n"
            (folder / "nagios.cmd").write_text(line)
        return "boss" in contacts(folder)

    process.start()
    try:
        until(is_escalated, lambda: f"{contacts(folder)} {process.describe()}", 120, every=0.5)
    finally:
        process.stop()

    assert contacts(folder)[:FIRST] == ["ops"] * (FIRST - 1) + ["boss"]
    made = convert([folder / "nagios.cfg"], ImportOptions("hall"))
    seconds = INTERVAL * (FIRST - 1)
    assert f"about {seconds}s after the first notification" in made.texts[REPORT]
