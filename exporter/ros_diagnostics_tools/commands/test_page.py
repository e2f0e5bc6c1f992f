"""``ros-diagnostics test-page``: does a page reach the people whom a fault of this robot would?"""

from __future__ import annotations

import time
from datetime import datetime, timedelta, timezone
from typing import Any
from urllib.parse import urlencode

import click

from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_tools.errors import NotDoneError
from ros_diagnostics_tools.names import no_robot
from ros_diagnostics_tools.servers import Servers, with_servers
from ros_diagnostics_tools.terminal import print_json, with_output
from ros_diagnostics_tools.times import Duration

ALERT = "RosDiagnosticsTest"
SHOWN = 10.0  # seconds in which Alertmanager shows an alert that it got
PART = "TEST, nothing is wrong"


@click.command(epilog="Example: ros-diagnostics test-page robot_3 --receiver on-call")
@click.argument("robot")
@click.option(
    "--severity",
    type=click.Choice(("critical", "warning")),
    default="critical",
    help="The severity of the alert. Routes may choose a receiver by it.",
)
@click.option("--receiver", metavar="NAME", help="Fail if the routes do not lead to this receiver.")
@click.option(
    "--for",
    "lasts",
    type=Duration(),
    default="2m",
    help="How long it fires. Then its recovery is sent.",
)
@with_output()
@with_servers
def command(
    *,
    servers: Servers,
    output: str,
    robot: str,
    severity: str,
    receiver: str | None,
    lasts: float,
) -> None:
    """Send a test alert for ROBOT through Alertmanager's real routes, to the real receivers.

    The alert has the labels of a fault of the robot, and its subject says that it is a test. The
    command prints the receivers. Ask them whether the notification arrived.
    """
    labels = _labels(servers.exporter, robot, severity)
    now = datetime.now(timezone.utc)
    _send(servers.alertmanager, labels, now, now + timedelta(seconds=lasts))
    found = _find(servers.alertmanager, labels)
    receivers = [each["name"] for each in found["receivers"]]
    if output == "json":
        print_json({"labels": labels, "receivers": receivers, "status": found["status"]})
    else:
        print(f"sent: {ALERT} of {robot} to {', '.join(receivers)}")  # noqa: T201
    if found["status"]["silencedBy"] or found["status"]["inhibitedBy"]:
        raise NotDoneError("the test alert is silenced or inhibited: nobody is notified")
    if receiver not in (None, *receivers):
        raise NotDoneError(f"the routes do not lead to {receiver!r} but to {', '.join(receivers)}")


def _labels(exporter: Client, robot: str, severity: str) -> dict[str, str]:
    known = exporter.fleet((robot,))
    if not known["robots"]:
        raise no_robot(robot, [each["robot"] for each in exporter.fleet()["robots"]])
    return {
        **known["robots"][0]["labels"],
        "alertname": ALERT,
        "fleet": known["fleet"],
        "robot": robot,
        "component": PART,
        "scope": "component",
        "state": severity,
        "severity": severity,
    }


def _send(client: Client, labels: dict[str, str], start: datetime, end: datetime) -> None:
    alert = {
        "labels": labels,
        "annotations": {
            "summary": "TEST: nothing is wrong.",
            "description": "Somebody tests whether notifications arrive (ros-diagnostics "
            "test-page).",
        },
        "startsAt": start.isoformat(),
        "endsAt": end.isoformat(),
    }
    client.post("/api/v2/alerts", [alert])


def _find(client: Client, labels: dict[str, str]) -> dict[str, Any]:
    """The alert as Alertmanager shows it, with its receivers."""
    query = urlencode({"filter": f'alertname="{ALERT}"'})
    deadline = time.monotonic() + SHOWN
    while time.monotonic() < deadline:
        found = client.get(f"/api/v2/alerts?{query}")
        if not isinstance(found, list):
            raise UnreachableError(f"{client.url} is not an Alertmanager")
        for each in found:
            if each["labels"] == labels and each["status"]["state"] != "unprocessed":
                return dict(each)
        time.sleep(0.2)
    raise NotDoneError(f"Alertmanager at {client.url} took the test alert and does not show it")
