"""``ros-diagnostics import``: what another program knows of robots, as fleet.yml."""

from __future__ import annotations

import click

from ros_diagnostics_tools.commands import import_autoware


@click.group(epilog="Example: ros-diagnostics import autoware autoware-main.yaml")
def command() -> None:
    """Create a fleet.yml from another program's configuration: Autoware's diagnostic graph."""


command.add_command(import_autoware.command)
