"""``ros-diagnostics mcp``: the fleet for programs that speak the Model Context Protocol."""

from __future__ import annotations

import sys

import click

from ros_diagnostics_exporter.extras import install_command
from ros_diagnostics_tools.errors import NotDoneError
from ros_diagnostics_tools.flag_types import Address
from ros_diagnostics_tools.servers import Servers, with_servers

_LOGINS = {"user", "password_file", "cert_file", "key_file"}


@click.command(epilog="Example, as a program's server: ros-diagnostics mcp --url http://hall:9877")
@click.option(
    "--listen",
    type=Address(),
    help="Answer over HTTP at /mcp of this address, in place of stdin and stdout. Each client logs "
    "in as a user of the exporter.",
)
@with_servers
def command(servers: Servers, listen: tuple[str, int] | None) -> None:
    """Answer questions about the fleet over stdin and stdout, for an assistant; read only."""
    try:
        from ros_diagnostics_tools.ask import make_server, serve_http  # noqa: PLC0415 - an extra
    except ModuleNotFoundError as error:
        raise NotDoneError(f"mcp needs its library: {install_command('mcp')}") from error
    about = f"answers about {servers.exporter.url}"
    if listen is None:
        sys.stderr.write(f"{about} on stdin and stdout\n")
        make_server(servers.exporter).run()
        return
    if given := sorted(_LOGINS & servers.options.keys()):
        # Else everybody who reaches the port would have the rights of that user.
        flag = f"--{given[0].replace('_', '-')}"
        raise click.UsageError(f"leave out {flag}: with --listen each client logs in itself")
    host, port = listen
    sys.stderr.write(f"{about} on http://{host}:{port}/mcp\n")
    try:
        serve_http(servers.exporter, host, port)
    except OSError as error:
        what = f"cannot listen on {host}:{port}: {error.strerror}"
        raise NotDoneError(f"{what}; choose another --listen") from error
