"""``ros-diagnostics-ack``: acknowledge an alert, so that it does not escalate any further.

An acknowledgement is a silence in Alertmanager for the escalation and the reminders, never for the
alert itself: when it resolves, a notification is sent as usual. For a fault the silence matches the
time at which it began, so it ends with the fault; a later fault of the same part, or one that gets
worse, escalates again.
"""

# It knows the labels that prometheus/rules/escalation.yml sets, and nothing of ROS.

from __future__ import annotations

import argparse
import getpass
import sys
from collections.abc import Iterable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from typing import Any
from urllib.parse import urlencode

from rich.table import Table

from ros_diagnostics_exporter import __version__, alertmanager
from ros_diagnostics_exporter.alertmanager import ESCALATION, IDENTITY
from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.texts import escape, one_line, printable
from ros_diagnostics_tools.connection_flags import INTERRUPTED, add_arguments, make_client
from ros_diagnostics_tools.terminal import cells, make_console

DEFAULT_URL = "http://127.0.0.1:9093"
MOST_DAYS = 3650.0
# Of a fault's acknowledgement, which ends with the fault: what it outlives escalates at once.
DAYS = 365.0
DAYS_OF_OTHERS = 1.0  # of an alert that does not say since when
PREFIX = "RosDiagnostics"  # of the names of all alerts of the rules


def main(arguments: Sequence[str] | None = None) -> int:
    """Acknowledge or list; exit code 0, or 1 without an alert to acknowledge or a response."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if not options.list:
        if (options.robot, options.site, options.common, options.alert) == (None,) * 4:
            parser.error("give a ROBOT, --site, --common or --alert, and a --comment; or --list")
        if not options.comment:
            parser.error("say with --comment what is being done about it")
        if not options.author:
            parser.error("give your name with --author: this user has no entry in passwd")
    try:
        client = make_client(options)
        return _list(client, options) if options.list else _acknowledge(client, options)
    except UnreachableError as error:
        print(f"ros-diagnostics-ack: {printable(str(error))}", file=sys.stderr)  # noqa: T201
        return 1
    except KeyboardInterrupt:
        return INTERRUPTED


@dataclass(frozen=True)
class Problem:
    """What can be acknowledged: a fault, or what another alert is about.

    ``labels`` are the alert's; ``since`` as it says when the fault began, "" for other alerts.
    """

    labels: dict[str, str]
    since: str

    @property
    def matchers(self) -> dict[str, str]:
        """What its escalation matches, and no other: label -> value."""
        if self.since:
            named = {name: self.labels[name] for name in IDENTITY if name in self.labels}
            return {"alertname": ESCALATION, "since": self.since, **named}
        named = {name: text for name, text in self.labels.items() if name != "step"}
        return {**named, "alertname": ESCALATION, "of": self._alert}

    @property
    def _alert(self) -> str:
        return self.labels.get("of", self.labels["alertname"])

    @property
    def state(self) -> str:
        """The fault's state, or the alert's name."""
        return self.labels["state"].upper() if self.since else self._alert.removeprefix(PREFIX)

    @property
    def part(self) -> str:
        """What has it, as the command's arguments name it."""
        labels = self.labels
        if self.since and labels["scope"] == "site":
            return f"site {labels.get('site', '')}"
        if self.since and labels["scope"] == "common":
            return f"{labels.get('component', '')} on many robots"
        fault = ("robot", "component", "check", "key", "bound")
        names = fault if self.since else ("robot", "uplink", "exporter", "instance", "domain_id")
        return " ".join(labels[name] for name in names if labels.get(name))

    @property
    def name(self) -> str:
        """Fleet and part, safe to print."""
        return one_line(f"{self.labels.get('fleet', '')}/{self.part}")

    def is_wanted(self, options: argparse.Namespace) -> bool:
        """Whether the command's arguments name it."""
        labels = self.labels
        if options.site is not None:
            return (labels.get("scope"), labels.get("site", "")) == ("site", options.site)
        if options.common is not None:
            return (labels.get("scope"), labels.get("component")) == ("common", options.common)
        if options.alert is not None:
            return not self.since and self.state == options.alert.removeprefix(PREFIX)
        parts = (None, labels.get("component"), labels.get("check"))
        return labels.get("robot") == options.robot and options.component in parts


def problems(alerts: Iterable[dict[str, Any]]) -> list[Problem]:
    """What can be acknowledged, each once however many alerts there are for it, by name.

    A fault is what its own alert says; of other alerts their escalation counts as well, which may
    be for rules of the site. Alerts of severity info ask for nothing.
    """
    found: dict[frozenset[tuple[str, str]], Problem] = {}
    for alert in alerts:
        labels = alert["labels"]
        is_fault = {"scope", "state"} <= labels.keys()
        problem = Problem(labels, alert["annotations"].get("since", "") if is_fault else "")
        others = labels.get("alertname", "").startswith(PREFIX) and not is_fault
        if problem.since or (others and labels.get("severity") != "info"):
            found.setdefault(frozenset(problem.matchers.items()), problem)
    return sorted(found.values(), key=lambda each: (each.name, each.state))


def silence(
    problem: Problem, author: str, comment: str, start: datetime, days: float | None = None
) -> dict[str, Any]:
    """The silence that acknowledges ``problem``, as Alertmanager's API takes it."""
    end = start + timedelta(days=days or (DAYS if problem.since else DAYS_OF_OTHERS))
    return alertmanager.silence(problem.matchers, start, end, author, comment)


def acknowledged(problem: Problem, silences: Iterable[dict[str, Any]]) -> dict[str, Any] | None:
    """The active silence that acknowledges ``problem``; None without one."""
    wanted = {(name, value, False, True) for name, value in problem.matchers.items()}
    for each in silences:
        if each["status"]["state"] != "active":
            continue
        matchers = each["matchers"]
        if wanted == {
            (m["name"], m["value"], m["isRegex"], m.get("isEqual", True)) for m in matchers
        }:
            return each
    return None


def _acknowledge(client: Client, options: argparse.Namespace) -> int:
    known = problems(_alerts(client, options.fleet))
    found = [problem for problem in known if problem.is_wanted(options)]
    if not found:
        raise UnreachableError(_not_firing(options, known))
    start = datetime.now(timezone.utc)
    silences = client.get("/api/v2/silences")
    for problem in found:
        if (before := acknowledged(problem, silences)) is not None:
            author = one_line(before["createdBy"])
            print(f"{problem.name} is already acknowledged by {author}")  # noqa: T201
            continue
        body = silence(problem, options.author, options.comment, start, options.days)
        client.post("/api/v2/silences", body)
        when = f"since {problem.since}" if problem.since else f"until {body['endsAt'][:16]} UTC"
        print(one_line(f"acknowledged: {problem.name} {problem.state} {when}"))  # noqa: T201
    return 0


def _not_firing(options: argparse.Namespace, known: Sequence[Problem]) -> str:
    given = (options.robot, options.component, options.site, options.common, options.alert)
    others = ", ".join(dict.fromkeys(f"{each.name} {each.state}" for each in known))
    more = f"there are alerts for {others}" if others else "no alert is firing"
    return f"no alert is firing for {' '.join(filter(None, given))!r}; {more}"


def _list(client: Client, options: argparse.Namespace) -> int:
    """Print what the firing alerts are about, and who has acknowledged each."""
    silences = client.get("/api/v2/silences")
    table = Table("Fleet", "Part", "State", "Since", "Acknowledged by", "Comment", box=None)
    for problem in problems(_alerts(client, options.fleet)):
        known = acknowledged(problem, silences) or {"createdBy": "nobody", "comment": ""}
        about = (problem.labels.get("fleet", ""), problem.part, problem.state, problem.since)
        table.add_row(*cells((*about, known["createdBy"], known["comment"])))
    make_console().print(table)
    return 0


def _alerts(client: Client, fleet: str | None) -> list[dict[str, Any]]:
    query = [("filter", f'fleet="{escape(fleet)}"')] if fleet else []
    alerts = client.get("/api/v2/alerts" + (f"?{urlencode(query)}" if query else ""))
    if not isinstance(alerts, list):
        raise UnreachableError(f"{client.url} is not an Alertmanager")
    return alerts


def _days(text: str) -> float:
    with suppress(ValueError):
        if 0 < (days := float(text)) <= MOST_DAYS:
            return days
    raise argparse.ArgumentTypeError(f"{text!r} is not a number of days, at most {MOST_DAYS:g}")


def current_user() -> str | None:
    """The user's name; None for a UID without an entry in passwd, as in many containers."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # OSError since Python 3.13
        return None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="ros-diagnostics-ack", description=__doc__)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("robot", nargs="?", metavar="ROBOT", help="acknowledge this robot's alerts")
    parser.add_argument(
        "component", nargs="?", metavar="COMPONENT", help="only this component's, or this check's"
    )
    what.add_argument("--site", help="acknowledge that many robots of this site are silent")
    what.add_argument(
        "--common", metavar="COMPONENT", help="acknowledge that it failed on many robots"
    )
    what.add_argument(
        "--alert", metavar="NAME", help="acknowledge alerts about the monitoring: ExporterDown"
    )
    parser.add_argument("--comment", help="what is being done about it")
    parser.add_argument(
        "--list", action="store_true", help="list the firing alerts and who has acknowledged each"
    )
    parser.add_argument("--fleet", help="only this fleet's alerts")
    parser.add_argument(
        "--author",
        default=current_user(),
        help="who acknowledges (default: the current user, %(default)s)",
    )
    parser.add_argument(
        "--days",
        type=_days,
        metavar="DAYS",
        help="the longest it may last; that of a fault ends with the fault in any case (default: "
        f"{DAYS:g}, {DAYS_OF_OTHERS:g} for alerts about the monitoring)",
    )
    add_arguments(parser, "Alertmanager", DEFAULT_URL)
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    return parser
