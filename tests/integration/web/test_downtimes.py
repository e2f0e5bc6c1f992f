"""A real exporter, and an Alertmanager that has a downtime and then does not answer."""

import json
from contextlib import suppress
from datetime import datetime, timedelta, timezone

from ros_diagnostics_exporter.silences import downtime_matchers, silence
from support.loopback import replying
from testbed.polling import until

FLEET = "fleet: hall\nrobots: [{{name: r1, domain_id: {domain}, namespace: /r1}}]\n"


def planned() -> bytes:
    """A downtime of r1 that began an hour ago, as Alertmanager lists it."""
    now = datetime.now(timezone.utc)
    hour = timedelta(hours=1)
    matchers = downtime_matchers("hall", "r1", "")
    made = silence(matchers, now - hour, now + hour, "ann", "new battery")
    return json.dumps([{**made, "id": "0", "status": {"state": "active"}}]).encode()


def in_maintenance(site) -> bool | None:
    """Whether r1 is in a downtime; None while the exporter does not answer."""
    with suppress(OSError):
        [robot] = site.ask("/api/v1/fleet")["robots"]
        return bool(robot["maintenance"] and robot["downtimes"])
    return None


def test_a_downtime_outlives_a_restart_while_alertmanager_does_not_answer(site):
    site.fleet_file.write_text(FLEET.format(domain=site.domain_id))
    listed = planned()
    with replying(lambda _request: listed) as address:
        url = f"http://{address}"
        exporter = site.serve("--alertmanager.url", url)
        until(lambda: in_maintenance(site), exporter.describe)
    assert exporter.stop() == 0

    exporter = site.serve("--alertmanager.url", url)
    until(lambda: in_maintenance(site) is not None, exporter.describe)
    until(lambda: "Alertmanager does not answer" in exporter.describe(), exporter.describe)
    assert in_maintenance(site)
