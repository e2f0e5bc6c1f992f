"""A pair of Prometheus and a pair of Alertmanagers on one real fleet, of which halves are killed.

Robots break, the exporter is scraped twice, both Prometheus tell both Alertmanagers: no mail is
lost and none comes twice.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from support.alertmanager_cluster import PEER_TIMEOUT, clustered, sees_two
from testbed import http as asking
from testbed.mail import Inbox
from testbed.polling import until
from testbed.processes import Process
from testbed.programs import alertmanager, prometheus
from testbed.stack import Plan, Stack, running

PROBLEM = "** PROBLEM ** demo/robot_{} Motor 2 is CRITICAL"
RECOVERY = "** RECOVERY ** demo/robot_{} Motor 2 is no longer CRITICAL"


class Site:
    """The road with two of each server; by name and number."""

    def __init__(self, stack: Stack, folder: Path, free_port: Callable[[], int]) -> None:
        self.stack = stack
        self.folder = folder
        self.alertmanagers = [stack.addresses.alertmanager, f"127.0.0.1:{free_port()}"]
        self.prometheuses = [stack.addresses.prometheus, f"127.0.0.1:{free_port()}"]
        self.gossip = [f"127.0.0.1:{free_port()}" for _ in range(2)]
        self.processes: dict[tuple[str, int], Process] = {
            ("prometheus", 0): stack.prometheus.process,
            ("alertmanager", 0): stack.alertmanager.process,
        }

    def pair_alertmanagers(self, start: Callable[..., Process]) -> None:
        """Start the second, and the first anew so that it knows the second."""
        config = self.folder / "alertmanager" / "alertmanager.yml"
        first = self.stack.alertmanager.process
        first.stop()
        first.argv = clustered(first.argv, *self.gossip)
        first.start()
        alone = alertmanager(config, self.alertmanagers[1], self.folder / "nflog-1")
        second = start("alertmanager-1", clustered(alone, *self.gossip[::-1]))
        self.processes["alertmanager", 1] = second
        until(lambda: all(map(sees_two, self.alertmanagers)), "the pair of Alertmanagers", 60)

    def pair_prometheuses(self, start: Callable[..., Process]) -> None:
        """Start the second; tell both of both Alertmanagers, and each who it is."""
        targets = self.folder / "prometheus" / "targets" / "alertmanager.yml"
        targets.write_text(yaml.safe_dump([{"targets": self.alertmanagers}]))
        shutil.copytree(self.folder / "prometheus", self.folder / "prometheus-1")
        for number, folder in enumerate(["prometheus", "prometheus-1"]):
            path = self.folder / folder / "prometheus.yml"
            content = yaml.safe_load(path.read_text())
            content["global"]["external_labels"] = {"replica": str(number)}
            path.write_text(yaml.safe_dump(content))
        self.stack.prometheus.process.stop()
        self.stack.prometheus.process.start()
        config = self.folder / "prometheus-1" / "prometheus.yml"
        argv = prometheus(config, self.prometheuses[1], self.folder / "tsdb-1")
        self.processes["prometheus", 1] = start("prometheus-1", argv)
        until(self._all_tell_all, "both Prometheus, with the states of all robots", 90)

    def _all_tell_all(self) -> bool:
        try:
            return all(
                len(asking.query(each, "robot:ros_diagnostics_state:rank == 0")) == 3
                and len(self._told_by(each)) == 2
                for each in self.prometheuses
            )
        except asking.Unanswered:
            return False

    def _told_by(self, address: str) -> list[Any]:
        found = asking.get_json(address, "/api/v1/alertmanagers")
        return list(found["data"]["activeAlertmanagers"])

    def told(self) -> list[str]:
        """What was told of robots; that an Alertmanager is down is told too, after a minute."""
        mails = self.stack.inbox.mails()
        return [mail.subject for mail in mails if " demo/robot_" in mail.subject]

    def settled(self, number: int) -> list[str]:
        """All subjects, when so many mails came and every server had its turn for one too many."""
        until(lambda: len(self.told()) >= number, lambda: f"{number} mails: {self.told()}", 90)
        # An evaluation of the other Prometheus, a turn of the group, and the other's waiting.
        then = time.monotonic() + 5 + 5 + 2 * PEER_TIMEOUT + 1
        until(lambda: time.monotonic() >= then, "each server had its turn")
        return self.told()


@pytest.fixture
def site(
    tmp_path: Path, free_port: Callable[[], int], start_process: Callable[..., Process]
) -> Iterator[Site]:
    with running(tmp_path, Plan(robots=3), Inbox()) as stack:
        site = Site(stack, tmp_path, free_port)
        site.pair_alertmanagers(start_process)
        site.pair_prometheuses(start_process)
        yield site


@pytest.mark.slow
@pytest.mark.parametrize(
    "killed", [("prometheus 0", "alertmanager 0"), ("prometheus 1", "alertmanager 0")]
)
def test_with_a_half_of_each_killed_no_mail_is_lost_and_none_doubled(
    site: Site, killed: tuple[str, str]
):
    site.stack.fault("robot_2", "Motor 2", "error", "winding at 131 C")
    told = [PROBLEM.format(2)]
    assert site.settled(1) == told

    for name, _, number in (each.partition(" ") for each in killed):
        site.processes[name, int(number)].kill()
    site.stack.fault("robot_2", "Motor 2", "ok")
    told += [RECOVERY.format(2)]
    assert site.settled(2) == told

    site.stack.fault("robot_3", "Motor 2", "error")
    told += [PROBLEM.format(3)]
    assert site.settled(3) == told
    site.stack.fault("robot_3", "Motor 2", "ok")
    assert site.settled(4) == [*told, RECOVERY.format(3)]
