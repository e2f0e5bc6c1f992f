"""``ros-diagnostics-ack``: say that a fault is being taken care of, and it escalates no further.

An acknowledgement is a silence in Alertmanager of the fault's escalation and reminders, never of
the fault's own alert: its recovery is told all the same. It names since when the fault has been, so
it ends with the fault; the next fault of the same component, and one that got worse, escalate anew.
It knows the labels that prometheus/rules/escalation.yml gives, and nothing of ROS.
"""

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
from ros_diagnostics_exporter.acknowledgement import ESCALATION, IDENTITY
from ros_diagnostics_exporter.http_client import UnreachableError, add_arguments, ask
from ros_diagnostics_exporter.texts import printable, shown

DEFAULT_URL = "http://127.0.0.1:9093"
MOST_DAYS = 3650
# The alerts that are acknowledged, by the word for their state.
STATES = {
    "RosDiagnosticsComponentCritical": "CRITICAL",
    "RosDiagnosticsComponentWarning": "WARNING",
    "RosDiagnosticsComponentStale": "STALE",
    "RosDiagnosticsRobotSilent": "SILENT",
    "RosDiagnosticsManyComponents": "CRITICAL IN MANY COMPONENTS",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Acknowledge or list; 0, or 1 when there is nothing to acknowledge or no answer."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if not options.list and not (options.robot and options.comment):
        parser.error("say which ROBOT and --comment what is being done, or --list")
    if not options.list and not options.author:
        parser.error("say with --author who takes care: the user who runs this has no name here")
    try:
        return _list(options) if options.list else _acknowledge(options)
    except UnreachableError as error:
        print(f"ros-diagnostics-ack: {printable(str(error))}", file=sys.stderr)  # noqa: T201
        return 1


def faults(
    alerts: Iterable[dict[str, Any]], robot: str | None = None, component: str | None = None
) -> list[dict[str, Any]]:
    """The alerts that can be acknowledged, of one robot and one of its components if named."""
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
    """The silence that acknowledges one fault, as Alertmanager's API wants it."""
    wanted = {"alertname": ESCALATION, "since": alert["annotations"]["since"]}
    wanted |= {name: alert["labels"][name] for name in IDENTITY if name in alert["labels"]}
    if "component" not in alert["labels"]:
        wanted["of"] = "robot"  # or it would hold for the robot's components as well
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
    """The acknowledgement of a fault, if it has one that holds."""
    wanted = silence(alert, "", "", datetime.now(timezone.utc), 0)["matchers"]
    identity = {(each["name"], each["value"]) for each in wanted}
    for each in silences:
        if each["status"]["state"] != "active":
            continue
        if {(m["name"], m["value"]) for m in each["matchers"]} == identity:
            return each
    return None


def _acknowledge(options: argparse.Namespace) -> int:
    found = faults(_alerts(options), options.robot, options.component)
    if not found:
        named = " ".join(filter(None, (options.robot, options.component)))
        others = sorted({_name(alert) for alert in faults(_alerts(options))})
        known = (
            f"; there are faults of {', '.join(others)}" if others else "; there are none at all"
        )
        raise UnreachableError(f"no fault of {named!r} is being told{known}")
    start = datetime.now(timezone.utc)
    silences = ask(options, "/api/v2/silences")
    for alert in found:
        if (before := acknowledged(alert, silences)) is not None:
            author = shown(before["createdBy"])
            print(f"{_name(alert)} was acknowledged by {author} already")  # noqa: T201
            continue
        body = silence(alert, options.author, options.comment, start, options.days)
        ask(options, "/api/v2/silences", body)
        state = STATES[alert["labels"]["alertname"]]
        since = shown(alert["annotations"]["since"])
        print(f"acknowledged: {_name(alert)} {state} since {since}")  # noqa: T201
    return 0


def _list(options: argparse.Namespace) -> int:
    """Print the faults that are told, with who takes care of each."""
    silences = ask(options, "/api/v2/silences")
    table = Table("Robot", "Component", "State", "Since", "Acknowledged by", "Comment", box=None)
    for alert in sorted(faults(_alerts(options)), key=_name):
        labels = alert["labels"]
        known = acknowledged(alert, silences) or {"createdBy": "nobody", "comment": ""}
        state = STATES[labels["alertname"]]
        since = alert["annotations"]["since"]
        cells = (labels["robot"], labels.get("component", ""), state, since)
        texts = (*cells, known["createdBy"], known["comment"])
        table.add_row(*(Text(shown(text)) for text in texts))  # as Text: no markup
    # Piped, nothing is cut; in a terminal, columns share its width.
    Console(width=None if sys.stdout.isatty() else 200).print(table)
    return 0


def _alerts(options: argparse.Namespace) -> list[dict[str, Any]]:
    query = [("filter", f'fleet="{options.fleet}"')] if options.fleet else []
    answer = ask(options, "/api/v2/alerts" + (f"?{urlencode(query)}" if query else ""))
    if not isinstance(answer, list):
        raise UnreachableError(f"{options.url} is not an Alertmanager")
    return answer


def _name(alert: dict[str, Any]) -> str:
    labels = alert["labels"]
    parts = (f"{labels['fleet']}/{labels['robot']}", labels.get("component"))
    return shown(" ".join(filter(None, parts)))


def _days(text: str) -> float:
    with suppress(ValueError):
        if 0 < (days := float(text)) <= MOST_DAYS:
            return days
    raise argparse.ArgumentTypeError(f"{text!r} is not a number of days, at most {MOST_DAYS}")


def _user() -> str | None:
    """Who runs this; None for a UID without an entry in passwd, as containers often have."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # OSError since Python 3.13
        return None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="ros-diagnostics-ack", description=__doc__)
    parser.add_argument("robot", nargs="?", metavar="ROBOT", help="whose faults")
    parser.add_argument("component", nargs="?", metavar="COMPONENT", help="only this one's")
    parser.add_argument("--comment", help="what is being done, for the others")
    parser.add_argument(
        "--list", action="store_true", help="the faults, and who takes care of each"
    )
    parser.add_argument("--fleet", help="where several fleets have robots of one name")
    parser.add_argument(
        "--author",
        default=_user(),
        help="who takes care (default: the user who runs this: %(default)s)",
    )
    parser.add_argument(
        "--days",
        type=_days,
        default=30.0,
        metavar="DAYS",
        help="how long it may last; it ends with the fault anyway (default: %(default)g)",
    )
    add_arguments(parser, "Alertmanager", DEFAULT_URL)
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    return parser
