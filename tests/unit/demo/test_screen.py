"""The demo's output: problems in the table, and whole mails."""

import io

import pytest
from rich.console import Console

from demo.screen import Screen
from demo.snapshot import Alert, Problem, RobotStatus, Snapshot
from testbed.mail import Mail

LINK = "http://127.0.0.1:61000/d/ros-diagnostics-component?" + "x" * 120
PROBLEM = Problem("Motor 2", "ERROR", "no [encoder] pulses")
SNAPSHOT = Snapshot(
    (
        RobotStatus("robot_10", True, 0.4, 10, ()),
        RobotStatus("robot_3", True, 0.4, 10, (Problem("Cam 1", "WARN", "dark"), PROBLEM)),
        RobotStatus("robot_4", False, None, 0, ()),
    ),
    (Alert("RosDiagnosticsComponentCritical", "robot_3", "Motor 2", "active"),),
)


@pytest.fixture
def paper():
    return io.StringIO()


@pytest.fixture
def screen(paper):
    return Screen(Console(file=paper, width=110))


def test_the_table_has_each_robots_worst_level_and_its_problems(screen, paper):
    screen.print_table(SNAPSHOT)

    rows = [line for line in paper.getvalue().splitlines() if "robot_" in line]
    assert [row.split()[1] for row in rows] == ["robot_3", "robot_4", "robot_10"]
    assert "ERROR" in rows[0]
    assert "ComponentCritical" in rows[0]
    assert "Motor 2: ERROR, no [encoder] pulses" in paper.getvalue()
    assert "SILENT" in rows[1]
    assert "never" in rows[1]
    assert "OK" in rows[2]


def test_a_mail_is_shown_with_its_links_unbroken(screen, paper):
    mail = Mail(0.0, "a@b", ("c@d", "e@f"), "** PROBLEM ** [x]", f"Dashboard: {LINK}\n", "")

    screen.print_mail(12.3, mail)

    shown = paper.getvalue().splitlines()
    assert "  12.3 s mail server: received an email" in shown
    assert "To: c@d, e@f" in shown
    assert "Subject: ** PROBLEM ** [x]" in shown
    assert f"Dashboard: {LINK}" in shown
