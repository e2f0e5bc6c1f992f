"""The digest of warnings: the shipped routes, with short times, on a real Alertmanager."""

from datetime import datetime, timedelta, timezone
from typing import Any

from support.alerts import fault, post_alerts
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


WORN = [
    fault("Motor 1", "warning", team="arms"),
    fault("Motor 2", "warning", team="arms"),
    fault("Wheel", "warning", team="carts"),
    fault("Lamp", "warning", alertname="RosDiagnosticsUnacknowledged", step="0"),
    fault("Arm", team="arms"),
]
ALERTS = [
    {**each, "annotations": {"evidence": f"{each['labels']['component']} is worn"}} for each in WORN
]


def enable_digest(content: dict[str, Any]) -> None:
    """With short times, on days that include the present one, whenever midnight is."""
    content.update(uncommented(COMMENTED))
    [digest] = [each for each in content["route"]["routes"] if each["receiver"] == "digest"]
    digest |= {"group_wait": "1s", "group_interval": "1s", "repeat_interval": "4s"}
    [hours] = [each for each in content["time_intervals"] if each["name"] == "digest-time"]
    today = datetime.now(timezone.utc)
    days = [f"{today + timedelta(days=days):%A}".lower() for days in (-1, 0, 1)]
    hours["time_intervals"] = [{"weekdays": sorted(days)}]


def test_warnings_of_a_team_are_one_mail_again_and_again(site: Site):
    subjects = site.inbox.subjects
    site.start_mail_server()
    site.start_alertmanager(edit=enable_digest)
    site.wait_until_ready()

    post_alerts(site.addresses.alertmanager, *ALERTS)

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
