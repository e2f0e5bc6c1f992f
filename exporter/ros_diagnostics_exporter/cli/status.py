"""``ros-diagnostics-status``: the fleet in a terminal."""

from __future__ import annotations

import argparse
import fnmatch
import json
import sys
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

from rich.console import Console, Group
from rich.live import Live
from rich.table import Column, Table
from rich.text import Text

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.cli.connection_flags import add_arguments, make_client, seconds
from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.severity import (
    SEVERITIES,
    ago,
    faults_of,
    level_text,
    short_check_texts,
    state_of,
)
from ros_diagnostics_exporter.texts import natural, one_line, printable

COLOURS = {
    "UNKNOWN": "magenta",
    "CRITICAL": "bold red",
    "STALE": "yellow",
    "WARNING": "bold yellow",
    "OK": "green",
    "PENDING": "dim",
}
FAULTS_SHOWN = 3  # of one robot, in the table of robots


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the fleet once, or repeatedly; exit code 0, or 1 if the exporter does not respond."""
    options = _parser().parse_args(arguments)
    try:
        client = make_client(options)
        return _watch(client, options) if options.watch is not None else _once(client, options)
    except UnreachableError as error:
        print(f"ros-diagnostics-status: {printable(str(error))}", file=sys.stderr)  # noqa: T201
        return 1
    except (KeyboardInterrupt, BrokenPipeError):
        return 0


def choose(fleet: dict[str, Any], options: argparse.Namespace) -> dict[str, Any]:
    """The robots that match the filters; with --component only their matching components."""
    robots = [
        robot
        for robot in fleet["robots"]
        if fnmatch.fnmatchcase(robot["robot"], options.robot)
        and (not options.state or state_of(robot) in options.state)
    ]
    if options.component is not None:
        wanted = options.component.casefold()
        robots = [
            {**robot, "components": found}
            for robot in robots
            if (found := [each for each in robot["components"] if _named(each, wanted)])
        ]
    return {**fleet, "robots": robots}


def _named(component: dict[str, Any], wanted: str) -> bool:
    return wanted in f"{component['group']}/{component['component']}".casefold()


def _once(client: Client, options: argparse.Namespace) -> int:
    fleet = choose(client.fleet(), options)
    if options.json:
        json.dump(fleet, sys.stdout, indent=2)
        print()  # noqa: T201
    else:
        Console().print(view(fleet, components=options.component is not None))
    return 0


def _watch(client: Client, options: argparse.Namespace) -> int:
    with Live(auto_refresh=False, screen=sys.stdout.isatty()) as live:
        while True:
            try:
                fleet = choose(client.fleet(), options)
                table: Any = view(fleet, components=options.component is not None)
            except UnreachableError as error:  # keep watching: it may come back
                table = Text(printable(str(error)), style="bold red")
            live.update(table, refresh=True)
            time.sleep(options.watch)


def view(fleet: dict[str, Any], *, components: bool = False) -> Group:
    """A table of robots, or of their components, worst first, and a summary line."""
    robots = sorted(
        fleet["robots"], key=lambda robot: (-SEVERITIES[state_of(robot)], natural(robot["robot"]))
    )
    table = _components(robots, fleet["time"]) if components else _robots(robots, fleet["time"])
    return Group(table, _summary(fleet, Counter(state_of(robot) for robot in robots)))


def _robots(robots: list[dict[str, Any]], now: float) -> Table:
    table = _table("State", "Robot", "Last message", "Faults")
    for robot in robots:
        received = robot["last_message"]
        table.add_row(
            _coloured(state_of(robot)),
            _plain(robot["robot"]),
            "never" if received is None else f"{max(0.0, now - received):.0f} s ago",
            _faults(robot, now),
        )
    return table


def _table(*titles: str) -> Table:
    """A table that wraps long texts instead of cutting them off."""
    columns = (Column(title, overflow="fold") for title in titles)
    return Table(*columns, box=None, pad_edge=False)


def _faults(robot: dict[str, Any], now: float) -> Text:
    parts = [f"silent: {robot['silent_reason']}"] if not robot["up"] else []
    parts += ["in maintenance"] if robot["maintenance"] else []
    parts += short_check_texts(robot)
    faults = faults_of(robot)
    parts += [
        f"{each['component']} {level_text(each)}: {each['message']} {ago(each['since'], now)}"
        for each in faults[:FAULTS_SHOWN]
    ]
    if len(faults) > FAULTS_SHOWN:
        parts.append(f"and {len(faults) - FAULTS_SHOWN} more")
    return _plain(*parts)


def _components(robots: list[dict[str, Any]], now: float) -> Table:
    table = _table("State", "Robot", "Component", "Message", "Values")
    for robot in robots:
        for each in robot["components"]:
            table.add_row(
                _coloured(each["state"]),
                _plain(robot["robot"]),
                _plain(f"{each['group']} {each['component']}"),
                _plain(f"{each['message']} {ago(each['since'], now)}"),
                _plain(*(f"{pair['key']}={pair['value']}" for pair in each["values"])),
            )
    return table


def _plain(*lines: str) -> Text:
    """Text of a robot without markup and terminal control characters."""
    return Text("\n".join(map(one_line, lines)))


def _coloured(state: str) -> Text:
    return Text(state, style=COLOURS[state])


def _summary(fleet: dict[str, Any], count: Counter[str]) -> Text:
    counts = ", ".join(f"{count[state]} {state}" for state in SEVERITIES if count[state])
    moment = time.strftime("%H:%M:%S", time.localtime(fleet["time"]))
    return _plain("", f"fleet {fleet['fleet']} at {moment}: {counts or 'no robot matches'}")


def _states(text: str) -> frozenset[str]:
    states = frozenset(text.upper().split(","))
    if unknown := states - SEVERITIES.keys():
        raise argparse.ArgumentTypeError(
            f"{', '.join(sorted(unknown))}: not one of {', '.join(SEVERITIES)}"
        )
    return states


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ros-diagnostics-status",
        description="Show the fleet that a ROS diagnostics exporter monitors.",
        epilog="example: ros-diagnostics-status --state critical,unknown --watch",
    )
    parser.add_argument(
        "--state", type=_states, metavar="STATE[,STATE]", help="only robots in these states"
    )
    parser.add_argument(
        "--robot",
        default="*",
        metavar="PATTERN",
        help="only robots whose name matches; * and ? are wildcards",
    )
    parser.add_argument(
        "--component",
        metavar="TEXT",
        help="show the components whose /Group/Component contains this, ignoring case; "
        "'' shows all",
    )
    form = parser.add_mutually_exclusive_group()
    form.add_argument(
        "--watch",
        type=seconds,
        nargs="?",
        const=2.0,
        metavar="SECONDS",
        help="refresh every SECONDS (default: 2) until Ctrl-C",
    )
    form.add_argument("--json", action="store_true", help="print JSON for other programs")
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    add_arguments(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
