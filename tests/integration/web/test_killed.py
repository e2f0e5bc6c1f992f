"""A real exporter that is killed, with a real publisher whose levels change all the time."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

from ros_diagnostics_exporter.model import Status
from support.exposition import samples
from support.ros_publisher import publisher, repeating
from testbed.http import Unanswered
from testbed.polling import until
from testbed.processes import Process

LAMPS = 200
FLEET = """\
fleet: hall
profiles: {{default: {{stale_after: 5s, confirm_after: 500ms}}}}
robots:
  - {{name: r1, domain_id: {domain}, topic: /r1/diagnostics, source: raw, labels: {{site: a}}}}
"""


@contextmanager
def changing(domain_id: int) -> Iterator[None]:
    """A component is in trouble all the time, and ten times a second another one changes.

    Each changes so seldom that all its changes are events.
    """

    def send(turn: int) -> None:
        lamps = (Status(int(each == turn % LAMPS), f"Lamp {each}") for each in range(LAMPS))
        robot.send("/r1/diagnostics", Status(2, "Motor", "Hot"), *lamps)

    with publisher(domain_id) as robot:
        robot.offer("/r1/diagnostics")
        with repeating(send, 0.1):
            yield


def faults(site) -> dict[tuple[tuple[str, str], ...], float]:
    """The faults of the motor: labels -> since when."""
    with suppress(Unanswered):
        found = samples(site.address, "fault_start_timestamp_seconds", component="Motor")
        return {tuple(sorted(each.labels.items())): each.value for each in found}
    return {}


def newest(site) -> dict[str, Any]:
    """The last change of a level that the exporter knows."""
    found = site.ask("/api/v1/events?kind=level&limit=1")["events"]
    return found[0] if found else {"id": 0, "time": 0.0}


def kill_later_than_a_second(site, exporter: Process) -> dict[str, Any]:
    """Kill the exporter when the event that is returned is older than a second."""
    known = newest(site)
    until(lambda: newest(site)["time"] > known["time"] + 1.2, "time passes")
    exporter.kill()
    return known


def test_a_kill_loses_no_fault_and_no_event_older_than_a_second(site):
    site.fleet_file.write_text(FLEET.format(domain=site.domain_id))
    with changing(site.domain_id):
        exporter = site.serve()
        until(lambda: len(faults(site)) == 1, exporter.describe)
        before = faults(site)
        until(lambda: newest(site)["id"] > 0, exporter.describe)
        for _ in range(2):
            event = kill_later_than_a_second(site, exporter)
            exporter = site.serve()
            until(lambda: faults(site), exporter.describe)
            assert faults(site) == before
            found = site.ask(f"/api/v1/events?limit=1&before={event['id'] + 1}")["events"]
            assert found == [event]
            until(lambda last=event: newest(site)["id"] > last["id"], exporter.describe)
        assert exporter.stop() == 0
