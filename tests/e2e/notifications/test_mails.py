"""From a fault in a virtual robot to the operator's inbox, through all real servers."""

from __future__ import annotations

import signal
from html import unescape
from pathlib import Path

import pytest

PROBLEM = "** PROBLEM ** demo/robot_2 Motor 2 is CRITICAL"
RECOVERY = "** RECOVERY ** demo/robot_2 Motor 2 is no longer CRITICAL"
BATTERY = "demo/robot_2 Robot Battery Level"
FALLING = f"** PROBLEM ** {BATTERY} is falling towards its threshold"
RISEN = f"** RECOVERY ** {BATTERY} is no longer falling towards its threshold"
WRONG = "** PROBLEM ** demo/robot_1 is off the server's clock"
RIGHT = "** RECOVERY ** demo/robot_1 is no longer off the server's clock"
SCALE = "        scale: 0.01\n"
THRESHOLD = "        thresholds: {low: {critical: 0.15}}\n"


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
            assert "/d/ros-diagnostics-component?" in part
            assert "/user/alerts/RosDiagnosticsComponentCritical.md" in part
            assert "component%3D%22Motor%202%22" in part
            assert " -- 'robot_2' 'Motor 2'" in unescape(part)


def test_an_exporter_killed_and_restarted_while_a_motor_is_critical_sends_no_mail(
    stack, wait_for_mails, wait_for_scrapes
):
    stack.fault("robot_2", "Motor 2", "error", "winding at 131 C")
    assert wait_for_mails(1) == [PROBLEM]

    stack.exporter.process.kill()
    wait_for_failed_scrape(stack)
    stack.exporter.process.start()
    wait_for_scrapes(8)

    assert [mail.subject for mail in stack.inbox.mails()] == [PROBLEM]
    stack.fault("robot_2", "Motor 2", "ok")
    wait_for_mails(2)
    wait_for_scrapes(3)
    assert [mail.subject for mail in stack.inbox.mails()] == [PROBLEM, RECOVERY]


@pytest.mark.slow
def test_a_wrong_clock_and_a_falling_value_are_one_mail_each_and_one_recovery(
    stack, tmp_path: Path, wait_for_mails, wait_for_scrapes
):
    fleet = tmp_path / "fleet.yml"
    text = fleet.read_text()
    assert SCALE in text
    text = text.replace(SCALE, SCALE + THRESHOLD)
    fleet.write_text(text + "faults: {falling: {over: 15s}}\n")
    stack.exporter.process.signal(signal.SIGHUP)

    stack.fault("robot_1", "", "clock_jump: 30")  # wrong for a minute, before it is a fault
    stack.fault("robot_2", "Robot Battery", "draining")
    assert wait_for_mails(1) == [FALLING]
    stack.fault("robot_2", "Robot Battery", "ok")
    assert set(wait_for_mails(3)[1:]) == {RISEN, WRONG}
    stack.fault("robot_1", "", "clock_jump: -30")
    assert wait_for_mails(4)[3:] == [RIGHT]
    wait_for_scrapes(3)  # one mail too many would arrive within these

    assert len(stack.inbox.mails()) == 4
    texts = {mail.subject: mail.text for mail in stack.inbox.mails()}
    assert "falling to the threshold of 0.15 ratio" in texts[FALLING]
    assert "RosDiagnosticsValueFalling.md" in texts[FALLING]
    assert "its clock is 30 s ahead of the exporter's" in texts[WRONG]
    assert "RosDiagnosticsClockOffset.md" in texts[WRONG]


def wait_for_failed_scrape(stack) -> None:
    from testbed.polling import until

    until(lambda: stack.query('up{job="ros-diagnostics-faults"} == 0'), "a scrape that fails")
