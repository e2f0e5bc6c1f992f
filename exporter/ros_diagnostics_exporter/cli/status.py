"""``ros-diagnostics-status``: the fleet in a terminal, for the person with an ssh session."""

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
from ros_diagnostics_exporter.http_client import UnreachableError, add_arguments, ask_fleet, seconds
from ros_diagnostics_exporter.severity import (
    RANKS,
    ago,
    faults_of,
    level_told,
    short_told,
    state_of,
)
from ros_diagnostics_exporter.texts import natural, printable, shown

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
    """Print the fleet once, or again and again; 0, or 1 when the exporter gives no answer."""
    options = _parser().parse_args(arguments)
    try:
        return _watch(options) if options.watch is not None else _once(options)
    except UnreachableError as error:
        print(f"ros-diagnostics-status: {printable(str(error))}", file=sys.stderr)  # noqa: T201
        return 1
    except (KeyboardInterrupt, BrokenPipeError):
        return 0


def choose(fleet: dict[str, Any], options: argparse.Namespace) -> dict[str, Any]:
    """The part of the fleet that the filters leave; robots, and with --component components."""
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


def _once(options: argparse.Namespace) -> int:
    fleet = choose(ask_fleet(options), options)
    if options.json:
        json.dump(fleet, sys.stdout, indent=2)
        print()  # noqa: T201
    else:
        Console().print(view(fleet, options))
    return 0


def _watch(options: argparse.Namespace) -> int:
    with Live(auto_refresh=False, screen=sys.stdout.isatty()) as live:
        while True:
            try:
                table: Any = view(choose(ask_fleet(options), options), options)
            except UnreachableError as error:  # it may come back: that is what is watched for
                table = Text(printable(str(error)), style="bold red")
            live.update(table, refresh=True)
            time.sleep(options.watch)


def view(fleet: dict[str, Any], options: argparse.Namespace) -> Group:
    """What is printed: a table, worst first, and a line that sums it up."""
    robots = sorted(
        fleet["robots"], key=lambda robot: (-RANKS[state_of(robot)], natural(robot["robot"]))
    )
    table = (
        _components(robots, fleet["time"])
        if options.component is not None
        else _robots(robots, fleet["time"])
    )
    return Group(table, _sum(fleet, Counter(state_of(robot) for robot in robots)))


def _robots(robots: list[dict[str, Any]], now: float) -> Table:
    table = _table("State", "Robot", "Last heard", "Faults")
    for robot in robots:
        heard = robot["last_message"]
        table.add_row(
            _coloured(state_of(robot)),
            _plain(robot["robot"]),
            "never" if heard is None else f"{max(0.0, now - heard):.0f} s ago",
            _told(robot, now),
        )
    return table


def _table(*titles: str) -> Table:
    """Long texts go on in the next line: what is cut off is what one looks for."""
    columns = (Column(title, overflow="fold") for title in titles)
    return Table(*columns, box=None, pad_edge=False)


def _told(robot: dict[str, Any], now: float) -> Text:
    parts = [f"silent: {robot['silent_reason']}"] if not robot["up"] else []
    parts += ["in maintenance"] if robot["maintenance"] else []
    parts += short_told(robot)
    faults = faults_of(robot)
    parts += [
        f"{each['component']} {level_told(each)}: {each['message']} {ago(each['since'], now)}"
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
    """What a robot said: no markup, and nothing that a terminal obeys."""
    return Text("\n".join(map(shown, lines)))


def _coloured(state: str) -> Text:
    return Text(state, style=COLOURS[state])


def _sum(fleet: dict[str, Any], count: Counter[str]) -> Text:
    told = ", ".join(f"{count[state]} {state}" for state in RANKS if count[state])
    moment = time.strftime("%H:%M:%S", time.localtime(fleet["time"]))
    return _plain("", f"fleet {fleet['fleet']} at {moment}: {told or 'no robot matches'}")


def _states(text: str) -> frozenset[str]:
    states = frozenset(text.upper().split(","))
    if unknown := states - RANKS.keys():
        raise argparse.ArgumentTypeError(
            f"{', '.join(sorted(unknown))}: not among {', '.join(RANKS)}"
        )
    return states


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ros-diagnostics-status",
        description="Show the fleet that a ROS diagnostics exporter knows.",
        epilog="example: ros-diagnostics-status --state critical,unknown --watch",
    )
    parser.add_argument(
        "--state", type=_states, metavar="STATE[,STATE]", help="only robots in these states"
    )
    parser.add_argument(
        "--robot", default="*", metavar="PATTERN", help="only these robots; * and ? are wild"
    )
    parser.add_argument(
        "--component",
        metavar="TEXT",
        help="show components, those whose /Group/Component contains this, case ignored; "
        "'' shows all",
    )
    form = parser.add_mutually_exclusive_group()
    form.add_argument(
        "--watch",
        type=seconds,
        nargs="?",
        const=2.0,
        metavar="SECONDS",
        help="show it again and again, every 2 seconds or so many; Ctrl-C ends it",
    )
    form.add_argument("--json", action="store_true", help="print JSON for other programs")
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    add_arguments(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
