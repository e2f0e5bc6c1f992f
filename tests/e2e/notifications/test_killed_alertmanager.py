"""An Alertmanager that is killed remembers what it wrote of its notifications, and no more."""

import pytest

from support.alerts import fault, post_alerts
from testbed.polling import until
from testbed.site import Site

ARM = {**fault("Arm"), "startsAt": "2025-12-31T23:00:00Z"}


@pytest.mark.parametrize(("interval", "recoveries"), [("15m", 0), ("1s", 1)])
def test_a_recovery_after_a_kill_is_sent_where_the_problem_was_written(
    site: Site, interval: str, recoveries: int
):
    subjects = site.inbox.subjects
    site.start_mail_server()
    server = site.start_alertmanager(
        f"--data.maintenance-interval={interval}",
        edit=lambda it: it["route"].update(group_interval="1s"),
    )
    site.wait_until_ready()
    post_alerts(server.address, ARM)
    until(lambda: len(subjects()) == 1, "the problem", 60)
    written = site.folder / "nflog" / "nflog"
    if recoveries:
        until(lambda: written.exists() and b"email" in written.read_bytes(), "the snapshot", 60)
    server.process.kill()
    server.process.start()
    server.wait_until_ready()
    post_alerts(server.address, ARM, resolved=True)
    if recoveries:
        until(lambda: len(subjects()) == 2, "the recovery", 60)
    post_alerts(server.address, fault("Wheel"))
    until(lambda: "** PROBLEM ** f/r1 Wheel is CRITICAL" in subjects(), "a later problem", 60)

    recovery = "** RECOVERY ** f/r1 Arm is no longer CRITICAL"
    assert subjects().count(recovery) == recoveries
    assert len(subjects()) == 2 + recoveries
