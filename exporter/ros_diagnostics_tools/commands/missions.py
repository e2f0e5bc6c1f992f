"""``ros-diagnostics missions``: whether robots do their work, and what was wrong when not."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import click
from rich.console import Console
from rich.text import Text

from ros_diagnostics_exporter.events import MOMENTS
from ros_diagnostics_exporter.fleet_texts import span
from ros_diagnostics_exporter.mission_numbers import NUMBERS, number_texts, work_of
from ros_diagnostics_exporter.severity import STATE_OF_LEVEL
from ros_diagnostics_tools.aborted import aborted_texts
from ros_diagnostics_tools.servers import Servers, with_servers
from ros_diagnostics_tools.terminal import (
    cells,
    chip,
    make_console,
    make_table,
    plain,
    print_json,
    with_output,
)

SINCE, WHEN = "7d", "in the last 7 days"  # of the events that are looked at


@click.command(epilog="Example: ros-diagnostics missions robot_3")
@click.argument("robot", required=False)
@with_output()
@with_servers
def command(servers: Servers, output: str, robot: str | None) -> None:
    """Show how the goals of ROBOT, or of all robots, ended.

    After a goal that was aborted, the other problems of that moment are counted.
    """
    wanted = {} if robot is None else {"robot": robot}
    found = servers.exporter.ask("/api/v1/missions", "robots", **wanted)
    events = [
        event for kind in MOMENTS for event in servers.exporter.events(SINCE, kind=kind, **wanted)
    ]
    if output == "json":
        print_json({**found, "aborted": events})
    else:
        _print(found["robots"], events)


def _print(robots: list[dict[str, Any]], events: list[dict[str, Any]]) -> None:
    console = make_console()
    if not robots:
        console.print(Text("No action of a robot was seen, and fleet.yml has no `modes`."))
        return
    table = make_table(
        "Robot", "Action", "State", "Succeeded", "Aborted", "Unknown", "Running", "Message"
    )
    for each in robots:
        for action in each["actions"]:
            table.add_row(*_row(each["robot"], action))
    console.print(table)
    _print_numbers(console, robots)
    for _action, text in aborted_texts(events, WHEN):
        console.print(plain(text))


def _row(robot: str, action: dict[str, Any]) -> tuple[Text, ...]:
    """Of an action that no entry names, what was counted."""
    results, seconds = action["results"], action["longest"]
    ended = results["succeeded"] + results["aborted"]
    share = f"{results['succeeded']} of {ended}" if ended else ""
    running = f"{action['running']}, for {span(seconds)}" if action["running"] else "0"
    counts = (share, str(results["aborted"]), str(results["unknown"]), running)
    message = action.get("message", "")
    before, after = cells((robot, action["action"])), cells((*counts, message))
    level = action.get("level")
    return (*before, chip(STATE_OF_LEVEL[level]) if level else Text(), *after)


def _print_numbers(console: Console, robots: Iterable[dict[str, Any]]) -> None:
    """The three numbers of each robot that has them."""
    found = {each["robot"]: number_texts(work_of(each)) for each in robots}
    table = make_table("Robot", *NUMBERS)
    for robot, texts in found.items():
        if texts:
            table.add_row(*cells((robot, *(texts.get(name, "") for name in NUMBERS))))
    if table.row_count:
        console.print(table)
