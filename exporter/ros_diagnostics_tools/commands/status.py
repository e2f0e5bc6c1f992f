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

from ros_diagnostics_exporter import __version__, durations
from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.severity import (
    COLOURS,
    SEVERITIES,
    ShownProblem,
    clock,
    component_path,
    downtime_texts,
    event_text,
    shown_problems,
    span,
    state_of,
)
from ros_diagnostics_exporter.texts import natural, one_line, printable
from ros_diagnostics_tools.connection_flags import add_arguments, make_client, seconds

PROBLEMS_SHOWN = 5  # of one robot, in the table of robots


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the fleet once, or repeatedly; exit code 0, or 1 if the exporter does not respond."""
    parser = _parser()
    options = parser.parse_args(arguments)
    if options.history is not None and options.watch is not None:
        parser.error("--history and --watch exclude one another")
    try:
        client = make_client(options)
        if options.history is not None:
            return _history(client, options)
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
    filtered = len(robots) < len(fleet["robots"])
    return {**fleet, "robots": robots, "problems": [] if filtered else fleet["problems"]}


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
    """A table of robots and their problems, or of components, worst first, and a summary line."""
    robots = sorted(
        fleet["robots"], key=lambda robot: (-SEVERITIES[state_of(robot)], natural(robot["robot"]))
    )
    table = _components(robots, fleet["time"]) if components else _robots(fleet, robots)
    return Group(table, _summary(fleet, Counter(state_of(robot) for robot in robots)))


def _robots(fleet: dict[str, Any], robots: list[dict[str, Any]]) -> Table:
    table, now = _table("State", "Robot", "What", "Confirmed", "Since", "Message"), fleet["time"]
    for each in shown_problems(fleet, now, PROBLEMS_SHOWN, local=True)[0]:
        _add_problem(table, "", each, now)
    for robot in robots:
        problems, number = shown_problems(robot, now, PROBLEMS_SHOWN, local=True)
        for each in problems:
            _add_problem(table, robot["robot"], each, now)
        if number > len(problems):
            table.add_row("", _plain(robot["robot"]), f"and {number - len(problems)} more")
        if not problems:
            text = _plain(_received(robot, now))
            table.add_row(_coloured(state_of(robot)), _plain(robot["robot"]), "", "", "", text)
    return table


def _add_problem(table: Table, robot: str, shown: ShownProblem, now: float) -> None:
    table.add_row(
        _coloured(shown.state),
        *map(_plain, (robot, shown.subject, shown.standing, _since(shown, now), shown.message)),
    )


def _since(shown: ShownProblem, now: float) -> str:
    return f"{clock(shown.since, now, local=True)}, {span(now - shown.since)}"


def _received(robot: dict[str, Any], now: float) -> str:
    """What there is to say of a robot without problems."""
    last = robot["last_message"]
    text = "never received" if last is None else f"last message {max(0.0, now - last):.0f} s ago"
    return "; ".join((text, *downtime_texts(robot, now, local=True)))


def _table(*titles: str) -> Table:
    """A table that wraps long texts instead of cutting them off."""
    columns = (Column(title, overflow="fold") for title in titles)
    return Table(*columns, box=None, pad_edge=False)


def _components(robots: list[dict[str, Any]], now: float) -> Table:
    titles = ("State", "Robot", "Component", "Confirmed", "Since", "Message", "Values")
    table = _table(*titles)
    for robot in robots:
        worst: dict[tuple[str, str], ShownProblem] = {}
        number = len(robot["problems"])
        for shown in shown_problems(robot, now, number, local=True)[0]:
            worst.setdefault((shown.problem["group"], shown.problem["component"]), shown)
        for each in robot["components"]:
            problem = worst.get((each["group"], each["component"]))
            table.add_row(
                _coloured(each["state"] if problem is None else problem.state),
                _plain(robot["robot"]),
                _plain(component_path(each)),
                _plain("" if problem is None else problem.standing),
                _plain("" if problem is None else _since(problem, now)),
                _plain(each["message"] if problem is None else problem.message),
                _plain(*(f"{pair['key']}={pair['value']}" for pair in each["values"])),
            )
    return table


def _history(client: Client, options: argparse.Namespace) -> int:
    """Print what happened to one robot, the newest last."""
    events = list(client.events(options.since, robot=options.history))
    if options.json:
        json.dump(events, sys.stdout, indent=2)
        print()  # noqa: T201
    elif not events:
        print(f"no event of robot {printable(options.history)!r} in the last {options.since}")  # noqa: T201
    else:
        now, table = time.time(), _table("Ago", "Time", "Event")
        for event in reversed(events):
            moment = clock(event["time"], now, local=True)
            table.add_row(span(now - event["time"]), moment, _plain(event_text(event)))
        Console().print(table)
    return 0


def _plain(*lines: str) -> Text:
    """Text of a robot without markup and terminal control characters."""
    return Text("\n".join(map(one_line, lines)))


def _coloured(state: str) -> Text:
    colour, text = COLOURS[state]
    return Text(f" {state} ", style=f"bold {text} on {colour}")


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


def _ago(text: str) -> str:
    try:
        durations.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{error}; write it as 10m or 1h30m") from error
    return text


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
    parser.add_argument(
        "--history", metavar="ROBOT", help="show what happened to one robot, the newest last"
    )
    parser.add_argument(
        "--since",
        type=_ago,
        default="1h",
        metavar="DURATION",
        help="how far --history goes back, as 10m or 1h30m (default: %(default)s)",
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
