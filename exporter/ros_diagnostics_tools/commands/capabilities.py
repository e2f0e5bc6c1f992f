"""``ros-diagnostics capabilities``: what a robot can do, and what it would lose next."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import click
from rich.console import Console
from rich.text import Text

from ros_diagnostics_exporter.http_client import UnreachableError
from ros_diagnostics_exporter.severity import OF_CAPABILITY_STATE, part_path
from ros_diagnostics_exporter.texts import one_line
from ros_diagnostics_tools.capability_losses import Known, Loss, find_losses
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

_INDENT = "  "


@click.command(epilog="Example: ros-diagnostics capabilities robot_3")
@click.argument("robot", required=False)
@with_output()
@with_servers
def command(servers: Servers, output: str, robot: str | None) -> None:
    """Show what ROBOT, or the fleet, can do, and which part that fails would lose what."""
    path = "/api/v1/capabilities"
    found = servers.exporter.ask(path, "capabilities", robot=robot)
    try:
        known = Known.of(found["capabilities"])
    except (KeyError, TypeError) as error:
        what = "is not a ROS diagnostics exporter of this version"
        raise UnreachableError(f"{servers.exporter.url}{path} {what}") from error
    losses = find_losses(known)
    if output == "json":
        print_json({**found, "losses": [each.as_json() for each in losses]})
    else:
        _print(found, losses)


def _print(answer: dict[str, Any], losses: list[Loss]) -> None:
    console = make_console()
    if not answer["capabilities"]:
        console.print(
            Text(f"fleet.yml has no capabilities for {one_line(answer['robot'] or 'the fleet')}.")
        )
        return
    needed = {
        inner["capability"]
        for each in answer["capabilities"]
        for inner in _inner(each["need"])
        if "capability" in inner
    }
    by_name = {each["capability"]: each for each in answer["capabilities"]}
    table = make_table("State", "What")
    for name, each in by_name.items():
        if name not in needed:
            for state, depth, text in _lines(each, by_name, 0):
                table.add_row(_chip(state), plain(_INDENT * depth + text))
    console.print(table)
    _print_losses(console, "If one more part fails", [each for each in losses if each.now])
    single = [each for each in losses if each.single]
    _print_losses(console, "Single points of failure", single, single=True)


def _chip(state: str) -> Text:
    """The state of a capability or a part in words and its colour; "" for an expression."""
    if not state:
        return Text("")
    like, words = OF_CAPABILITY_STATE[state]
    return chip(like, words.upper())


def _print_losses(
    console: Console, title: str, losses: list[Loss], *, single: bool = False
) -> None:
    console.print(Text(f"\n{title}:"))
    if not losses:
        console.print(Text("  nothing more is lost"))
        return
    table = make_table("Part", "Lost with it")
    for each in losses:
        lost = each.single if single else each.now
        table.add_row(*cells((f"  {part_path(each.part._asdict())}", ", ".join(lost))))
    console.print(table)


def _inner(need: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """All that an expression has, itself first."""
    yield need
    for each in need.get("of", ()):
        yield from _inner(each)


def _lines(
    capability: dict[str, Any], others: dict[str, dict[str, Any]], depth: int
) -> Iterator[tuple[str, int, str]]:
    """(state or "", depth, text) of a capability and of what it needs."""
    need = capability["need"]
    unless = {True: "", False: ", not needed now", None: ", perhaps not needed now"}
    text = f"{capability['capability']}: {_how_many(need)}{unless[capability['needed']]}"
    yield capability["state"], depth, text
    for each in need["of"]:
        yield from _lines_of(each, others, depth + 1)


def _lines_of(
    need: dict[str, Any], others: dict[str, dict[str, Any]], depth: int
) -> Iterator[tuple[str, int, str]]:
    if "of" in need:
        yield "", depth, _how_many(need)
        for each in need["of"]:
            yield from _lines_of(each, others, depth + 1)
    elif "part" in need:
        part = need["part"]
        mark = " (in maintenance)" if part["maintenance"] else ""
        yield part["state"], depth, f"{part_path(part)}{mark}"
    elif "capability" in need:
        yield from _lines(others[need["capability"]], others, depth)
    else:
        yield "unknown", depth, "what was never received"


def _how_many(need: dict[str, Any]) -> str:
    number = len(need["of"])
    counts_as = "" if need["degraded"] == "degraded" else f", degraded counts as {need['degraded']}"
    if need["k"] is None or need["k"] >= number:
        return f"{'needs this' if number == 1 else 'needs all of'}{counts_as}"
    return f"needs {need['k']} of these {number}{counts_as}"
