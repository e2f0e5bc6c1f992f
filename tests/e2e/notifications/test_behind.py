"""A computer fails with all that is behind it: one mail, and one recovery, through real servers."""

from __future__ import annotations

import signal
from pathlib import Path

BEHIND = "  default: {components: [{match: [Laser 1, Motor], behind: Robot Battery}],"
PROBLEM = "** PROBLEM ** demo/robot_2 Robot Battery is CRITICAL"
RECOVERY = "** RECOVERY ** demo/robot_2 Robot Battery is no longer CRITICAL"
PARTS = ("Laser 1", "Motor 1")


def test_what_fails_with_what_it_is_behind_is_one_mail_and_one_recovery(
    stack, tmp_path: Path, wait_for_mails, wait_for_scrapes
):
    fleet = tmp_path / "fleet.yml"
    text = fleet.read_text()
    assert "  default: {" in text
    fleet.write_text(text.replace("  default: {", BEHIND + " ", 1))
    stack.exporter.process.signal(signal.SIGHUP)

    stack.fault("robot_2", "Robot Battery", "error", "fuse")
    for part in PARTS:
        stack.fault("robot_2", part, "error", "no supply")
    assert wait_for_mails(1) == [PROBLEM]
    stack.fault("robot_2", "Robot Battery", "ok")
    for part in PARTS:
        stack.fault("robot_2", part, "ok")
    assert wait_for_mails(2) == [PROBLEM, RECOVERY]
    wait_for_scrapes(3)  # one mail too many would arrive within these
    assert [mail.subject for mail in stack.inbox.mails()] == [PROBLEM, RECOVERY]
