"""The digest of warnings: the shipped routes, with short times, on a real Alertmanager."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest
import yaml

from support.alerts import post_alerts
from testbed.configuration import CHECKOUT
from testbed.http import answers
from testbed.mail import Inbox, MailServer
from testbed.polling import until
from testbed.processes import Process
from testbed.programs import alertmanager

COMMENTED = """\
    # - matchers: [severity = warning, step = "0"]
    #   receiver: none
    # - matchers: [severity = warning]
    #   receiver: digest
    #   group_by: [team]
    #   group_wait: 1m
    #   group_interval: 30m
    #   repeat_interval: 20h
    #   active_time_intervals: [digest-time]
"""
CRITICAL = "** PROBLEM ** f/r1 Arm is CRITICAL"


def fault(component: str, state: str, **more: str) -> dict[str, Any]:
    names = {"fleet": "f", "robot": "r1", "component": component, "scope": "component"}
    name = {"alertname": f"RosDiagnosticsComponent{state.title()}"}
    labels = {**name, **names, "state": state, "severity": state, **more}
    return {"labels": labels, "annotations": {"evidence": f"{component} is worn"}}


ALERTS = [
    fault("Motor 1", "warning", team="arms"),
    fault("Motor 2", "warning", team="arms"),
    fault("Wheel", "warning", team="carts"),
    fault("Lamp", "warning", alertname="RosDiagnosticsUnacknowledged", step="0"),
]


@pytest.fixture
def start(
    tmp_path: Path, free_port: Callable[[], int], start_process: Callable[..., Process]
) -> Iterator[Callable[..., tuple[str, Inbox]]]:
    """A function: starts the Alertmanager within or outside of its digest time."""
    inbox = Inbox()
    server = MailServer(f"127.0.0.1:{free_port()}", inbox)
    server.start()

    def start(*, now: bool) -> tuple[str, Inbox]:
        shutil.copytree(CHECKOUT / "alertmanager", tmp_path / "alertmanager")
        config = tmp_path / "alertmanager" / "alertmanager.yml"
        text = config.read_text()
        assert COMMENTED in text
        content = yaml.safe_load(text.replace(COMMENTED, COMMENTED.replace("# ", "")))
        content["global"]["smtp_smarthost"] = server.address
        [digest] = [each for each in content["route"]["routes"] if each["receiver"] == "digest"]
        digest |= {"group_wait": "1s", "group_interval": "1s", "repeat_interval": "4s"}
        [hours] = [each for each in content["time_intervals"] if each["name"] == "digest-time"]
        hours["time_intervals"] = [{"weekdays": sorted(_days(now=now))}]
        config.write_text(yaml.safe_dump(content))
        address = f"127.0.0.1:{free_port()}"
        start_process("alertmanager", alertmanager(config, address, tmp_path / "data"))
        until(lambda: answers(address, "/-/ready"), "Alertmanager is ready", 30)
        return address, inbox

    yield start
    server.stop()


def _days(*, now: bool) -> set[str]:
    """Names of days that include the present one, whenever midnight is, or do not."""
    today = datetime.now(timezone.utc)
    names = [f"{today + timedelta(days=days):%A}".lower() for days in range(-1, 6)]
    return set(names[:3] if now else names[3:])


def test_warnings_of_a_team_are_one_mail_again_and_again(start):
    address, inbox = start(now=True)

    post_alerts(address, *ALERTS, fault("Arm", "critical", team="arms"))

    arms = "** DIGEST ** 2 warnings of team arms"
    carts = "** DIGEST ** 1 warning of team carts"
    until(
        lambda: min(subjects(inbox).count(arms), subjects(inbox).count(carts)) == 2,
        lambda: f"two digests of each team: {subjects(inbox)}",
        60,
    )
    assert set(subjects(inbox)) == {arms, carts, CRITICAL}
    assert subjects(inbox).count(CRITICAL) == 1
    mail = next(each for each in inbox.mails() if each.subject == arms)
    assert "- Motor 1 of r1 (fleet f) is WARNING since " in mail.text
    for part in (mail.text, mail.html):
        assert "Motor 2 is worn" in part
        assert "Wheel" not in part
        assert "Arm" not in part


def test_outside_of_its_time_there_is_no_digest(start):
    address, inbox = start(now=False)

    post_alerts(address, *ALERTS)
    post_alerts(address, fault("Arm", "critical", team="arms"))  # sent after the warnings' wait
    until(lambda: subjects(inbox), "the critical one", 60)

    assert subjects(inbox) == [CRITICAL]


def subjects(inbox: Inbox) -> list[str]:
    return [mail.subject for mail in inbox.mails()]
