"""``ros-diagnostics faults``: the confirmed problems that last."""

from __future__ import annotations

import fnmatch
from typing import Any

import click
from rich.console import Console

from ros_diagnostics_exporter.fleet_texts import clock, span
from ros_diagnostics_exporter.severity import problem_state, subject
from ros_diagnostics_tools.servers import Servers, with_servers
from ros_diagnostics_tools.terminal import cells, make_table, print_json, with_output


@click.command(epilog="Example: ros-diagnostics faults --robot 'arm_*' --output json")
@click.option(
    "--robot",
    default="*",
    show_default=False,
    metavar="PATTERN",
    help="Only of these robots; * and ? are wildcards.",
)
@with_output()
@with_servers
def command(servers: Servers, output: str, robot: str) -> None:
    """List the faults (confirmed problems) that last, the oldest first."""
    found = servers.exporter.ask("/api/v1/faults", "faults")
    faults = [each for each in found["faults"] if fnmatch.fnmatchcase(each["robot"], robot)]
    if output == "json":
        print_json({**found, "faults": faults})
    elif not faults:
        print(f"no fault of fleet {found['fleet']}")  # noqa: T201
    else:
        _print(faults, found["time"])


def _print(faults: list[dict[str, Any]], now: float) -> None:
    table = make_table("State", "Robot", "What", "Since", "Lasts", "Evidence")
    for each in faults:
        since = clock(each["since"], now, local=True), span(now - each["since"])
        about = problem_state(each), each["robot"], subject(each)
        table.add_row(*cells((*about, *since, each["evidence"])))
    Console().print(table)
