"""A pair of exporters that is killed, loses its state or its DDS; a suspended Prometheus.

With the shipped rules and their clocks: no mail about a robot is lost, none is sent twice.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from e2e.rule_scenarios.stack import Orders
from support.mailbox import settled
from testbed import http, programs
from testbed.mail import Inbox
from testbed.polling import until
from testbed.processes import Process
from testbed.stack import Plan, Stack, running

pytestmark = [pytest.mark.slow, pytest.mark.timeout(600)]

PROBLEM = "** PROBLEM ** demo/robot_{} Motor 2 is CRITICAL"
RECOVERY = "** RECOVERY ** demo/robot_{} Motor 2 is no longer CRITICAL"
# Scrapes, evaluations, group_interval: by then a mail too many has been sent.
SETTLES = 12.0


class Site:
    """The stack; what was mailed about robots."""

    def __init__(self, stack: Stack) -> None:
        self.stack = stack

    def subjects(self) -> list[str]:
        """The mails about robots, not those about exporters."""
        return [m.subject for m in self.stack.inbox.mails() if " demo/robot_" in m.subject]

    def mailed(self, expected: list[str], within: float = 90) -> None:
        """Wait until so many were sent, and for one too many: exactly these."""
        assert settled(self.subjects, len(expected), within=within, pause=SETTLES) == expected

    def holds(self, promql: str) -> None:
        """Wait until Prometheus returns something."""
        until(lambda: self.stack.query(promql), promql, 120)


class Pair(Site):
    """Two exporters that serve the same fleet, each with a state of its own."""

    def __init__(self, stack: Stack, folder: Path, second: Process, address: str) -> None:
        super().__init__(stack)
        self.folder = folder
        self.halves = (stack.exporter.process, second)
        self.addresses = (stack.addresses.exporter, address)

    def settled(self) -> None:
        """Wait until Prometheus has both as settled, since their last start."""
        until(lambda: all(http.answers(a, "/-/ready") for a in self.addresses), "both answer", 60)
        served = b'ros_diagnostics_exporter_settled{fleet="demo"} 1'
        until(
            lambda: all(served in http.get(a, "/metrics") for a in self.addresses),
            "both are settled",
            120,
        )
        self.holds("count(ros_diagnostics_exporter_settled == 1) == 2")


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with running(tmp_path, Plan(robots=3), Inbox()) as stack:
        yield Site(stack)


@pytest.fixture
def pair(
    site: Site,
    tmp_path: Path,
    free_port: Callable[[], int],
    start_process: Callable[..., Process],
) -> Pair:
    stack = site.stack
    address = f"127.0.0.1:{free_port()}"
    (tmp_path / "second").mkdir()
    config = tmp_path / "second" / "fleet.yml"
    config.write_text((tmp_path / "fleet.yml").read_text())
    argv = programs.exporter(
        config, address, tmp_path / "second" / "state", stack.addresses.alertmanager
    )
    pair = Pair(stack, tmp_path, start_process("second", argv, stack.environment), address)
    targets = tmp_path / "prometheus" / "targets" / "ros-diagnostics.yml"
    targets.write_text(yaml.safe_dump([{"targets": list(pair.addresses)}]))
    pair.settled()
    return pair


def test_killed_restarted_without_its_state_and_deaf(pair: Pair):
    stack = pair.stack
    first, second = pair.halves
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
    for half in pair.halves:
        half.start()
    expected += [RECOVERY.format(2)]
    pair.mailed(expected)
    pair.settled()
    pair.mailed(expected)

    second.stop()
    (pair.folder / "second" / "state").unlink()
    second.start()
    pair.settled()
    pair.mailed(expected)

    second.stop()  # it comes back on a network where it receives no robot
    second.env = stack.environment | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}
    second.start()
    pair.settled()
    pair.holds("count(ros_diagnostics_robot_up == 0) == 3")
    pair.mailed(expected)
    stack.fault("robot_3", "Motor 2", "ok")
    expected += [RECOVERY.format(3)]
    pair.mailed(expected)


SILENT = "** PROBLEM ** demo/robot_2 is SILENT"
BACK = "** RECOVERY ** demo/robot_2 is no longer SILENT"


def test_a_lost_database_and_a_restart_of_prometheus(site: Site, tmp_path: Path):
    """A robot is off when the database is lost; another is repaired while Prometheus is down."""
    stack = site.stack
    orders = Orders(stack.domain_id)
    try:
        orders.give([("robot_2", "hang")])
        expected = [SILENT]
        site.mailed(expected)

        exporter, address = stack.exporter.process, stack.addresses.exporter
        exporter.stop()
        for path in tmp_path.glob("exporter.db*"):
            path.unlink()
        exporter.start()
        until(lambda: http.answers(address, "/-/ready"), "the exporter answers", 60)
        served = b'ros_diagnostics_exporter_settled{fleet="demo"} 1'
        until(lambda: served in http.get(address, "/metrics"), "the exporter has settled", 120)
        site.mailed(expected)
        faults = http.get_json(address, "/api/v1/faults")["faults"]
        assert [each["robot"] for each in faults] == ["robot_2"]

        stack.fault("robot_3", "Motor 2", "error")
        expected += [PROBLEM.format(3)]
        site.mailed(expected)
        stack.prometheus.process.stop()
        stack.fault("robot_3", "Motor 2", "ok")
        ended = b"ros_diagnostics_fault_end_timestamp_seconds{"
        until(lambda: ended in http.get(address, "/metrics"), "the end is served", 60)
        stack.prometheus.process.start()
        expected += [RECOVERY.format(3)]
        # Before the look-back of five minutes; what is sent before Prometheus has found
        # Alertmanager is lost, and sent again after a minute.
        site.mailed(expected, within=200)

        orders.give([("robot_2", "resume")])
        expected += [BACK]
        site.mailed(expected)
    finally:
        orders.close()


def test_prometheus_is_suspended_in_a_fault(site: Site):
    """Less than the four minutes after which Alertmanager resolves what it no longer receives."""
    stack = site.stack
    stack.fault("robot_2", "Motor 2", "error", "winding at 131 C")
    expected = [PROBLEM.format(2)]
    site.mailed(expected)

    stack.prometheus.process.signal(signal.SIGSTOP)
    stack.fault("robot_3", "Motor 2", "error")
    suspended = time.monotonic() + 45
    until(lambda: time.monotonic() >= suspended, "a suspension that misses many evaluations", 60)
    assert site.subjects() == expected
    stack.prometheus.process.signal(signal.SIGCONT)
    expected += [PROBLEM.format(3)]
    site.mailed(expected)

    stack.fault("robot_2", "Motor 2", "ok")
    expected += [RECOVERY.format(2)]
    site.mailed(expected)
