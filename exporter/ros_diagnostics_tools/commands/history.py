"""``ros-diagnostics history``: what happened to a robot."""

from __future__ import annotations

import time
from datetime import datetime
from itertools import groupby
from operator import itemgetter
from typing import Any

import click
from rich.console import Console

from ros_diagnostics_exporter.api.occurrences import WEEK
from ros_diagnostics_exporter.event_texts import event_text
from ros_diagnostics_exporter.fleet_texts import clock, span
from ros_diagnostics_exporter.texts import one_line, printable
from ros_diagnostics_tools.names import no_robot
from ros_diagnostics_tools.servers import Servers, with_servers
from ros_diagnostics_tools.terminal import cells, make_table, print_json, with_output
from ros_diagnostics_tools.times import Moment
from ros_diagnostics_tools.week_sentences import sentences


@click.command(
    epilog="""\b
Examples:
  ros-diagnostics history robot_3 --since 3h
  ros-diagnostics history robot_3 --week
"""
)
@click.argument("robot")
@click.option(
    "--since",
    type=Moment(),
    default="1h",
    metavar="TIME",
    help="How far to go back: 10m (ago), 14:30, 2027-01-31T14:30.",
)
@click.option(
    "--week",
    is_flag=True,
    help="What failed in the last seven days, how often and after what, in sentences.",
)
@with_output()
@with_servers
def command(servers: Servers, output: str, robot: str, since: datetime, *, week: bool) -> None:
    """Show what happened to ROBOT, the newest last."""
    if week:
        _show_week(servers, output, robot)
        return
    events = list(servers.exporter.events(str(since.timestamp()), robot=robot))[::-1]
    if output == "json":
        print_json(events)
        return
    now, table = time.time(), make_table("Ago", "Time", "Event")
    for event in events:
        moment = clock(event["time"], now, local=True)
        table.add_row(*cells((span(now - event["time"]), moment, event_text(event))))
    if events:
        Console().print(table)
    else:
        _known(servers.exporter.fleet(), robot)
        then = clock(since.timestamp(), now, local=True)
        print(f"no event of robot {printable(robot)!r} since {then}")  # noqa: T201


def _known(fleet: dict[str, Any], robot: str) -> dict[str, Any]:
    """A robot of the fleet.

    Raises:
        NotDoneError: there is none of that name; one with a similar name is named.
    """
    found: dict[str, dict[str, Any]] = {each["robot"]: each for each in fleet["robots"]}
    if robot not in found:
        raise no_robot(robot, found)
    return found[robot]


def _show_week(servers: Servers, output: str, robot: str) -> None:
    """What failed of a robot in a week: one line for each part, what lasts first."""
    exporter = servers.exporter
    fleet = exporter.fleet()
    known = _known(fleet, robot)
    now = fleet["time"]
    begin = exporter.ask("/api/v1/faults", "events_since")["events_since"]
    since = max(now - WEEK, now if begin is None else begin)
    events = {each["id"]: each for each in exporter.events(str(since), robot=robot)}
    for kind in ("fault_began", "fault_ended"):  # one that began before the week may last
        events |= {each["id"]: each for each in exporter.events("0", robot=robot, kind=kind)}
    found = sentences(events.values(), known, now, since)
    if output == "json":
        print_json(found)
        return
    for _about, parts in groupby(found, key=itemgetter("about")):
        print(one_line(" ".join(each["text"] for each in parts)))  # noqa: T201
