"""A pair of Alertmanagers of which one is killed: no mail is lost, none comes twice."""

from __future__ import annotations

import json
import shutil
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from fleet_demo import asking
from fleet_demo.mail import Inbox, MailServer
from fleet_demo.processes import Process
from fleet_demo.programs import alertmanager
from fleet_demo.site import CHECKOUT
from fleet_demo.waiting import until

PEER_TIMEOUT = 2  # seconds that the second waits for the first to have mailed
PROBLEM = "** PROBLEM ** f/r1 Motor 1 is CRITICAL"
RECOVERY = "** RECOVERY ** f/r1 Motor 1 is no longer CRITICAL"


class Pair:
    """Two Alertmanagers that know each other, and alerts handed to both as Prometheus does."""

    def __init__(self, inbox: Inbox) -> None:
        self.inbox = inbox
        self.halves: list[tuple[str, Process]] = []

    def tell(self, *, over: bool = False) -> None:
        labels = {"alertname": "RosDiagnosticsComponentCritical", "fleet": "f", "robot": "r1"}
        alert: dict[str, Any] = {"labels": {**labels, "component": "Motor 1"}}
        if over:
            alert["endsAt"] = "2026-01-01T00:00:00Z"
        for address, process in self.halves:
            if process.alive:
                self._post(address, alert)

    def _post(self, address: str, alert: dict[str, Any]) -> None:
        body = json.dumps([alert]).encode()
        header = {"Content-Type": "application/json"}
        request = urllib.request.Request(f"http://{address}/api/v2/alerts", body, header)
        urllib.request.urlopen(request, timeout=10).close()

    def subjects(self) -> list[str]:
        return [mail.subject for mail in self.inbox.mails()]

    def settled(self, number: int) -> list[str]:
        """All subjects, when so many mails have come and each half had time for one too many."""
        until(lambda: len(self.subjects()) >= number, lambda: f"mails: {self.subjects()}", 60)
        then = time.monotonic() + 2 * PEER_TIMEOUT + 2
        until(lambda: time.monotonic() >= then, "each half had its turn")
        return self.subjects()


@pytest.fixture
def pair(
    tmp_path: Path, free_port: Callable[[], int], start_process: Callable[..., Process]
) -> Iterator[Pair]:
    shutil.copytree(CHECKOUT / "alertmanager", tmp_path / "alertmanager")
    config = tmp_path / "alertmanager" / "alertmanager.yml"
    smtp = f"127.0.0.1:{free_port()}"
    content = yaml.safe_load(config.read_text())
    content["global"]["smtp_smarthost"] = smtp
    content["route"]["group_interval"] = "1s"
    config.write_text(yaml.safe_dump(content))
    pair = Pair(Inbox())
    server = MailServer(smtp, pair.inbox)
    server.start()
    gossip = [f"127.0.0.1:{free_port()}" for _ in range(2)]
    for number, (mine, other) in enumerate([gossip, gossip[::-1]]):
        address = f"127.0.0.1:{free_port()}"
        alone = alertmanager(config, address, tmp_path / f"data{number}")
        argv = [part for part in alone if not part.startswith("--cluster.")]
        cluster = [
            f"--cluster.listen-address={mine}",
            f"--cluster.peer={other}",
            f"--cluster.peer-timeout={PEER_TIMEOUT}s",
        ]
        pair.halves.append((address, start_process(f"half{number}", [*argv, *cluster])))
    until(lambda: all(_sees_two(address) for address, _ in pair.halves), "the pair", 60)
    yield pair
    server.stop()


def _sees_two(address: str) -> bool:
    try:
        cluster = asking.get_json(address, "/api/v2/status")["cluster"]
    except asking.Unanswered:
        return False
    return cluster["status"] == "ready" and len(cluster["peers"]) == 2


@pytest.mark.parametrize("killed", [0, 1])
def test_a_killed_half_loses_and_doubles_no_mail(pair: Pair, killed: int):
    pair.tell()
    assert pair.settled(1) == [PROBLEM]

    pair.halves[killed][1].kill()
    pair.tell(over=True)
    assert pair.settled(2) == [PROBLEM, RECOVERY]

    pair.tell()
    assert pair.settled(3) == [PROBLEM, RECOVERY, PROBLEM]
