"""What a robot can do gets worse and better: one mail for each change, through all real servers."""

import signal
from pathlib import Path
from typing import Any

from support.alerts import reload
from testbed import short_clocks

VIEW = {"view": {"any": ["Motor 1", "Motor 2"]}}
SUBJECT = "demo/robot_2 view is"
NO_RESERVE = f"** PROBLEM ** {SUBJECT} WITHOUT RESERVE"
LOST = f"** PROBLEM ** {SUBJECT} LOST"
BETTER = f"** PROBLEM ** {SUBJECT} WITHOUT RESERVE, no longer LOST"
NOT_LOST = f"** RECOVERY ** {SUBJECT} no longer LOST"
WELL = f"** RECOVERY ** {SUBJECT} no longer WITHOUT RESERVE"


def test_each_change_of_a_capability_is_one_mail_and_its_end_one_recovery(
    stack, tmp_path: Path, wait_for_mails, wait_for_scrapes
):
    short_clocks.edit(tmp_path / "fleet.yml", _add_capability)
    stack.exporter.process.signal(signal.SIGHUP)
    alertmanager = tmp_path / "alertmanager" / "alertmanager.yml"
    short_clocks.edit(alertmanager, _add_receiver_of_what_is_critical)
    reload(stack.addresses.alertmanager)

    stack.fault("robot_2", "Motor 1", "error", "winding at 131 C")
    assert wait_for_mails(1) == [NO_RESERVE]
    stack.fault("robot_2", "Motor 2", "error", "winding at 131 C")
    assert wait_for_mails(3)[1:] == [LOST, LOST]  # to both receivers

    stack.fault("robot_2", "Motor 1", "ok")
    assert sorted(wait_for_mails(5)[3:]) == sorted([BETTER, NOT_LOST])
    by_receiver = {mail.recipients[0]: mail for mail in stack.inbox.mails()[3:]}
    assert by_receiver["critical@example.org"].subject == NOT_LOST
    [to_all] = [mail for address, mail in by_receiver.items() if not address.startswith("critical")]
    assert "It is no longer LOST." in to_all.text

    stack.fault("robot_2", "Motor 2", "ok")
    wait_for_mails(6)
    wait_for_scrapes(3)  # one mail too many would arrive within these
    assert [mail.subject for mail in stack.inbox.mails()][5:] == [WELL]


def _add_capability(config: dict[str, Any]) -> None:
    config["profiles"]["default"]["capabilities"] = VIEW


def _add_receiver_of_what_is_critical(config: dict[str, Any]) -> None:
    route = {"matchers": ["severity = critical"], "receiver": "critical", "continue": True}
    config["route"]["routes"].insert(0, route)
    [email] = [each for each in config["receivers"] if each["name"] == "email"]
    to = {**email["email_configs"][0], "to": "critical@example.org"}
    config["receivers"].append({"name": "critical", "email_configs": [to]})
