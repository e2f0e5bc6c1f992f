"""``ros-diagnostics nagios``: for sites that come from Nagios."""

from __future__ import annotations

import click

from ros_diagnostics_tools.commands import nagios_compare, nagios_import


@click.group(epilog="Example: ros-diagnostics nagios import /etc/nagios4/nagios.cfg")
def command() -> None:
    """Migrate from Nagios: import its configuration, compare its notifications with these here."""


command.add_command(nagios_import.command)
command.add_command(nagios_compare.command)
