"""A pause of the exporter's process is no behaviour of the robots."""

import signal
import time

from testbed.polling import until

PAUSE = 11.0  # seconds: longer than stale_after and confirm_after together


def received_since(site, at: float) -> bool:
    """Whether a message of each robot was received since a Unix time."""
    robots = site.ask("/api/v1/fleet")["robots"]
    return all(robot["last_message"] > at for robot in robots)


def test_robots_that_send_while_the_exporter_stands_still_are_neither_silent_nor_flapping(site):
    exporter = site.serve()
    site.start_robots(3)
    until(lambda: site.up() == 3, exporter.describe, 60)

    for number in range(1, 3):
        exporter.signal(signal.SIGSTOP)
        # What is measured is the time itself: nothing tells when a stopped process has been so.
        time.sleep(PAUSE)
        exporter.signal(signal.SIGCONT)
        until(lambda n=number: exporter.output().count("stood still") == n, exporter.describe, 30)
        at = site.ask("/api/v1/fleet")["time"]
        until(lambda at=at: received_since(site, at), exporter.describe, 30)

    found = [each for each in site.ask("/api/v1/events")["events"] if each["kind"] == "robot"]
    assert "silent" not in {each["after"] for each in found}
    assert site.ask("/api/v1/faults")["faults"] == []
