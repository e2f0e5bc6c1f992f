"""A robot that fails to dock, from its action server of rclpy to the mails, across restarts."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from support.action_robot import ActionRobot
from support.mailbox import wait_for_mail
from support.replaced import replace_text
from testbed import http
from testbed.mail import Mail
from testbed.polling import until
from testbed.site import Site

DOCK = "dock_robot"
FLEET = """
fleet: hall
robots: [{{name: amr_1, namespace: /amr_1, domain_id: {domain}}}]
profiles:
  default:
    confirm_after: 3s
    actions: [{{match: dock_robot, aborted: {{critical: 2}}}}]
faults: {{restart_grace: 1s}}
"""
DRIVERS = """
import sys
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

level = Path(sys.argv[1])
rclpy.init()
node = rclpy.create_node("drivers", namespace="/amr_1")
diagnostics = node.create_publisher(DiagnosticArray, "diagnostics", 10)

def report():
    is_broken = level.read_text() == "broken"
    laser = DiagnosticStatus(name="Laser 1", message="no scan" if is_broken else "OK")
    laser.level = DiagnosticStatus.ERROR if is_broken else DiagnosticStatus.OK
    diagnostics.publish(DiagnosticArray(status=[laser]))

node.create_timer(0.5, report)
rclpy.spin(node)
"""


class Hall:
    """The site, and what it says of the robot's goals."""

    def __init__(self, site: Site, level: Path) -> None:
        self.site, self._level = site, level

    def set_laser(self, word: str) -> None:
        """Let the laser be broken or OK."""
        replace_text(self._level, word)

    def scraped(self) -> dict[str, float]:
        """How many goals Prometheus has by result, of those that there were."""
        query = 'ros_diagnostics_goals_total{robot="amr_1"} > 0'
        return {each.labels["result"]: each.value for each in self.site.query(query)}

    def goals(self) -> dict[str, int]:
        """How many goals the exporter has by result, of those that there were."""
        results = self._action()["results"]
        return {result: number for result, number in results.items() if number}

    def running(self) -> int | None:
        """The goals that run; None before the action was found."""
        action = self._action()
        return action["running"] if action.get("reached") else None

    def _action(self) -> dict[str, Any]:
        found = http.get_json(self.site.addresses.exporter, "/api/v1/missions?robot=amr_1")
        for each in found["robots"]:
            return each["actions"][0]
        return {"results": {}}

    def mails(self, kind: str) -> int:
        """How many mails of this kind there are about docking."""
        return sum(kind in each and DOCK in each for each in self.site.inbox.subjects())

    def wait_for_mail(self, *words: str) -> Mail:
        return wait_for_mail(self.site.inbox, *words, "amr_1")

    def wait(self, condition: Callable[[], object], what: str) -> None:
        def state() -> str:
            return f"{what}: goals {self.goals()}, mails {self.site.inbox.subjects()}"

        until(condition, state, 90)

    def run(self, robot: ActionRobot, how: str) -> None:
        """Have a goal begin, and end so; returns once the exporter has seen that."""
        robot.tell("begin", DOCK)
        self.wait(lambda: self.running() == 1, "a goal runs")
        robot.tell(how, DOCK)
        self.wait(lambda: self.running() == 0, "no goal runs")


@pytest.fixture
def hall(site: Site) -> Hall:
    level = site.write("level", "OK")
    site.start_mail_server()
    site.start_exporter(site.write("fleet.yml", FLEET.format(domain=site.domain_id)))
    site.start_prometheus(interval=1, tenth=True)
    site.start_alertmanager(edit=lambda it: it["route"].update(group_interval="1s"))
    argv = [sys.executable, str(site.write("drivers.py", DRIVERS)), str(level)]
    site.start_program("drivers", argv, domain_id=site.domain_id)
    site.wait_until_ready()
    return Hall(site, level)


@pytest.mark.timeout(400)
def test_aborted_goals_are_a_mail_with_the_fault_of_that_moment_and_a_recovery_later(hall: Hall):
    with ActionRobot("/amr_1", DOCK, environment=hall.site.environment()) as robot:
        hall.wait(lambda: hall.running() == 0, "the action is found")
        hall.set_laser("broken")
        hall.wait_for_mail("PROBLEM", "Laser 1")
        hall.run(robot, "abort")
        hall.run(robot, "abort")
        mail = hall.wait_for_mail("PROBLEM", DOCK)
        assert "aborted 2 of the last 2 goals" in mail.text
        assert "also faulty: Laser 1 CRITICAL" in mail.text

        robot.tell("begin", DOCK)
        hall.wait(lambda: hall.running() == 1, "a goal runs")
        for server in (hall.site.exporter, hall.site.prometheus):
            server.process.kill()
            server.process.start()
        hall.site.wait_until_ready()
        hall.wait(lambda: hall.running() == 1, "the goal is found again")
        assert hall.goals() == {"aborted": 2}

        hall.set_laser("OK")
        hall.wait_for_mail("RECOVERY", "Laser 1")
        robot.tell("succeed", DOCK)
        hall.wait(lambda: hall.goals() == {"aborted": 2, "succeeded": 1}, "one has succeeded")
        assert not hall.mails("RECOVERY")
        hall.run(robot, "succeed")
        hall.wait_for_mail("RECOVERY", DOCK)

    assert hall.goals() == {"aborted": 2, "succeeded": 2}
    hall.wait(lambda: hall.scraped() == hall.goals(), "Prometheus has them")
    assert (hall.mails("PROBLEM"), hall.mails("RECOVERY")) == (1, 1)
