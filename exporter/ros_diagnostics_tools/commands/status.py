"""``ros-diagnostics status``: the fleet in a terminal."""

from __future__ import annotations

import fnmatch
import sys
import time
from collections import Counter
from collections.abc import Sequence
from typing import Any

import click
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from ros_diagnostics_exporter.fleet_texts import (
    clock,
    downtime_texts,
    span,
    unclaimed_texts,
    unread_text,
)
from ros_diagnostics_exporter.http_client import UnreachableError
from ros_diagnostics_exporter.severity import (
    SEVERITIES,
    ShownProblem,
    component_path,
    is_robot,
    short_names,
    shown_problems,
    state_of,
)
from ros_diagnostics_exporter.texts import natural, printable
from ros_diagnostics_tools.flag_types import Written
from ros_diagnostics_tools.servers import Servers, with_servers
from ros_diagnostics_tools.terminal import chip, make_table, plain, print_json, with_output
from ros_diagnostics_tools.times import Duration

COLUMNS = ("State", "Robot", "What", "Confirmed", "Since", "Message")
PROBLEMS_SHOWN = 5  # of one robot, in the table of robots


class States(Written[frozenset[str]]):
    """Some of the states, separated by commas."""

    name = "state"

    def read(self, text: str) -> frozenset[str]:
        """The states, in capitals."""
        states = frozenset(text.upper().split(","))
        if unknown := states - SEVERITIES.keys():
            found = ", ".join(sorted(unknown))
            raise ValueError(f"{found}: not one of {', '.join(SEVERITIES)}")
        return states


@click.command(epilog="Example: ros-diagnostics status --state critical,silent --watch")
@click.option("--state", type=States(), metavar="STATE[,STATE]", help="Only robots in these.")
@click.option(
    "--robot",
    default="*",
    show_default=False,
    metavar="PATTERN",
    help="Only these robots; * and ? are wildcards.",
)
@click.option(
    "--component",
    metavar="TEXT",
    help="Show the components whose /Group/Component contains this, ignoring case; '' shows all.",
)
@click.option(
    "--watch",
    type=Duration(),
    is_flag=False,
    flag_value="2s",
    metavar="[DURATION]",
    help="Refresh every 2s, or so often, until Ctrl-C.",
)
@with_output()
@with_servers
def command(*, servers: Servers, output: str, watch: float | None, **filters: Any) -> None:
    """Show the fleet: each robot's state and its problems, the worst first."""
    if output == "json" and watch is not None:
        raise click.UsageError("--watch cannot be combined with --output json")
    if watch is not None:
        _watch(servers, watch, filters)
        return
    fleet = choose(servers.exporter.fleet(), **filters)
    if output == "json":
        print_json(fleet)
    else:
        Console().print(view(fleet, components=filters["component"] is not None))


def choose(
    fleet: dict[str, Any], state: frozenset[str] | None, robot: str, component: str | None
) -> dict[str, Any]:
    """The robots that match the filters; with a component only their matching components."""
    robots = [
        each
        for each in fleet["robots"]
        if fnmatch.fnmatchcase(each["robot"], robot) and (not state or state_of(each) in state)
    ]
    if component is not None:
        wanted = component.casefold()
        robots = [
            {**each, "components": found}
            for each in robots
            if (found := [one for one in each["components"] if _named(one, wanted)])
        ]
    filtered = len(robots) < len(fleet["robots"])
    if filtered:
        return {**fleet, "robots": robots, "problems": [], "unclaimed": []}
    return {**fleet, "robots": robots}


def _named(component: dict[str, Any], wanted: str) -> bool:
    return wanted in f"{component['group']}/{component['component']}".casefold()


def _watch(servers: Servers, every: float, filters: dict[str, Any]) -> None:
    with Live(auto_refresh=False, screen=sys.stdout.isatty()) as live:
        while True:
            try:
                fleet = choose(servers.exporter.fleet(), **filters)
                table: Any = view(fleet, components=filters["component"] is not None)
            except UnreachableError as error:  # keep watching: it may come back
                table = Text(printable(str(error)), style="bold red")
            live.update(table, refresh=True)
            time.sleep(every)


def view(fleet: dict[str, Any], *, components: bool = False) -> Group:
    """A table of robots and their problems, or of components, worst first, and a summary line."""
    robots = sorted(
        fleet["robots"], key=lambda robot: (-SEVERITIES[state_of(robot)], natural(robot["robot"]))
    )
    table = _components(robots, fleet["time"]) if components else _robots(fleet, robots)
    below = [f"no entry of fleet.yml matches {each}" for each in unclaimed_texts(fleet)]
    if unread := unread_text(fleet, local=True):
        below.insert(0, unread)
    summary = _summary(fleet, robots)
    return Group(table, summary, plain(*below)) if below else Group(table, summary)


def _robots(fleet: dict[str, Any], robots: list[dict[str, Any]]) -> Table:
    rows, now = list[tuple[Text, ...]](), fleet["time"]
    for each in shown_problems(fleet, now, PROBLEMS_SHOWN, local=True)[0]:
        rows.append(_problem("", each, now))
    for robot in robots:
        problems, number = shown_problems(robot, now, PROBLEMS_SHOWN, local=True)
        rows += [_problem(robot["robot"], each, now) for each in problems]
        if number > len(problems):
            more = f"and {number - len(problems)} more"
            rows.append((Text(), *map(plain, (robot["robot"], more, "", "", ""))))
        if not problems:
            texts = (robot["robot"], "", "", "", _received(robot, now))
            rows.append((chip(state_of(robot)), *map(plain, texts)))
    return _table(COLUMNS, rows)


def _problem(robot: str, shown: ShownProblem, now: float) -> tuple[Text, ...]:
    texts = (robot, shown.subject, shown.standing, _since(shown, now), shown.message)
    return (chip(shown.state), *map(plain, texts))


def _table(titles: Sequence[str], rows: list[tuple[Text, ...]]) -> Table:
    """Without the columns that say nothing: empty ones, and that of the robot if there is one."""
    said = [{row[number].plain for row in rows} for number in range(len(titles))]
    kept = [
        number
        for number, title in enumerate(titles)
        if not rows or (said[number] != {""} and (title != "Robot" or len(said[number]) > 1))
    ]
    table = make_table(*(titles[number] for number in kept))
    for row in rows:
        table.add_row(*(row[number] for number in kept))
    return table


def _since(shown: ShownProblem, now: float) -> str:
    return f"{clock(shown.since, now, local=True)}, {span(now - shown.since)}"


def _received(robot: dict[str, Any], now: float) -> str:
    """What there is to say of a robot without problems."""
    last = robot["last_message"]
    text = "never received" if last is None else f"last message {max(0.0, now - last):.0f} s ago"
    return "; ".join((text, *downtime_texts(robot, now, local=True)))


def _components(robots: list[dict[str, Any]], now: float) -> Table:
    titles = ("State", "Robot", "Component", "Confirmed", "Since", "Message", "Values")
    rows = list[tuple[Text, ...]]()
    for robot in robots:
        short = short_names(robot)
        worst: dict[tuple[str, str], ShownProblem] = {}
        number = len(robot["problems"])
        for shown in shown_problems(robot, now, number, local=True)[0]:
            worst.setdefault((shown.problem["group"], shown.problem["component"]), shown)
        for each in robot["components"]:
            problem = worst.get((each["group"], each["component"]))
            rows.append(
                (
                    chip(each["state"] if problem is None else problem.state),
                    plain(robot["robot"]),
                    plain(short[component_path(each)]),
                    plain("" if problem is None else problem.standing),
                    plain("" if problem is None else _since(problem, now)),
                    plain(each["message"] if problem is None else problem.message),
                    plain(*(f"{pair['key']}={pair['value']}" for pair in each["values"])),
                )
            )
    return _table(titles, rows)


def _summary(fleet: dict[str, Any], robots: Sequence[dict[str, Any]]) -> Text:
    count = Counter(state_of(each) for each in robots if len(robots) == 1 or is_robot(each))
    found = ", ".join(f"{count[state]} {state}" for state in SEVERITIES if count[state])
    if len(robots) == 1:
        found = f"{robots[0]['robot']} is {found.removeprefix('1 ')}"
    moment = time.strftime("%H:%M:%S", time.localtime(fleet["time"]))
    return plain("", f"fleet {fleet['fleet']} at {moment}: {found or 'no robot matches'}")
