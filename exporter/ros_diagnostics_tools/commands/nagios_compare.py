"""``ros-diagnostics nagios compare``: where Nagios and this project notified differently.

For a site that runs both for some weeks: it reads Nagios' log and the exporter's record of what
Alertmanager sent, and lists what only one of them notified, and what one notified later.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import click
from rich.text import Text

from ros_diagnostics_exporter import durations
from ros_diagnostics_tools.errors import NO, UnusableError
from ros_diagnostics_tools.flag_types import PATH, NamedPair
from ros_diagnostics_tools.nagios.comparison import log
from ros_diagnostics_tools.nagios.comparison.differences import Differences, compare
from ros_diagnostics_tools.nagios.comparison.here import EventsError, Here, notified_here
from ros_diagnostics_tools.nagios.comparison.notice import Notice
from ros_diagnostics_tools.servers import Servers, with_servers
from ros_diagnostics_tools.terminal import (
    cells,
    make_console,
    make_table,
    plain,
    print_json,
    with_output,
)
from ros_diagnostics_tools.times import Duration, Moment


@dataclass(frozen=True)
class CompareOptions:
    """The command line."""

    servers: Servers
    output: str
    logs: tuple[Path, ...]
    service: tuple[tuple[str, str], ...]
    since: datetime | None
    until: datetime | None
    late: float
    within: float
    events: Path | None


@click.command(
    "compare",
    epilog="""\b
Example:
  ros-diagnostics nagios compare /var/log/nagios4/nagios.log \\
      /var/log/nagios4/archives/*.log --since 14d --service Motors=Motor
""",
)
@click.argument("logs", nargs=-1, required=True, type=PATH, metavar="LOG...")
@click.option(
    "--service",
    multiple=True,
    type=NamedPair("service", "SERVICE=PATTERN, such as Motors=Motor for a service with -N Motor"),
    metavar="NAME=PATTERN",
    help="The service of Nagios that checks with -N PATTERN; repeatable.  [default: the pattern is "
    "the service's name]",
)
@click.option(
    "--since",
    type=Moment(),
    metavar="TIME",
    help="Compare from this time on: 14d (ago), 2027-01-31.  [default: all that both recorded]",
)
@click.option("--until", type=Moment(), metavar="TIME", help="Compare until this time.")
@click.option(
    "--late",
    type=Duration(),
    default="2m",
    help="A notification that both sent is listed as late if its two times are further apart than "
    "this.",
)
@click.option(
    "--within",
    type=Duration(),
    default="15m",
    help="Two notifications that are further apart than this are not the same one.",
)
@click.option(
    "--events",
    type=PATH,
    metavar="FILE",
    help="A saved answer of the exporter's /api/v1/events?kind=notified, instead of asking it.",
)
@with_output()
@with_servers
def command(**given: Any) -> int:
    """List where Nagios and this project notified differently.

    LOG is nagios.log and its archives, in any order; - is the standard input. Exit code 0: both
    notified the same; 1: they disagree; 2: nothing could be compared.
    """
    options = CompareOptions(**given)
    try:
        theirs = log.read(options.logs)
        events, robots = _recorded(options)
        return _compare(options, theirs, events, robots)
    except (log.LogError, EventsError) as error:
        raise UnusableError(str(error)) from error


def _recorded(options: CompareOptions) -> tuple[list[dict[str, Any]], set[str]]:
    """The events here, and the names of the robots; of a file those that it names."""
    if options.events is None:
        client = options.servers.exporter
        robots = {each["robot"] for each in client.fleet()["robots"]}
        return list(client.events("0", kind="notified")), robots
    try:
        found = json.loads(options.events.read_text(encoding="utf-8"))
        events = found["events"]
        return events, {each.get("robot", "") for each in events}
    except OSError as error:
        raise EventsError(f"{options.events}: {error.strerror or error}") from error
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise EventsError(
            f"{options.events} is no answer of the exporter's /api/v1/events?kind=notified"
        ) from error


def _compare(
    options: CompareOptions, theirs: log.Log, events: list[dict[str, Any]], robots: set[str]
) -> int:
    since, until = _span(options, theirs, events)
    compared = [each for each in theirs.notices if each.robot in robots]
    here = notified_here(events, {each.about for each in compared}, dict(options.service))
    wide = since - options.within, until + options.within
    found = compare(
        _within(compared, *wide),
        Here(_within(here.notices, *wide), here.larger, here.robots),
        late=options.late,
        within=options.within,
    ).between(since, until)
    others = len(theirs.notices) - len(compared)
    notes = dict(_notes(theirs, others, options.service))
    if options.output == "json":
        content = {"since": since, "until": until, **_content(found), "notes": notes}
        print_json(content)
    else:
        _print(found, since, until, notes)
    if found.empty and others and not _within(compared, since, until):
        raise log.LogError(
            "nothing was compared: no host that Nagios notified of is a robot here; is it the "
            "exporter of these robots?"
        )
    return 0 if found.agree else NO


def _span(
    options: CompareOptions, theirs: log.Log, events: list[dict[str, Any]]
) -> tuple[float, float]:
    """The time that both sides were recorded in, or the part of it that is asked for."""
    first = min((each["time"] for each in events if "time" in each), default=theirs.begin)
    # The record here may begin later than Nagios' log, or what is asked for before both.
    since = max(theirs.begin, first - options.within)
    if options.since is not None:
        since = max(since, options.since.timestamp())
    until = theirs.end
    if options.until is not None:
        until = min(until, options.until.timestamp())
    if since > until:
        raise log.LogError(
            f"nothing to compare: from {_clock(since)} is after {_clock(until)}; Nagios' log has "
            f"{_clock(theirs.begin)} to {_clock(theirs.end)}"
        )
    return since, until


def _within(notices: Iterable[Notice], since: float, until: float) -> list[Notice]:
    return [each for each in notices if since <= each.time <= until]


def _notes(
    theirs: log.Log, others: int, services: Iterable[tuple[str, str]]
) -> Iterable[tuple[str, str]]:
    notified = sorted({each.service for each in theirs.notices if each.service})
    for name, _pattern in services:
        if name not in notified:
            names = ", ".join(notified) or "no service"
            yield f"service {name}", f"no notification of Nagios has it; there are some of {names}"
    if others:
        yield "hosts that are no robots here", f"{others} notifications of Nagios not compared"
    for kind, count in sorted(theirs.skipped.items()):
        yield kind, f"{count} notifications of Nagios not compared"
    if theirs.damaged:
        yield "damaged lines", f"{theirs.damaged}, the first: {theirs.first_damaged}"


def _content(differences: Differences) -> dict[str, Any]:
    return {
        "same": len(differences.pairs),
        "only_in_nagios": [asdict(each) for each in differences.only_in_nagios],
        "only_here": [asdict(each) for each in differences.only_here],
        "late": [{**asdict(each.nagios), "later_here": each.later} for each in differences.late],
        "explained": [{**asdict(each), "here": one.name} for each, one in differences.explained],
    }


def _print(differences: Differences, since: float, until: float, notes: dict[str, str]) -> None:
    console = make_console()
    table = make_table("Time", "Robot", "Service", "State", "Difference")
    rows = [(each, f"only in Nagios: {each.detail:.80}") for each in differences.only_in_nagios]
    rows += [(each, f"only here: {each.detail:.80}") for each in differences.only_here]
    rows += [(each.nagios, _later(each.later)) for each in differences.late]
    rows += [(each, f"here one notification: {one.name}") for each, one in differences.explained]
    for each, text in sorted(rows, key=lambda row: row[0].time):
        table.add_row(*cells((_clock(each.time), each.robot, each.service, each.state, text)))
    if rows:
        console.print(table)
    for what, note in notes.items():
        console.print(plain(f"{what}: {note}"))
    console.print(
        Text(
            f"{_clock(since)} to {_clock(until)}: {len(differences.pairs)} the same, "
            f"{len(differences.only_in_nagios)} only in Nagios, "
            f"{len(differences.only_here)} only here, {len(differences.late)} at another time, "
            f"{len(differences.explained)} in a larger one here"
        )
    )


def _later(seconds: float) -> str:
    side = "here" if seconds > 0 else "in Nagios"
    return f"{durations.written(round(abs(seconds)))} later {side}"


def _clock(moment: float) -> str:
    """A local time with its year: logs are of months."""
    try:
        return f"{datetime.fromtimestamp(moment, timezone.utc).astimezone():%Y-%m-%d %H:%M:%S}"
    except (ValueError, OverflowError, OSError):
        return f"{moment:.0f}"
