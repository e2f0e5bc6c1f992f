"""``ros-diagnostics nagios import``: Nagios' object files -> fleet.yml, routes, and a report.

For sites that come from Nagios. It writes files and changes nothing else; each line of Nagios'
files is in the report, with where it went or what to do.
"""

from __future__ import annotations

import sys
from pathlib import Path

import click

from ros_diagnostics_exporter.config.scalars import name, time_zone
from ros_diagnostics_tools.errors import NO, NotDoneError
from ros_diagnostics_tools.flag_types import PATH, Checked
from ros_diagnostics_tools.nagios.importer.convert import (
    REPORT,
    TITLES,
    Converted,
    ImportOptions,
    convert,
)
from ros_diagnostics_tools.nagios.importer.files import NagiosError
from ros_diagnostics_tools.nagios.importer.ledger import Effect
from ros_diagnostics_tools.terminal import print_json, with_output


@click.command(
    "import",
    epilog="""\b
Example:
  ros-diagnostics nagios import /etc/nagios4/nagios.cfg --to new
  ros-diagnostics check-config new/fleet.yml
""",
)
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="FILE...")
@click.option(
    "--to",
    "folder",
    type=PATH,
    default=Path("from-nagios"),
    metavar="DIR",
    help="The folder to write to.",
)
@click.option(
    "--into",
    type=PATH,
    metavar="FILE",
    help="An alertmanager.yml: write it with the routes in it, in place of the routes alone.",
)
@click.option("--force", is_flag=True, help="Overwrite the files that are there.")
@click.option("--fleet", type=Checked(name), default="nagios", help="The fleet's name.")
@click.option(
    "--plugin",
    multiple=True,
    metavar="NAME",
    help="A command or program that checks robots, with * for anything; repeatable.",
)
@click.option(
    "--time-zone",
    type=Checked(time_zone),
    metavar="ZONE",
    help="The time zone of Nagios' host, for its timeperiods.  [default: use_timezone of "
    "nagios.cfg, else UTC]",
)
@with_output()
def command(
    *,
    files: tuple[Path, ...],
    folder: Path,
    into: Path | None,
    fleet: str,
    plugin: tuple[str, ...],
    time_zone: str | None,
    output: str,
    force: bool,
) -> int:
    """Translate Nagios' object files to fleet.yml and routes for Alertmanager.

    FILE is nagios.cfg, an object file, or a folder of object files. A robot is a host with a
    service whose plug-in has ros, robot or diagnostics in its file name; --plugin names another.
    Exit code 1 where report.txt names something of which nobody is notified any more.
    """
    try:
        converted = convert(list(files), ImportOptions(fleet, plugin, time_zone, into))
    except NagiosError as error:
        raise NotDoneError(str(error)) from error
    _write(converted, folder, force=force)
    lost = {part: len(converted.ledger.lost_in(part)) for part in Effect}
    if output == "json":
        counts = {part.name.lower(): count for part, count in lost.items()}
        found = {"robots": converted.robots, "files": [*converted.texts]}
        print_json({**found, "not_translated": sum(lost.values()), **counts})
    else:
        counted = ", ".join(f"{lost[part]} {title.lower()}" for part, title in TITLES.items())
        print(  # noqa: T201
            f"{converted.robots} robot{'' if converted.robots == 1 else 's'}; "
            f"{', '.join(converted.texts)} written to {folder}/; "
            f"lines without a full equivalent: {counted}: see {REPORT}"
        )
    if not converted.robots:
        commands = ", ".join(converted.commands) or "none"
        print(  # noqa: T201
            "ros-diagnostics: no service checks a robot: name the ROS plug-in with --plugin, by "
            f"its command or its file (commands of services: {commands})",
            file=sys.stderr,
        )
    return NO if lost[Effect.NO_LONGER] else 0


def _write(converted: Converted, folder: Path, *, force: bool) -> None:
    there = [each for each in converted.texts if (folder / each).exists()]
    if there and not force:
        raise NotDoneError(
            f"{folder} has {', '.join(there)} already; choose another --to, or overwrite them "
            "with --force"
        )
    folder.mkdir(parents=True, exist_ok=True)
    for each, text in converted.texts.items():
        (folder / each).parent.mkdir(exist_ok=True)
        (folder / each).write_text(text, encoding="utf-8")
