"""A pair of exporters that is killed, loses its state or its DDS; a Prometheus that restarts.

With the shipped rules and their clocks: no mail about a robot is lost, none is sent twice.
"""

import pytest
import yaml

from support.mailbox import settled
from support.orders import Orders
from testbed import http
from testbed.polling import until
from testbed.site import Site

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

PROBLEM = "** PROBLEM ** demo/robot_{} Motor 2 is CRITICAL"
RECOVERY = "** RECOVERY ** demo/robot_{} Motor 2 is no longer CRITICAL"
# Scrapes, evaluations, group_interval: by then a mail too many has been sent.
SETTLES = 12.0


class Watched:
    """The stack; what was mailed about robots."""

    def __init__(self, stack: Site) -> None:
        self.stack = stack

    def subjects(self) -> list[str]:
        """The mails about robots, not those about exporters."""
        return [each for each in self.stack.inbox.subjects() if " demo/robot_" in each]

    def mailed(self, expected: list[str], within: float = 90) -> None:
        """Wait until so many were sent, and for one too many: exactly these."""
        assert settled(self.subjects, len(expected), within=within, pause=SETTLES) == expected

    def holds(self, promql: str) -> None:
        """Wait until Prometheus returns something."""
        until(lambda: self.stack.query(promql), promql, 120)

    def settled(self) -> None:
        """Wait until every exporter has settled, since its last start, and Prometheus has it."""
        exporters = self.stack.exporters
        self.stack.wait_until_ready()
        served = b'ros_diagnostics_exporter_settled{fleet="demo"} 1'
        until(
            lambda: all(served in http.get(each.address, "/metrics") for each in exporters),
            "all have settled",
            120,
        )
        self.holds(f"count(ros_diagnostics_exporter_settled == 1) == {len(exporters)}")


@pytest.fixture
def watched(stack: Site) -> Watched:
    return Watched(stack)


@pytest.fixture
def pair(watched: Watched) -> Watched:
    """Two exporters that serve the same fleet, each with a state of its own."""
    stack = watched.stack
    stack.start_exporter(stack.exporter.config, name="second")
    targets = stack.folder / "prometheus" / "targets" / "ros-diagnostics.yml"
    targets.write_text(yaml.safe_dump([{"targets": [each.address for each in stack.exporters]}]))
    watched.settled()
    return watched


def test_killed_restarted_without_its_state_and_deaf(pair: Watched):
    stack = pair.stack
    first, second = (each.process for each in stack.exporters)
    stack.fault("robot_2", "Motor 2", "error", "winding at 131 C")
    expected = [PROBLEM.format(2)]
    pair.mailed(expected)

    second.kill()
    stack.fault("robot_3", "Motor 2", "error")
    expected += [PROBLEM.format(3)]
    pair.mailed(expected)

    first.kill()
    pair.holds('count(up{job="ros-diagnostics"} == 0) == 2')
    stack.fault("robot_2", "Motor 2", "ok")  # while neither is there to see it
    pair.mailed(expected)
    for half in (first, second):
        half.start()
    expected += [RECOVERY.format(2)]
    pair.mailed(expected)
    pair.settled()
    pair.mailed(expected)

    second.stop()
    stack.exporters[1].database.unlink()
    second.start()
    pair.settled()
    pair.mailed(expected)

    second.stop()  # it comes back on a network where it receives no robot
    second.env = stack.environment() | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}
    second.start()
    pair.settled()
    pair.holds("count(ros_diagnostics_robot_up == 0) == 3")
    pair.mailed(expected)
    stack.fault("robot_3", "Motor 2", "ok")
    expected += [RECOVERY.format(3)]
    pair.mailed(expected)


SILENT = "** PROBLEM ** demo/robot_2 is SILENT"
BACK = "** RECOVERY ** demo/robot_2 is no longer SILENT"


def test_a_lost_database_and_a_restart_of_prometheus(watched: Watched):
    """A robot is off when the database is lost; another is repaired while Prometheus is down."""
    stack = watched.stack
    with Orders(stack.domain_id) as orders:
        orders.give([("robot_2", "hang")])
        expected = [SILENT]
        watched.mailed(expected)

        exporter, address = stack.exporter.process, stack.exporter.address
        exporter.stop()
        for path in stack.folder.glob(f"{stack.exporter.database.name}*"):
            path.unlink()
        exporter.start()
        watched.settled()
        watched.mailed(expected)
        faults = http.get_json(address, "/api/v1/faults")["faults"]
        assert [each["robot"] for each in faults] == ["robot_2"]

        stack.fault("robot_3", "Motor 2", "error")
        expected += [PROBLEM.format(3)]
        watched.mailed(expected)
        stack.prometheus.process.stop()
        stack.fault("robot_3", "Motor 2", "ok")
        ended = b"ros_diagnostics_fault_end_timestamp_seconds{"
        until(lambda: ended in http.get(address, "/metrics"), "the end is served", 60)
        stack.prometheus.process.start()
        expected += [RECOVERY.format(3)]
        # Before the look-back of five minutes; what is sent before Prometheus has found
        # Alertmanager is lost, and sent again after a minute.
        watched.mailed(expected, within=200)

        orders.give([("robot_2", "resume")])
        expected += [BACK]
        watched.mailed(expected)
