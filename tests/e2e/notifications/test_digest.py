"""The digest of warnings: the shipped routes, with short times, on a real Alertmanager."""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from typing import Any

from support.alerts import post_alerts
from support.uncommented import uncommented
from testbed.polling import until
from testbed.site import Site

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


def start(site: Site, *, now: bool) -> str:
    """Start the Alertmanager within or outside of its digest time; returns its address."""

    def enable_digest(content: dict[str, Any]) -> None:
        content.update(uncommented(COMMENTED))
        [digest] = [each for each in content["route"]["routes"] if each["receiver"] == "digest"]
        digest |= {"group_wait": "1s", "group_interval": "1s", "repeat_interval": "4s"}
        [hours] = [each for each in content["time_intervals"] if each["name"] == "digest-time"]
        hours["time_intervals"] = [{"weekdays": sorted(_days(now=now))}]

    site.start_mail_server()
    site.start_alertmanager(edit=enable_digest)
    site.wait_until_ready()
    return site.addresses.alertmanager


def _days(*, now: bool) -> set[str]:
    """Names of days that include the present one, whenever midnight is, or do not."""
    today = datetime.now(timezone.utc)
    names = [f"{today + timedelta(days=days):%A}".lower() for days in range(-1, 6)]
    return set(names[:3] if now else names[3:])


def test_warnings_of_a_team_are_one_mail_again_and_again(site: Site):
    address, subjects = start(site, now=True), site.inbox.subjects

    post_alerts(address, *ALERTS, fault("Arm", "critical", team="arms"))

    arms = "** DIGEST ** 2 warnings of team arms"
    carts = "** DIGEST ** 1 warning of team carts"
    until(
        lambda: min(subjects().count(arms), subjects().count(carts)) == 2,
        lambda: f"two digests of each team: {subjects()}",
        60,
    )
    assert set(subjects()) == {arms, carts, CRITICAL}
    assert subjects().count(CRITICAL) == 1
    mail = next(each for each in site.inbox.mails() if each.subject == arms)
    assert "- Motor 1 of r1 (fleet f) is WARNING since " in mail.text
    for part in (mail.text, mail.html):
        assert "Motor 2 is worn" in part
        assert "Wheel" not in part
        assert "Arm" not in part


def test_outside_of_its_time_there_is_no_digest(site: Site):
    address, subjects = start(site, now=False), site.inbox.subjects

    post_alerts(address, *ALERTS)
    post_alerts(address, fault("Arm", "critical", team="arms"))  # sent after the warnings' wait
    until(subjects, "the critical one", 60)

    assert subjects() == [CRITICAL]
