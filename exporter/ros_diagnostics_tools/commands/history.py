"""``ros-diagnostics history``: what happened to a robot."""

from __future__ import annotations

import time
from datetime import datetime

import click
from rich.console import Console

from ros_diagnostics_exporter.event_texts import event_text
from ros_diagnostics_exporter.severity import clock, span
from ros_diagnostics_exporter.texts import printable
from ros_diagnostics_tools.servers import Servers, with_servers
from ros_diagnostics_tools.terminal import cells, make_table, print_json, with_output
from ros_diagnostics_tools.times import Moment


@click.command(epilog="Example: ros-diagnostics history robot_3 --since 3h")
@click.argument("robot")
@click.option(
    "--since",
    type=Moment(),
    default="1h",
    show_default=True,
    metavar="TIME",
    help="How far to go back: 10m (ago), 14:30, 2027-01-31T14:30.",
)
@with_output()
@with_servers
def command(servers: Servers, output: str, robot: str, since: datetime) -> None:
    """Show what happened to ROBOT, the newest last."""
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
        then = clock(since.timestamp(), now, local=True)
        print(f"no event of robot {printable(robot)!r} since {then}")  # noqa: T201
