"""A team with notifications in working hours only: the shipped route, enabled, on a real server."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest
import yaml

from support.alerts import post_alerts, reload
from testbed.configuration import CHECKOUT
from testbed.http import answers
from testbed.mail import Inbox, MailServer
from testbed.polling import until
from testbed.programs import alertmanager

COMMENTED = """\
    # - matchers: [team = arms]
    #   receiver: team
    #   continue: true
    #   active_time_intervals: [working-hours]
"""
FAULT = {
    "labels": {
        "alertname": "RosDiagnosticsComponentCritical",
        "severity": "critical",
        "scope": "component",
        "state": "critical",
        "fleet": "f",
        "robot": "r1",
        "component": "Motor 1",
        "team": "arms",
    }
}
PROBLEM = "** PROBLEM ** f/r1 Motor 1 is CRITICAL"
RECOVERY = "** RECOVERY ** f/r1 Motor 1 is no longer CRITICAL"
EVERYBODY = "robots@localhost"
TEAM = "team@localhost"


class WorkingHours:
    """The configuration of an Alertmanager whose working hours the test sets."""

    def __init__(self, folder: Path, free_port: Callable[[], int]) -> None:
        shutil.copytree(CHECKOUT / "alertmanager", folder / "alertmanager")
        self.config = folder / "alertmanager" / "alertmanager.yml"
        self.address = f"127.0.0.1:{free_port()}"
        self.smtp = f"127.0.0.1:{free_port()}"
        self.inbox = Inbox()

    def set_hours(self, *, now: bool) -> None:
        """Write working hours that include now, or other days only."""
        text = self.config.read_text()
        content = yaml.safe_load(text.replace(COMMENTED, COMMENTED.replace("# ", "")))
        content["global"]["smtp_smarthost"] = self.smtp
        content["route"]["group_interval"] = "1s"
        for receiver in content["receivers"]:
            receiver.pop("webhook_configs", None)  # no exporter is running
        around = [datetime.now(timezone.utc) + timedelta(days=days) for days in (-1, 0, 1)]
        days = {f"{day:%A}".lower() for day in around}  # midnight may be within the test
        others = {"monday", "tuesday", "wednesday", "thursday", "friday"} - days
        content["time_intervals"][0]["time_intervals"] = [
            {"weekdays": sorted(days if now else others)}
        ]
        self.config.write_text(yaml.safe_dump(content))

    def subjects(self, address: str) -> list[str]:
        """The subjects of all mails to the address."""
        return [each.subject for each in self.inbox.mails() if address in each.recipients]

    def wait_for(self, address: str, *subjects: str) -> None:
        until(
            lambda: self.subjects(address) == [*subjects], lambda: f"{self.subjects(address)}", 30
        )

    def settle(self) -> None:
        """Wait until a mail that is not held back would have arrived."""
        then = time.monotonic() + 4
        until(lambda: time.monotonic() >= then, "a few times group_interval")


@pytest.fixture
def site(
    tmp_path: Path, free_port: Callable[[], int], start_process: Callable[..., Any]
) -> Iterator[WorkingHours]:
    assert COMMENTED in (CHECKOUT / "alertmanager" / "alertmanager.yml").read_text()
    site = WorkingHours(tmp_path, free_port)
    site.set_hours(now=False)
    server = MailServer(site.smtp, site.inbox)
    server.start()
    start_process("alertmanager", alertmanager(site.config, site.address, tmp_path / "data"))
    until(lambda: answers(site.address, "/-/ready"), "Alertmanager is ready", 30)
    yield site
    server.stop()


def test_a_fault_before_working_hours_is_sent_to_the_team_when_they_begin(site: WorkingHours):
    """Everybody else is notified at once. The team gets no recovery outside its hours."""
    post_alerts(site.address, FAULT)
    site.wait_for(EVERYBODY, PROBLEM)
    site.settle()
    assert site.subjects(TEAM) == []

    site.set_hours(now=True)
    reload(site.address)
    site.wait_for(TEAM, PROBLEM)

    site.set_hours(now=False)
    reload(site.address)
    post_alerts(site.address, FAULT, resolved=True)
    site.wait_for(EVERYBODY, PROBLEM, RECOVERY)
    site.settle()
    assert site.subjects(TEAM) == [PROBLEM]


def test_within_working_hours_the_team_gets_problem_and_recovery(site: WorkingHours):
    site.set_hours(now=True)
    reload(site.address)
    post_alerts(site.address, FAULT)
    site.wait_for(TEAM, PROBLEM)
    post_alerts(site.address, FAULT, resolved=True)
    site.wait_for(TEAM, PROBLEM, RECOVERY)
    site.wait_for(EVERYBODY, PROBLEM, RECOVERY)
