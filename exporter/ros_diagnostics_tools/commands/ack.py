"""``ros-diagnostics ack``: acknowledge an alert, so that it does not escalate any further.

The silences are those of `acknowledging`, as a form on the exporter's page makes them too.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime, timezone
from typing import Any, NamedTuple
from urllib.parse import quote, urlencode

import click

from ros_diagnostics_exporter.acknowledging import (
    PREFIX,
    Acknowledgeable,
    acknowledged,
    problems,
    silence,
)
from ros_diagnostics_exporter.http_client import Client
from ros_diagnostics_exporter.silences import Alert, Silence
from ros_diagnostics_exporter.texts import escape, one_line
from ros_diagnostics_tools.errors import NotDoneError
from ros_diagnostics_tools.names import meant
from ros_diagnostics_tools.servers import Servers, listed, with_servers
from ros_diagnostics_tools.terminal import (
    cells,
    check_comment,
    make_console,
    make_table,
    print_json,
    with_author,
    with_output,
)
from ros_diagnostics_tools.times import Duration

COLUMNS = ("Fleet", "Part", "State", "Since", "Acknowledged by", "Comment")


class WantedProblem(NamedTuple):
    """What the arguments name; None where they name no such thing."""

    fleet: str | None
    robot: str | None
    component: str | None
    site: str | None
    common: str | None
    capability: str | None
    part: str | None
    alert: str | None

    def __str__(self) -> str:
        """As it was written."""
        return " ".join(filter(None, self[1:]))


@click.command(
    epilog='Example: ros-diagnostics ack robot_3 "Motor 1" --comment "spare part ordered"'
)
@click.argument("robot", required=False)
@click.argument("component", required=False, metavar="[COMPONENT|CHECK]")
@click.option(
    "--site", help="The fault that many robots of this site are silent; '' if robots have no site."
)
@click.option("--common", metavar="COMPONENT", help="The fault of this component on many robots.")
@click.option("--capability", metavar="NAME", help="The fault of this capability of the fleet.")
@click.option("--part", help="The fault of this part of the exporter, such as database.")
@click.option("--alert", metavar="NAME", help="Alerts about the monitoring, such as ExporterDown.")
@click.option("--fleet", help="Only this fleet's alerts.")
@click.option("--comment", help="What is being done about it.")
@with_author
@click.option(
    "--for",
    "lasts",
    type=Duration(),
    help="The longest it may last; that of a fault ends with the fault in any case.  [default: "
    "365d, 1d for alerts about the monitoring]",
)
@click.option("--list", "lists", is_flag=True, help="List what is firing and who acknowledged it.")
@click.option("--cancel", is_flag=True, help="Take acknowledgements back: it escalates again.")
@with_output()
@with_servers
def command(
    servers: Servers,
    output: str,
    lasts: float | None,
    author: str,
    comment: str | None,
    *,
    lists: bool,
    cancel: bool,
    **named: str | None,
) -> None:
    """Acknowledge the alerts of ROBOT, or of its COMPONENT or CHECK.

    They do not escalate then. A fault's acknowledgement ends with the fault.
    """
    wanted, client = WantedProblem(**named), servers.alertmanager
    if lists:
        _list(client, wanted.fleet, output)
        return
    _check(wanted)
    if cancel:
        done = _cancel(client, wanted)
    else:
        made = check_comment(author, comment, "what is being done about it")
        done = _acknowledge(client, wanted, author, made, lasts)
    if output == "json":
        print_json(done)
    else:
        for each in done:
            print(each["text"])  # noqa: T201


def _check(wanted: WantedProblem) -> None:
    named = [wanted.robot, wanted.site, wanted.common, wanted.capability, wanted.part, wanted.alert]
    names = "--site, --common, --capability, --part"
    if named.count(None) == len(named):
        raise click.UsageError(f"give a ROBOT, {names} or --alert; or --list")
    if named.count(None) < len(named) - 1:
        raise click.UsageError(f"give only one of ROBOT, {names} and --alert")


def is_wanted(problem: Acknowledgeable, wanted: WantedProblem) -> bool:
    """Whether the command's arguments name it."""
    labels = problem.labels
    if wanted.site is not None:
        return labels.get("scope") == "site" and labels.get("site", "") == wanted.site
    if wanted.common is not None:
        return (labels.get("scope"), labels.get("component")) == ("common", wanted.common)
    if wanted.capability is not None:
        of_fleet = labels.get("scope") == "capability" and not labels.get("robot")
        return of_fleet and labels.get("check") == wanted.capability
    if wanted.alert is not None:
        return not problem.since and problem.alert == PREFIX + wanted.alert.removeprefix(PREFIX)
    if wanted.part is not None:
        return (labels.get("scope"), labels.get("component")) == ("exporter", wanted.part)
    parts = (None, labels.get("component"), labels.get("check"))
    return labels.get("robot") == wanted.robot and wanted.component in parts


def _acknowledge(
    client: Client, wanted: WantedProblem, author: str, comment: str, lasts: float | None
) -> list[dict[str, Any]]:
    """Acknowledge what is wanted; what was done, each with its text."""
    start, done = datetime.now(timezone.utc), []
    silences = _silences(client)
    for problem in _find(client, wanted):
        if (before := acknowledged(problem, silences)) is not None:
            text = f"{problem.name} is already acknowledged by {before.author}"
            done.append(_done(problem, before, text))
            continue
        body = silence(problem, author, comment, start, lasts)
        answer = client.post("/api/v2/silences", body)
        made = Silence.model_validate({**body, "id": (answer or {}).get("silenceID", "")})
        since = f" since {_second(problem.since)}," if problem.since else ""
        text = f"acknowledged: {problem.name} {problem.state}{since} until {_minute(made)} UTC"
        at_most = " at the latest" if problem.since else ""
        done.append(_done(problem, made, text + at_most))
    return done


def _cancel(client: Client, wanted: WantedProblem) -> list[dict[str, Any]]:
    """Take the acknowledgements back of what is wanted."""
    silences, done = _silences(client), []
    for problem in _find(client, wanted):
        while (found := acknowledged(problem, silences)) is not None:
            client.delete(f"/api/v2/silence/{quote(found.id, safe='')}")
            silences.remove(found)
            text = f"no longer acknowledged: {problem.name} {problem.state}"
            done.append(_done(problem, found, text))
    if not done:
        raise NotDoneError(f"nobody has acknowledged {str(wanted)!r}; see --list")
    return done


def _done(problem: Acknowledgeable, silenced: Silence, text: str) -> dict[str, Any]:
    return {**_fields(problem, silenced), "text": one_line(text)}


def _fields(problem: Acknowledgeable, silenced: Silence | None) -> dict[str, Any]:
    return {
        "fleet": problem.labels.get("fleet", ""),
        "part": problem.part,
        "state": problem.state,
        "since": problem.since,
        "author": None if silenced is None else silenced.author,
        "comment": None if silenced is None else silenced.words,
        "until": None if silenced is None else _until(silenced).isoformat(timespec="milliseconds"),
        "silence": None if silenced is None else silenced.id,
    }


def _until(silenced: Silence) -> datetime:
    return datetime.fromtimestamp(silenced.ends_at, timezone.utc)


def _minute(silenced: Silence) -> str:
    return f"{_until(silenced):%Y-%m-%d %H:%M}"


def _second(since: str) -> str:
    """A time of an annotation as mails have it: without its fraction."""
    return re.sub(r"(\.[0-9]+)? [+]0000 UTC", " UTC", since)


def _find(client: Client, wanted: WantedProblem) -> list[Acknowledgeable]:
    """What the arguments name, of one fleet."""
    known = problems(_alerts(client, wanted.fleet))
    found = [problem for problem in known if is_wanted(problem, wanted)] or _meant(known, wanted)
    if not found:
        raise NotDoneError(_not_firing(wanted, known))
    fleets = sorted({each.labels.get("fleet", "") for each in found})
    if len(fleets) > 1 and wanted.alert is None:
        names = ", ".join(map(one_line, fleets))
        raise NotDoneError(f"{str(wanted)!r} is of several fleets: say with --fleet which: {names}")
    return found


def _meant(known: Sequence[Acknowledgeable], wanted: WantedProblem) -> list[Acknowledgeable]:
    """Those of the component or check whose name is written shorter, or was copied."""
    if not (wanted.robot and wanted.component):
        return []
    of_robot = [each for each in known if each.labels.get("robot") == wanted.robot]
    names = (each.labels.get("component") or each.labels.get("check", "") for each in of_robot)
    named = wanted._replace(component=meant(wanted.component, names))
    return [each for each in of_robot if is_wanted(each, named)]


def _not_firing(wanted: WantedProblem, known: Sequence[Acknowledgeable]) -> str:
    others = ", ".join(dict.fromkeys(f"{each.name} {each.state}" for each in known))
    early = "or for anything else; ros-diagnostics status shows problems that are not confirmed yet"
    more = f"; there are alerts for {others}" if others else f", {early}"
    return f"no alert is firing for {str(wanted)!r}{more}"


def _list(client: Client, fleet: str | None, output: str) -> None:
    """Print what the firing alerts are about, and who has acknowledged each."""
    silences, table = _silences(client), make_table(*COLUMNS)
    known = [
        _fields(problem, acknowledged(problem, silences))
        for problem in problems(_alerts(client, fleet))
    ]
    if output == "json":
        print_json(known)
        return
    for each in known:
        about = (each["fleet"], each["part"], each["state"], _second(each["since"]))
        table.add_row(*cells((*about, each["author"] or "nobody", each["comment"])))
    make_console().print(table)


def _alerts(client: Client, fleet: str | None) -> list[Alert]:
    query = [("filter", f'fleet="{escape(fleet)}"')] if fleet else []
    return listed(client, Alert, "/api/v2/alerts" + (f"?{urlencode(query)}" if query else ""))


def _silences(client: Client) -> list[Silence]:
    return listed(client, Silence, "/api/v2/silences")
