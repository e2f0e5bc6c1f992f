"""``ros-diagnostics-ack``: acknowledge an alert, so that it does not escalate any further.

An acknowledgement is a silence in Alertmanager for the escalation and the reminders, never for the
alert itself: when it resolves, a notification is sent as usual. The silence matches the time at
which the fault began, so it ends with the fault; a later fault of the same component, or one that
gets worse, escalates again.
"""

# It knows the labels that prometheus/rules/escalation.yml sets, and nothing of ROS.

from __future__ import annotations

import argparse
import getpass
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from datetime import datetime, timedelta, timezone
from typing import Any
from urllib.parse import urlencode

from rich.console import Console
from rich.table import Table
from rich.text import Text

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.alertmanager import ESCALATION, IDENTITY
from ros_diagnostics_exporter.cli.connection_flags import add_arguments, make_client
from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.texts import one_line, printable

DEFAULT_URL = "http://127.0.0.1:9093"
MOST_DAYS = 3650
# The alerts that can be acknowledged -> the state to show.
STATES = {
    "RosDiagnosticsComponentCritical": "CRITICAL",
    "RosDiagnosticsComponentWarning": "WARNING",
    "RosDiagnosticsComponentStale": "STALE",
    "RosDiagnosticsRobotSilent": "SILENT",
    "RosDiagnosticsManyComponents": "CRITICAL IN MANY COMPONENTS",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Acknowledge or list; exit code 0, or 1 without an alert to acknowledge or a response."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if not options.list and not (options.robot and options.comment):
        parser.error("give a ROBOT and a --comment, or --list")
    if not options.list and not options.author:
        parser.error("give your name with --author: this user has no entry in passwd")
    try:
        client = make_client(options)
        return _list(client, options) if options.list else _acknowledge(client, options)
    except UnreachableError as error:
        print(f"ros-diagnostics-ack: {printable(str(error))}", file=sys.stderr)  # noqa: T201
        return 1


def faults(
    alerts: Iterable[dict[str, Any]], robot: str | None = None, component: str | None = None
) -> list[dict[str, Any]]:
    """The alerts that can be acknowledged, of a robot or a component if one is given."""
    return [
        alert
        for alert in alerts
        if alert["labels"].get("alertname") in STATES
        and robot in (None, alert["labels"].get("robot"))
        and component in (None, alert["labels"].get("component"))
    ]


def silence(
    alert: dict[str, Any], author: str, comment: str, start: datetime, days: float
) -> dict[str, Any]:
    """The silence that acknowledges ``alert``, as Alertmanager's API takes it."""
    wanted = {"alertname": ESCALATION, "since": alert["annotations"]["since"]}
    wanted |= {name: alert["labels"][name] for name in IDENTITY if name in alert["labels"]}
    if "component" not in alert["labels"]:
        wanted["of"] = "robot"  # without this it would match the robot's components as well
    return {
        "matchers": [
            {"name": name, "value": value, "isRegex": False, "isEqual": True}
            for name, value in wanted.items()
        ],
        "startsAt": start.isoformat(),
        "endsAt": (start + timedelta(days=days)).isoformat(),
        "createdBy": author,
        "comment": comment,
    }


def acknowledged(
    alert: dict[str, Any], silences: Iterable[dict[str, Any]]
) -> dict[str, Any] | None:
    """The active silence that acknowledges ``alert``; None without one."""
    wanted = silence(alert, "", "", datetime.now(timezone.utc), 0)["matchers"]
    identity = {(each["name"], each["value"]) for each in wanted}
    for each in silences:
        if each["status"]["state"] != "active":
            continue
        if {(m["name"], m["value"]) for m in each["matchers"]} == identity:
            return each
    return None


def _acknowledge(client: Client, options: argparse.Namespace) -> int:
    found = faults(_alerts(client, options.fleet), options.robot, options.component)
    if not found:
        named = " ".join(filter(None, (options.robot, options.component)))
        others = sorted({_name(alert) for alert in faults(_alerts(client, options.fleet))})
        known = f"; there are alerts for {', '.join(others)}" if others else "; no alert is firing"
        raise UnreachableError(f"no alert is firing for {named!r}{known}")
    start = datetime.now(timezone.utc)
    silences = client.get("/api/v2/silences")
    for alert in found:
        if (before := acknowledged(alert, silences)) is not None:
            author = one_line(before["createdBy"])
            print(f"{_name(alert)} is already acknowledged by {author}")  # noqa: T201
            continue
        body = silence(alert, options.author, options.comment, start, options.days)
        client.post("/api/v2/silences", body)
        state = STATES[alert["labels"]["alertname"]]
        since = one_line(alert["annotations"]["since"])
        print(f"acknowledged: {_name(alert)} {state} since {since}")  # noqa: T201
    return 0


def _list(client: Client, options: argparse.Namespace) -> int:
    """Print the firing alerts and who has acknowledged each."""
    silences = client.get("/api/v2/silences")
    table = Table("Robot", "Component", "State", "Since", "Acknowledged by", "Comment", box=None)
    for alert in sorted(faults(_alerts(client, options.fleet)), key=_name):
        labels = alert["labels"]
        known = acknowledged(alert, silences) or {"createdBy": "nobody", "comment": ""}
        state = STATES[labels["alertname"]]
        since = alert["annotations"]["since"]
        cells = (labels["robot"], labels.get("component", ""), state, since)
        texts = (*cells, known["createdBy"], known["comment"])
        table.add_row(*(Text(one_line(text)) for text in texts))  # as Text: no markup
    # In a pipe nothing is cut off; in a terminal the columns share its width.
    Console(width=None if sys.stdout.isatty() else 200).print(table)
    return 0


def _alerts(client: Client, fleet: str | None) -> list[dict[str, Any]]:
    query = [("filter", f'fleet="{fleet}"')] if fleet else []
    alerts = client.get("/api/v2/alerts" + (f"?{urlencode(query)}" if query else ""))
    if not isinstance(alerts, list):
        raise UnreachableError(f"{client.url} is not an Alertmanager")
    return alerts


def _name(alert: dict[str, Any]) -> str:
    labels = alert["labels"]
    parts = (f"{labels['fleet']}/{labels['robot']}", labels.get("component"))
    return one_line(" ".join(filter(None, parts)))


def _days(text: str) -> float:
    with suppress(ValueError):
        if 0 < (days := float(text)) <= MOST_DAYS:
            return days
    raise argparse.ArgumentTypeError(f"{text!r} is not a number of days, at most {MOST_DAYS}")


def _user() -> str | None:
    """The user's name; None for a UID without an entry in passwd, as in many containers."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # OSError since Python 3.13
        return None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="ros-diagnostics-ack", description=__doc__)
    parser.add_argument("robot", nargs="?", metavar="ROBOT", help="acknowledge this robot's alerts")
    parser.add_argument("component", nargs="?", metavar="COMPONENT", help="only this component's")
    parser.add_argument("--comment", help="what is being done about it")
    parser.add_argument(
        "--list", action="store_true", help="list the firing alerts and who has acknowledged each"
    )
    parser.add_argument("--fleet", help="only this fleet, if several have a robot of that name")
    parser.add_argument(
        "--author",
        default=_user(),
        help="who acknowledges (default: the current user, %(default)s)",
    )
    parser.add_argument(
        "--days",
        type=_days,
        default=30.0,
        metavar="DAYS",
        help="the longest it may last; it ends with the fault in any case (default: %(default)g)",
    )
    add_arguments(parser, "Alertmanager", DEFAULT_URL)
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    return parser
