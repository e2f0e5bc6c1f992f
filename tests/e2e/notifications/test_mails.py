"""From what is wrong with a robot or the exporter to the operator's inbox, by all real servers."""

from __future__ import annotations

from html import unescape

import pytest

from ros_diagnostics_tools.main import main
from testbed.http import get_json

PROBLEM = "** PROBLEM ** demo/robot_2 Motor 2 is CRITICAL"
RECOVERY = "** RECOVERY ** demo/robot_2 Motor 2 is no longer CRITICAL"


@pytest.mark.slow  # the demo, which is tested too, sends one of each
def test_each_fault_and_each_recovery_of_a_motor_is_one_mail(
    stack, wait_for_mails, wait_for_scrapes
):
    for cycle in (0, 2):
        stack.fault("robot_2", "Motor 2", "error", "winding at 131 C")
        wait_for_mails(cycle + 1)
        stack.fault("robot_2", "Motor 2", "ok")
        wait_for_mails(cycle + 2)
    wait_for_scrapes(3)  # one mail too many would arrive within these

    mails = stack.inbox.mails()
    assert [mail.subject for mail in mails] == [PROBLEM, RECOVERY, PROBLEM, RECOVERY]
    for mail in mails:
        assert "robot_2" in mail.text
        assert f"{mail.text.splitlines()[0]}</h1>" in mail.html
    assert len({mail.thread for mail in mails}) == 1
    for problem in mails[::2]:
        for part in (problem.text, problem.html):
            assert "winding at 131 C" in part
            assert "Temperature" in part
            assert ("/d/ros-diagnostics-component?" in part) == bool(stack.addresses.grafana)
            assert "/user/alerts/RosDiagnosticsComponentCritical.md" in part
            assert "component%3D%22Motor%202%22" in part
            assert " -- 'robot_2' 'Motor 2'" in unescape(part)


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_a_reload_that_fails_is_one_mail_can_be_acknowledged_and_has_one_recovery(
    stack, wait_for_mails, capsys
):
    config = stack.exporter.config
    valid = config.read_text()
    config.write_text(f"{valid}\nno_such_key: true\n")
    fleet = get_json(stack.addresses.exporter, "/api/v1/fleet")["fleet"]
    problem = f"** PROBLEM ** {fleet} exporter is WARNING: fleet.yml"
    assert wait_for_mails(1, within=180) == [problem]
    (mail,) = stack.inbox.mails()
    assert "it could not be reloaded" in mail.text
    assert "RosDiagnosticsExporterFault.md" in mail.text

    who = ("--author", "ann", "--comment", "a typo")
    url = ("--alertmanager", f"http://{stack.addresses.alertmanager}")
    assert main(["ack", "--part", "fleet.yml", *who, *url]) == 0
    assert "fleet.yml of the exporter WARNING" in capsys.readouterr().out

    config.write_text(valid)
    recovery = f"** RECOVERY ** {fleet} exporter is no longer WARNING: fleet.yml"
    assert wait_for_mails(2, within=120) == [problem, recovery]
