"""Two Prometheus and two Alertmanagers on one fleet, of which one each is killed; no mail server.

Both Prometheus scrape the exporter and send alerts to both Alertmanagers: no mail is lost, and none
is sent twice but of faults during which the mail server was down, when both Alertmanagers retry.
"""

from __future__ import annotations

import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from support.alertmanager_cluster import PEER_TIMEOUT, clustered, sees_two
from support.mailbox import settled
from testbed import http
from testbed.mail import Inbox
from testbed.polling import until
from testbed.processes import Process
from testbed.programs import alertmanager, prometheus
from testbed.stack import Plan, Stack, running

PROBLEM = "** PROBLEM ** demo/robot_{} Motor 2 is CRITICAL"
RECOVERY = "** RECOVERY ** demo/robot_{} Motor 2 is no longer CRITICAL"


class Pairs:
    """The stack with two of each server, by name and number."""

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
        """Start the second, and restart the first with the second as its peer."""
        config = self.folder / "alertmanager" / "alertmanager.yml"
        first = self.stack.alertmanager.process
        first.stop()
        first.argv = verbose(clustered(first.argv, *self.gossip))
        first.start()
        alone = alertmanager(config, self.alertmanagers[1], self.folder / "nflog-1")
        second = start("alertmanager-1", verbose(clustered(alone, *self.gossip[::-1])))
        self.processes["alertmanager", 1] = second
        until(lambda: all(map(sees_two, self.alertmanagers)), "the pair of Alertmanagers", 60)

    def pair_prometheuses(self, start: Callable[..., Process]) -> None:
        """Start the second; give both all Alertmanagers, and each its replica label."""
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
        until(self._all_send_to_all, "both Prometheus, with the states of all robots", 90)

    def _all_send_to_all(self) -> bool:
        try:
            return all(
                len(http.query(each, "robot:ros_diagnostics_state:rank == 0")) == 3
                and len(self._alertmanagers_of(each)) == 2
                for each in self.prometheuses
            )
        except http.Unanswered:
            return False

    def _alertmanagers_of(self, address: str) -> list[Any]:
        found = http.get_json(address, "/api/v1/alertmanagers")
        return list(found["data"]["activeAlertmanagers"])

    def have_given_up(self, robot: str) -> bool:
        """Whether the robot's alert has ended, and no Alertmanager tries to send it any more.

        An attempt that began while it fired sends that for ten seconds yet. Those of one alert come
        one after the other, so none does once one has begun with the end.
        """
        firing = FIRING.format(robot)
        return not any(http.query(each, firing) for each in self.prometheuses) and all(
            self._last_attempt(number, robot).endswith("[resolved]]") for number in range(2)
        )

    def _last_attempt(self, alertmanager: int, robot: str) -> str:
        """What it last tried to send of the robot's alerts, as it logs it."""
        log = self.processes["alertmanager", alertmanager].output()
        found = [
            line.rstrip('"')
            for line in log.splitlines()
            if "msg=flushing" in line and f'robot=\\"{robot}\\"' in line
        ]
        return found[-1] if found else ""

    def subjects(self) -> list[str]:
        """The mails about robots; after a minute there is one about the killed Alertmanager too."""
        mails = self.stack.inbox.mails()
        return [mail.subject for mail in mails if " demo/robot_" in mail.subject]

    def settled(self, number: int) -> list[str]:
        """All subjects, once so many mails arrived and each server had time for one too many."""
        # An evaluation of the other Prometheus, group_interval, and the other's peer timeout.
        pause = 5 + 5 + 2 * PEER_TIMEOUT + 1
        return settled(self.subjects, number, within=90, pause=pause)


def verbose(argv: list[str]) -> list[str]:
    """The command line of an Alertmanager that logs what each attempt sends."""
    return [part.replace("--log.level=warn", "--log.level=debug") for part in argv]


@pytest.fixture
def pairs(
    tmp_path: Path, free_port: Callable[[], int], start_process: Callable[..., Process]
) -> Iterator[Pairs]:
    with running(tmp_path, Plan(robots=3), Inbox()) as stack:
        pairs = Pairs(stack, tmp_path, free_port)
        pairs.pair_alertmanagers(start_process)
        pairs.pair_prometheuses(start_process)
        yield pairs


@pytest.mark.slow
@pytest.mark.parametrize(
    "killed", [("prometheus 0", "alertmanager 0"), ("prometheus 1", "alertmanager 0")]
)
def test_with_one_half_of_each_killed_every_mail_is_sent_once(
    pairs: Pairs, killed: tuple[str, str]
):
    pairs.stack.fault("robot_2", "Motor 2", "error", "winding at 131 C")
    expected = [PROBLEM.format(2)]
    assert pairs.settled(1) == expected

    for name, _, number in (each.partition(" ") for each in killed):
        pairs.processes[name, int(number)].kill()
    pairs.stack.fault("robot_2", "Motor 2", "ok")
    expected += [RECOVERY.format(2)]
    assert pairs.settled(2) == expected

    pairs.stack.fault("robot_3", "Motor 2", "error")
    expected += [PROBLEM.format(3)]
    assert pairs.settled(3) == expected
    pairs.stack.fault("robot_3", "Motor 2", "ok")
    assert pairs.settled(4) == [*expected, RECOVERY.format(3)]


FIRING = 'ALERTS{{scope="component", robot="{}", alertstate="firing"}}'
FAILED = 'alertmanager_notifications_failed_total{integration="email"} > 0'


@pytest.mark.slow
def test_after_the_mail_server_was_down_nothing_is_lost_and_nothing_comes_more_than_twice(
    pairs: Pairs,
):
    stack = pairs.stack
    stack.fault("robot_2", "Motor 2", "error", "winding at 131 C")
    before = [PROBLEM.format(2)]
    assert pairs.settled(1) == before

    stack.mail_server.stop()
    stack.fault("robot_2", "Motor 2", "ok")
    stack.fault("robot_3", "Motor 2", "error")
    until(lambda: len(stack.query(FAILED)) == 2, "both Alertmanagers fail to send", 120)
    stack.fault("robot_1", "Motor 2", "error")
    until(lambda: stack.query(FIRING.format("robot_1")), "the alert of robot_1", 60)
    stack.fault("robot_1", "Motor 2", "ok")
    until(lambda: pairs.have_given_up("robot_1"), "nobody tries to send its alert", 120)

    stack.mail_server.start()
    afterwards = {RECOVERY.format(2), PROBLEM.format(3)}
    until(lambda: afterwards <= set(pairs.subjects()), lambda: f"{pairs.subjects()}", 120)
    found = Counter(pairs.settled(3)[1:])
    # Nobody was notified of robot_1: nobody needs its recovery.
    assert set(found) == afterwards
    assert max(found.values()) <= 2, found
    print(f"mails after the outage: {dict(found)}")

    stack.fault("robot_3", "Motor 2", "ok")
    number = len(pairs.subjects())
    recovery = RECOVERY.format(3)
    # Since the outage both no longer send at the same moments, so that an attempt of the second may
    # have begun before the end and send after the first has sent the recovery.
    once, again = [recovery], [recovery, PROBLEM.format(3), recovery]
    assert pairs.settled(number + 1)[number:] in (once, again)
