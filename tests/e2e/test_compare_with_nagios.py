"""A real Nagios beside the whole pipeline: where both notified differently."""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import pytest

from ros_diagnostics_tools.main import main
from support import nagios_program
from testbed import http
from testbed.polling import until
from testbed.processes import Process

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

PLUGIN = Path(sys.executable).parent / "check_ros_diagnostics"
ROBOTS = ("robot_1", "robot_2", "robot_3")
SERVICES = ("Motor", "Laser")  # as their names the patterns
SETTINGS = "check_external_commands=1\nenable_notifications=1\nlog_notifications=1\n"
COMMON = """\
define command {{
  command_name check_ros_diagnostics
  command_line {plugin} --url {url} -H $HOSTNAME$ -N "$ARG1$"
}}
define command {{
  command_name nothing
  command_line /bin/true
}}
define contact {{
  contact_name ops
  host_notification_period always
  service_notification_period always
  host_notification_options d,r
  service_notification_options w,u,c,r
  host_notification_commands nothing
  service_notification_commands nothing
}}
"""
HOST = """\
define host {{
  host_name {robot}
  address 127.0.0.1
  check_command nothing
  max_check_attempts 1
  check_interval 60
  notification_period always
  contacts ops
}}
"""
SERVICE = """\
define service {{
  host_name {robot}
  service_description {service}
  check_command check_ros_diagnostics!{service}
  max_check_attempts 2
  check_interval 2
  retry_interval 2
  flap_detection_enabled 0
  notification_interval 0
  notification_period always
  contacts ops
}}
"""


def objects(url: str) -> str:
    parts = [nagios_program.ALWAYS, COMMON.format(plugin=PLUGIN, url=url)]
    parts += [HOST.format(robot=robot) for robot in ROBOTS]
    parts += [SERVICE.format(robot=each, service=of) for each in ROBOTS for of in SERVICES]
    return "".join(parts)


@pytest.fixture
def site(stack, tmp_path):
    """The pipeline and its Nagios, which has checked everything."""
    folder = tmp_path / "nagios"
    url = f"http://{stack.addresses.exporter}"
    nagios = nagios_program.prepare(folder, objects(url), SETTINGS)
    found = Site(stack, folder, nagios, url)
    nagios.start()
    found.wait_until_checked()
    yield found
    nagios.stop()


class Site:
    def __init__(self, stack, folder: Path, nagios: Process, url: str) -> None:
        self.stack = stack
        self.nagios = nagios
        self.url = url
        self._folder = folder
        self._log = folder / "nagios.log"

    def wait_until_checked(self) -> None:
        """Wait until every service has been checked since now, and is OK."""
        begin = time.time()

        def checked(robot: str, service: str) -> bool:
            found = nagios_program.service(self._folder, robot, service)
            return found.get("current_state") == "0" and float(found["last_check"]) > begin

        def all_checked() -> bool:
            return all(checked(robot, service) for robot in ROBOTS for service in SERVICES)

        until(all_checked, self.nagios.describe, 120, every=0.5)

    def performance(self, robot: str, service: str) -> str:
        """The performance data that Nagios has read."""
        return nagios_program.service(self._folder, robot, service)["performance_data"]

    def log(self) -> str:
        return self._log.read_text()

    def wait_for_nagios(self, line: str) -> None:
        until(lambda: line in self.log(), lambda: f"{line} in {self.log()[-2000:]}", 60)

    def wait_for_mail(self, subject: str) -> None:
        def subjects() -> list[str]:
            return [each.subject for each in self.stack.inbox.mails()]

        until(
            lambda: any(subject in each for each in subjects()),
            lambda: f"{subject} in {subjects()}",
            60,
        )

    def wait_for_record(self, robot: str, after: str) -> float:
        """Wait until the exporter has recorded a notification; the Unix time of the record."""

        def recorded() -> list[dict]:
            path = f"/api/v1/events?kind=notified&robot={robot}"
            return http.get_json(self.url.removeprefix("http://"), path)["events"]

        def times() -> list[float]:
            return [each["time"] for each in recorded() if each["after"] == after]

        return until(times, lambda: f"{robot} {after} among {recorded()}", 60)[0]

    def passive(self, robot: str, service: str, code: int) -> None:
        """Somebody else sends Nagios two results: enough for a hard state."""
        line = f"[{int(time.time())}] PROCESS_SERVICE_CHECK_RESULT;{robot};{service};{code};by hand"
        with (self._folder / "nagios.cmd").open("w") as pipe:
            pipe.write(f"{line}\n{line}\n")

    def compare(self, capsys) -> tuple[int, dict]:
        capsys.readouterr()
        code = main(["nagios", "compare", str(self._log), "--url", self.url, "--output", "json"])
        return code, json.loads(capsys.readouterr().out)


def about(found: dict, side: str) -> list[tuple[str, str, str]]:
    return [(each["robot"], each["service"], each["state"]) for each in found[side]]


def break_and_repair(site: Site, robot: str, component: str, level: str, state: str) -> None:
    """Until both have notified both."""
    service = component.split(maxsplit=1)[0]
    site.stack.fault(robot, component, level)
    site.wait_for_mail(f"PROBLEM ** demo/{robot} {component} is {state}")
    site.wait_for_nagios(f"SERVICE NOTIFICATION: ops;{robot};{service};{state};")
    site.stack.fault(robot, component, "ok")
    site.wait_for_mail(f"RECOVERY ** demo/{robot} {component}")
    site.wait_for_nagios(f"SERVICE NOTIFICATION: ops;{robot};{service};OK;")


def test_what_only_nagios_or_only_this_project_notified_is_found(site, capsys):
    break_and_repair(site, "robot_1", "Motor 1", "error", "CRITICAL")
    break_and_repair(site, "robot_2", "Laser 1", "warn", "WARNING")

    until(lambda: site.compare(capsys)[0] == 0, lambda: f"both agree: {site.compare(capsys)}", 30)
    assert site.compare(capsys)[1]["same"] == 4
    assert site.performance("robot_1", "Motor").startswith("critical=0;;;0 stale=0;;;0 warning=0")

    site.passive("robot_2", "Motor", 2)
    site.wait_for_nagios("SERVICE NOTIFICATION: ops;robot_2;Motor;CRITICAL;")
    site.wait_for_nagios("SERVICE NOTIFICATION: ops;robot_2;Motor;OK;")  # by the next check
    site.nagios.stop()
    site.stack.fault("robot_3", "Motor 2", "error")
    site.wait_for_mail("PROBLEM ** demo/robot_3 Motor 2 is CRITICAL")
    site.stack.fault("robot_3", "Motor 2", "ok")
    site.wait_for_mail("RECOVERY ** demo/robot_3 Motor 2")
    # What is later than the last line of Nagios' log is not compared; lines have whole seconds.
    recorded = site.wait_for_record("robot_3", "resolved")
    until(lambda: int(time.time()) > recorded, "the second after the record")
    site.nagios.start()
    site.wait_until_checked()

    code, found = site.compare(capsys)

    assert code == 1
    assert found["same"] == 4
    assert about(found, "only_in_nagios") == [
        ("robot_2", "Motor", "CRITICAL"),
        ("robot_2", "Motor", "OK"),
    ]
    # Nothing of Nagios is about it, so that it is named by its component.
    assert about(found, "only_here") == [
        ("robot_3", "Motor 2", "CRITICAL"),
        ("robot_3", "Motor 2", "OK"),
    ]
