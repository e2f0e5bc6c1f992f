"""``ros-diagnostics mcp``: the fleet for programs that speak the Model Context Protocol."""

from __future__ import annotations

import sys

import click

from ros_diagnostics_exporter.extras import install_command
from ros_diagnostics_tools.errors import NotDoneError
from ros_diagnostics_tools.servers import Servers, with_servers


@click.command(epilog="Example, as a program's server: ros-diagnostics mcp --url http://hall:9877")
@with_servers
def command(servers: Servers) -> None:
    """Answer questions about the fleet over stdin and stdout, for an assistant; read only."""
    try:
        from ros_diagnostics_tools.ask import make_server  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        raise NotDoneError(f"mcp needs its library: {install_command('mcp')}") from error
    sys.stderr.write(f"answers about {servers.exporter.url} on stdin and stdout\n")
    make_server(servers.exporter).run()
