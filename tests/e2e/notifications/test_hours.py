"""A team with notifications in working hours only: the shipped route, enabled, on a real server."""

import time
from datetime import datetime, timedelta, timezone
from typing import Any

from support.alerts import fault, post_alerts, reload
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
FAULT = fault("Motor 1", team="arms")
PROBLEM = "** PROBLEM ** f/r1 Motor 1 is CRITICAL"
RECOVERY = "** RECOVERY ** f/r1 Motor 1 is no longer CRITICAL"
EVERYBODY = "robots@localhost"
TEAM = "team@localhost"


def set_hours(content: dict[str, Any], *, now: bool) -> None:
    """Let working hours include now, or other days only."""
    around = [datetime.now(timezone.utc) + timedelta(days=days) for days in (-1, 0, 1)]
    days = {f"{day:%A}".lower() for day in around}  # midnight may be within the test
    others = {"monday", "tuesday", "wednesday", "thursday", "friday"} - days
    weekdays = sorted(days if now else others)
    content["time_intervals"][0]["time_intervals"] = [{"weekdays": weekdays}]


def enable(content: dict[str, Any]) -> None:
    content.update(uncommented(COMMENTED))
    content["route"]["group_interval"] = "1s"
    set_hours(content, now=False)


def test_a_fault_before_working_hours_is_sent_to_the_team_when_they_begin(site: Site):
    """Everybody else is notified at once. The team gets no recovery outside its hours."""
    address, subjects = site.addresses.alertmanager, site.inbox.subjects
    site.start_mail_server()
    site.start_alertmanager(edit=enable)
    site.wait_until_ready()

    def become(*, now: bool) -> None:
        config = site.folder / "alertmanager" / "alertmanager.yml"
        short_clocks.edit(config, lambda content: set_hours(content, now=now))
        reload(address)

    def have(who: str, *wanted: str) -> None:
        until(lambda: subjects(who) == [*wanted], lambda: f"{subjects(who)}", 30)

    def settle() -> None:
        """Wait until a mail that is not held back would have arrived."""
        then = time.monotonic() + 4
        until(lambda: time.monotonic() >= then, "a few times group_interval")

    post_alerts(address, FAULT)
    have(EVERYBODY, PROBLEM)
    settle()
    assert subjects(TEAM) == []

    become(now=True)
    have(TEAM, PROBLEM)

    become(now=False)
    post_alerts(address, FAULT, resolved=True)
    have(EVERYBODY, PROBLEM, RECOVERY)
    settle()
    assert subjects(TEAM) == [PROBLEM]
