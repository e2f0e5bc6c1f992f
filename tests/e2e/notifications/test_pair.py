"""A pair of Alertmanagers of which one is killed: no mail is lost, none is sent twice."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml

from support.alertmanager_cluster import PEER_TIMEOUT, clustered, sees_two
from support.alerts import post_alerts
from support.mailbox import settled
from testbed.configuration import CHECKOUT
from testbed.mail import Inbox, MailServer
from testbed.polling import until
from testbed.processes import Process
from testbed.programs import alertmanager

PROBLEM = "** PROBLEM ** f/r1 Motor 1 is CRITICAL"
RECOVERY = "** RECOVERY ** f/r1 Motor 1 is no longer CRITICAL"

CONFIG = yaml.safe_load((CHECKOUT / "alertmanager" / "alertmanager.yml").read_text())
SHIPPED = CONFIG["route"]["group_interval"]


class Pair:
    """Two Alertmanagers in a cluster; alerts are sent to both, as Prometheus does."""

    def __init__(self, inbox: Inbox) -> None:
        self.inbox = inbox
        self.halves: list[tuple[str, Process]] = []

    def post(self, *, resolved: bool = False) -> None:
        labels = {"alertname": "RosDiagnosticsComponentCritical", "fleet": "f", "robot": "r1"}
        labels |= {"scope": "component", "state": "critical", "severity": "critical"}
        for address, process in self.halves:
            if process.alive:
                post_alerts(
                    address, {"labels": {**labels, "component": "Motor 1"}}, resolved=resolved
                )

    def subjects(self) -> list[str]:
        return [mail.subject for mail in self.inbox.mails()]

    def settled(self, number: int) -> list[str]:
        """All subjects, once so many mails have arrived and each half had time for one too many."""
        return settled(self.subjects, number, within=60, pause=2 * PEER_TIMEOUT + 2)


@pytest.fixture
def pair(
    request: pytest.FixtureRequest,
    tmp_path: Path,
    free_port: Callable[[], int],
    start_process: Callable[..., Process],
) -> Iterator[Pair]:
    """The pair; its parameter is group_interval, by default shorter than the shipped one."""
    shutil.copytree(CHECKOUT / "alertmanager", tmp_path / "alertmanager")
    config = tmp_path / "alertmanager" / "alertmanager.yml"
    smtp = f"127.0.0.1:{free_port()}"
    content = yaml.safe_load(config.read_text())
    content["global"]["smtp_smarthost"] = smtp
    content["route"]["group_interval"] = getattr(request, "param", "1s")
    for receiver in content["receivers"]:
        receiver.pop("webhook_configs", None)  # no exporter is running
    config.write_text(yaml.safe_dump(content))
    pair = Pair(Inbox())
    server = MailServer(smtp, pair.inbox)
    server.start()
    gossip = [f"127.0.0.1:{free_port()}" for _ in range(2)]
    for number, (mine, other) in enumerate([gossip, gossip[::-1]]):
        address = f"127.0.0.1:{free_port()}"
        alone = alertmanager(config, address, tmp_path / f"data{number}")
        process = start_process(f"half{number}", clustered(alone, mine, other))
        pair.halves.append((address, process))
    until(lambda: all(sees_two(address) for address, _ in pair.halves), "the pair", 60)
    yield pair
    server.stop()


@pytest.mark.parametrize("killed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_with_one_half_killed_every_mail_is_sent_once(pair: Pair, killed: int):
    pair.post()
    assert pair.settled(1) == [PROBLEM]

    pair.halves[killed][1].kill()
    pair.post(resolved=True)
    assert pair.settled(2) == [PROBLEM, RECOVERY]

    pair.post()
    assert pair.settled(3) == [PROBLEM, RECOVERY, PROBLEM]


@pytest.mark.slow
@pytest.mark.parametrize("pair", [SHIPPED], indirect=True)
def test_with_both_running_no_problem_follows_a_recovery(pair: Pair):
    """With a peer timeout longer than group_interval, the second still sends what has ended."""
    pair.post()
    assert pair.settled(1) == [PROBLEM]

    pair.post(resolved=True)
    assert pair.settled(2) == [PROBLEM, RECOVERY]
