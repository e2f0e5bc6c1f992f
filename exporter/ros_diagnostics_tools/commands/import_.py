"""``ros-diagnostics import``: what another program knows of robots, as fleet.yml.

That is Autoware's diagnostic graph. It reads files and writes fleet.yml; each unit of the graph is
in the report, with what became of it or why it has no equivalent.
"""

from __future__ import annotations

import os
import sys
from collections import Counter
from pathlib import Path

import click

from ros_diagnostics_exporter.config.scalars import name
from ros_diagnostics_exporter.texts import printable
from ros_diagnostics_tools.autoware.convert import Imported, convert
from ros_diagnostics_tools.autoware.graph import GraphError, read
from ros_diagnostics_tools.errors import NO, NotDoneError, UnusableError
from ros_diagnostics_tools.flag_types import PATH, Checked
from ros_diagnostics_tools.terminal import print_json, with_output

NAME = Checked(name)
HEADER = """\
# Made by ros-diagnostics import autoware. Copy the profile into your fleet.yml, and give it to the
# robots that publish these diagnostics.
"""


def _packages(
    _ctx: click.Context, _param: click.Parameter, given: tuple[str, ...]
) -> dict[str, Path]:
    found = {}
    for each in given:
        package, equals, folder = each.partition("=")
        if not (package and equals and folder):
            raise click.BadParameter(f"{each!r} is not NAME=DIR")
        found[package] = Path(folder)
    return found


@click.group(epilog="Example: ros-diagnostics import autoware autoware-main.yaml")
def command() -> None:
    """Create a fleet.yml from another program's configuration: Autoware's diagnostic graph."""


@command.command(
    epilog="""\b
Example:
  ros-diagnostics import autoware autoware-main.yaml --output-file fleet.yml
  ros-diagnostics check-config fleet.yml

\b
Exit codes: 0 everything is in the output; 1 something is not, see the report; 2 a file is not
right, or no graph.
""",
)
@click.argument("files", nargs=-1, required=True, type=PATH, metavar="FILE...")
@click.option(
    "--output-file",
    "target",
    type=PATH,
    metavar="FILE",
    help="Write fleet.yml here, in place of printing it.",
)
@click.option("--force", is_flag=True, help="Overwrite the output file.")
@click.option("--fleet", type=NAME, default="autoware", help="Its name.")
@click.option("--profile", type=Checked(name), default="autoware", help="The profile's name.")
@click.option(
    "--unit",
    "paths",
    multiple=True,
    metavar="PATH",
    help="Import this unit and those on which it rests; repeatable.  [default: all]",
)
@click.option(
    "--package",
    "packages",
    callback=_packages,
    multiple=True,
    metavar="NAME=DIR",
    help="The share folder of a ROS package that $(find-pkg-share NAME) names; repeatable.  "
    "[default: those of $AMENT_PREFIX_PATH]",
)
@with_output()
def autoware(
    *,
    files: tuple[Path, ...],
    target: Path | None,
    force: bool,
    fleet: str,
    profile: str,
    paths: tuple[str, ...],
    packages: dict[str, Path],
    output: str,
) -> int:
    """Translate Autoware's diagnostic graph to capabilities of a profile in fleet.yml.

    FILE is a file of autoware_diagnostic_graph_aggregator, such as autoware-main.yaml; those that
    it includes are read, too. What became of each unit is printed to stderr.
    """
    try:
        made = convert(read(files, {**_sourced(), **packages}), fleet, profile, paths)
    except GraphError as error:
        raise UnusableError(str(error)) from error
    if target is not None:
        if target.exists() and not force:
            raise NotDoneError(f"{target} exists; choose another, or overwrite it with --force")
        target.write_text(HEADER + made.text, encoding="utf-8")
    _print(made, output, is_written=target is not None)
    return 0 if all(each.is_whole for each in made.rows) else NO


def _sourced() -> dict[str, Path]:
    """The share folders of the packages of the workspaces that are sourced; the first wins."""
    found: dict[str, Path] = {}
    for prefix in filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        for each in Path(prefix, "share").glob("*"):
            found.setdefault(each.name, each)
    return found


def _print(made: Imported, output: str, *, is_written: bool) -> None:
    if output == "json":
        print_json({"fleet": made.content, "report": [each._asdict() for each in made.rows]})
        return
    if not is_written:
        print(HEADER + made.text, end="")  # noqa: T201
    for each in made.rows:
        mark = "  " if each.is_whole else "! "
        print(printable(f"{mark}{each.where} ({each.type}): {each.text}"), file=sys.stderr)  # noqa: T201
    count = Counter(each.is_whole for each in made.rows)
    profile = next(iter(made.content["profiles"].values()))
    print(  # noqa: T201
        f"{count.total()} units and edits: {len(profile.get('capabilities', ()))} capabilities; "
        f"{count[False]} not imported, or not with all that they say (!)",
        file=sys.stderr,
    )
