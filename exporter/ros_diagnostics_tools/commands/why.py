"""``ros-diagnostics why``: why somebody was notified of a robot's faults, or nobody."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import click
from rich.text import Text

from ros_diagnostics_exporter.fleet_texts import clock
from ros_diagnostics_exporter.http_client import AnsweredError
from ros_diagnostics_tools.names import meant, no_robot
from ros_diagnostics_tools.servers import Servers, with_servers
from ros_diagnostics_tools.terminal import (
    cells,
    make_console,
    make_table,
    plain,
    print_json,
    with_output,
)
from ros_diagnostics_tools.times import Moment


@click.command(epilog='Example: ros-diagnostics why robot_3 "Motor 1" --at 14:30')
@click.argument("robot")
@click.argument("component", required=False)
@click.option(
    "--at",
    type=Moment(),
    metavar="TIME",
    help="Explain the faults of this time: 10m (ago), 14:30, 2027-01-31T14:30. If there were none, "
    "explain the last fault before.  [default: now]",
)
@with_output()
@with_servers
def command(
    servers: Servers, output: str, robot: str, component: str | None, at: datetime | None
) -> None:
    """Explain who was notified of the faults of ROBOT, or of its COMPONENT, or why nobody was."""
    moment = None if at is None else str(at.timestamp())
    if component:
        known = servers.exporter.fleet((robot,))["robots"]
        component = meant(
            component, (each["component"] for of in known for each in of["components"])
        )
    query = {"robot": robot, "component": component or None, "at": moment}
    try:
        found = servers.exporter.ask("/api/v1/why", "entries", "now", "time", **query)
    except AnsweredError as error:
        names = [each["robot"] for each in servers.exporter.fleet()["robots"]]
        if robot in names:
            raise
        raise no_robot(robot, names) from error
    if output == "json":
        print_json(found)
    else:
        _print(found)


def _print(answer: dict[str, Any]) -> None:
    console = make_console()
    table = make_table("Time", "What happened")
    for each in answer["entries"]:
        moment = clock(each["time"], answer["time"], local=True)
        table.add_row(*cells((moment, each["text"])))
    console.print(table if answer["entries"] else Text("No fault and no event at that time."))
    console.print(Text(f"\nNow, {clock(answer['time'], answer['time'], local=True)}:"))
    for sentence in answer["now"]:
        console.print(plain(f"  {sentence}"))
