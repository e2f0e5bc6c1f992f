"""``ros-diagnostics check-config``: whether fleet.yml is right, and what of it matches nothing."""

from __future__ import annotations

import time
from pathlib import Path

import click

from ros_diagnostics_exporter.config.check import describe
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.config.shard import Shard, parse
from ros_diagnostics_exporter.fleet.unclaimed import unclaimed_from_json
from ros_diagnostics_exporter.fleet.unmatched import find_unmatched, known_from_json
from ros_diagnostics_exporter.fleet_texts import query_text
from ros_diagnostics_tools.capability_notes import capability_notes
from ros_diagnostics_tools.flag_types import PATH, Checked
from ros_diagnostics_tools.servers import Servers, with_servers
from ros_diagnostics_tools.terminal import print_json, with_output


@click.command(epilog="Example: ros-diagnostics check-config fleet.yml --live")
@click.argument("file", type=PATH, default=Path("fleet.yml"), metavar="[FLEET.YML]")
@click.option(
    "--live",
    is_flag=True,
    help="Also list what matches no robot, component or value that the running exporter knows, "
    "topics that no entry matches, components in no capability, and how its queries are answered.",
)
@click.option(
    "--shard",
    type=Checked(parse),
    metavar="NUMBER/COUNT",
    help="Only what the exporter with this --shard has of it.",
)
@with_output()
@with_servers
def command(servers: Servers, output: str, file: Path, shard: Shard | None, *, live: bool) -> None:
    """Check fleet.yml and the folders that it names; print a summary, or all errors."""
    fleet = load(file, shard)
    unmatched, unclaimed, queries, notes = None, None, None, None
    if live:
        running = servers.exporter.fleet()
        queries = running.get("queries", [])
        known = known_from_json(running)
        unmatched = list(map(str, find_unmatched(fleet, known, time.time())))
        unclaimed = list(map(str, unclaimed_from_json(fleet, running)))
        notes = capability_notes(fleet, known)
    if output == "json":
        warnings = list(fleet.warnings)
        found = {"fleet": fleet.name, "warnings": warnings, "unmatched": unmatched}
        print_json({**found, "unclaimed": unclaimed, "queries": queries, "notes": notes})
        return
    print(describe(fleet), end="")  # noqa: T201
    if unmatched is not None:
        print(f"unmatched ({len(unmatched)}):", *unmatched, sep="\n  ")  # noqa: T201
    if unclaimed:
        print(f"topics that no entry matches ({len(unclaimed)}):", *unclaimed, sep="\n  ")  # noqa: T201
    if notes:
        print(f"notes ({len(notes)}):", *notes, sep="\n  ")  # noqa: T201
    if queries:
        texts = map(query_text, queries)
        print(f"queries ({len(queries)}):", *texts, sep="\n  ")  # noqa: T201
