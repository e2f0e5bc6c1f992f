"""A team with notifications in working hours only: the shipped route, enabled, on a real server."""

from __future__ import annotations

import time
from datetime import datetime, timedelta, timezone
from functools import partial
from typing import Any

import pytest

from support.alerts import post_alerts, reload
from support.uncommented import uncommented
from testbed import short_clocks
from testbed.polling import until
from testbed.site import Site

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
    """An Alertmanager whose working hours the test sets."""

    def __init__(self, site: Site) -> None:
        self.site = site
        self.address = site.addresses.alertmanager
        self.subjects = site.inbox.subjects
        site.start_mail_server()
        site.start_alertmanager(edit=partial(self._enable, now=False))
        site.wait_until_ready()

    def set_hours(self, *, now: bool) -> None:
        """Let working hours include now, or other days only."""
        config = self.site.folder / "alertmanager" / "alertmanager.yml"
        short_clocks.edit(config, partial(self._set_hours, now=now))
        reload(self.address)

    def _enable(self, content: dict[str, Any], *, now: bool) -> None:
        content.update(uncommented(COMMENTED))
        content["route"]["group_interval"] = "1s"
        self._set_hours(content, now=now)

    def _set_hours(self, content: dict[str, Any], *, now: bool) -> None:
        around = [datetime.now(timezone.utc) + timedelta(days=days) for days in (-1, 0, 1)]
        days = {f"{day:%A}".lower() for day in around}  # midnight may be within the test
        others = {"monday", "tuesday", "wednesday", "thursday", "friday"} - days
        content["time_intervals"][0]["time_intervals"] = [
            {"weekdays": sorted(days if now else others)}
        ]

    def wait_for(self, address: str, *subjects: str) -> None:
        until(
            lambda: self.subjects(address) == [*subjects], lambda: f"{self.subjects(address)}", 30
        )

    def settle(self) -> None:
        """Wait until a mail that is not held back would have arrived."""
        then = time.monotonic() + 4
        until(lambda: time.monotonic() >= then, "a few times group_interval")


@pytest.fixture
def hours(site: Site) -> WorkingHours:
    return WorkingHours(site)


def test_a_fault_before_working_hours_is_sent_to_the_team_when_they_begin(hours: WorkingHours):
    """Everybody else is notified at once. The team gets no recovery outside its hours."""
    post_alerts(hours.address, FAULT)
    hours.wait_for(EVERYBODY, PROBLEM)
    hours.settle()
    assert hours.subjects(TEAM) == []

    hours.set_hours(now=True)
    hours.wait_for(TEAM, PROBLEM)

    hours.set_hours(now=False)
    post_alerts(hours.address, FAULT, resolved=True)
    hours.wait_for(EVERYBODY, PROBLEM, RECOVERY)
    hours.settle()
    assert hours.subjects(TEAM) == [PROBLEM]


def test_within_working_hours_the_team_gets_problem_and_recovery(hours: WorkingHours):
    hours.set_hours(now=True)
    post_alerts(hours.address, FAULT)
    hours.wait_for(TEAM, PROBLEM)
    post_alerts(hours.address, FAULT, resolved=True)
    hours.wait_for(TEAM, PROBLEM, RECOVERY)
    hours.wait_for(EVERYBODY, PROBLEM, RECOVERY)
