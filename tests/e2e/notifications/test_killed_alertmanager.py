"""An Alertmanager that is killed remembers what it wrote of its notifications, and no more."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from support.alerts import post_alerts
from testbed import servers
from testbed.configuration import CHECKOUT
from testbed.mail import Inbox, MailServer
from testbed.polling import until
from testbed.ports import free_port


def fault(component: str) -> dict[str, Any]:
    names = {"fleet": "f", "robot": "r1", "component": component, "scope": "component"}
    labels = {**names, "state": "critical", "severity": "critical"}
    name = {"alertname": "RosDiagnosticsComponentCritical"}
    return {"labels": name | labels, "annotations": {}, "startsAt": "2025-12-31T23:00:00Z"}


@pytest.fixture
def inbox() -> Inbox:
    return Inbox()


@pytest.fixture
def start(tmp_path: Path, inbox: Inbox) -> Iterator[Callable[[str], servers.Server]]:
    """A function: starts an Alertmanager that writes after this interval."""
    mail_server = MailServer(f"127.0.0.1:{free_port()}", inbox)
    mail_server.start()
    started: list[servers.Server] = []

    def start(interval: str) -> servers.Server:
        shutil.copytree(CHECKOUT / "alertmanager", tmp_path / "alertmanager")
        config = tmp_path / "alertmanager" / "alertmanager.yml"
        content = yaml.safe_load(config.read_text())
        content["global"]["smtp_smarthost"] = mail_server.address
        content["route"]["group_interval"] = "1s"
        config.write_text(yaml.safe_dump(content))
        option = f"--data.maintenance-interval={interval}"
        server = servers.alertmanager(tmp_path, config, f"127.0.0.1:{free_port()}", option)
        started.append(server)
        server.process.start()
        server.wait_until_ready()
        return server

    yield start
    for server in started:
        server.process.stop()
    mail_server.stop()


@pytest.mark.parametrize(("interval", "recoveries"), [("15m", 0), ("1s", 1)])
def test_a_recovery_after_a_kill_is_sent_where_the_problem_was_written(
    start, inbox, tmp_path, interval, recoveries
):
    def subjects() -> list[str]:
        return [mail.subject for mail in inbox.mails()]

    server = start(interval)
    post_alerts(server.address, fault("Arm"))
    until(lambda: len(subjects()) == 1, "the problem", 60)
    written = tmp_path / "nflog" / "nflog"
    if recoveries:
        until(lambda: written.exists() and b"email" in written.read_bytes(), "the snapshot", 60)
    server.process.kill()
    server.process.start()
    server.wait_until_ready()
    post_alerts(server.address, fault("Arm"), resolved=True)
    if recoveries:
        until(lambda: len(subjects()) == 2, "the recovery", 60)
    post_alerts(server.address, fault("Wheel"))
    until(lambda: "** PROBLEM ** f/r1 Wheel is CRITICAL" in subjects(), "a later problem", 60)

    recovery = "** RECOVERY ** f/r1 Arm is no longer CRITICAL"
    assert subjects().count(recovery) == recoveries
    assert len(subjects()) == 2 + recoveries
