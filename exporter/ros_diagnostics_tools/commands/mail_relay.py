"""``ros-diagnostics mail-relay``: attaches recordings to mails of Alertmanager."""

from __future__ import annotations

import logging
import signal
import threading
from importlib import import_module
from typing import Any

import click

from ros_diagnostics_exporter.extras import install_command
from ros_diagnostics_tools.errors import NotDoneError
from ros_diagnostics_tools.flag_types import PATH, Address, Size
from ros_diagnostics_tools.mail_relay import Relay, Smarthost, from_exporter
from ros_diagnostics_tools.servers import Servers, with_servers


@click.command(
    epilog="""\b
In alertmanager.yml:
  global: {smtp_smarthost: "localhost:2525", smtp_require_tls: false}

\b
Example: ros-diagnostics mail-relay --smarthost mail.example.org:587 --starttls
"""
)
@click.option(
    "--listen",
    type=Address(),
    default="127.0.0.1:2525",
    help="The address that Alertmanager sends to. Anyone who can reach it can send mail.",
)
@click.option("--smarthost", type=Address(), default="localhost:25", help="The mail server.")
@click.option("--starttls", is_flag=True, help="Encrypt the connection to the mail server.")
@click.option(
    "--smarthost-ca-file",
    type=PATH,
    help="CA of the mail server's certificate.  [default: this machine's]",
)
@click.option("--smarthost-user", metavar="NAME", help="Log in at the mail server.")
@click.option(
    "--smarthost-password-file", type=PATH, help="The password at the mail server, in one line."
)
@click.option(
    "--attach-below",
    type=Size(),
    default="100kB",
    help="Attach the recordings of a mail only if all of them together are at most this large.",
)
@with_servers
def command(servers: Servers, **given: Any) -> None:
    """Pass Alertmanager's mails on to the mail server, each with the recordings of its faults.

    A recording has everything that the robot published in a minute. Everybody to whom the mail is
    sent or forwarded can read it.
    """
    try:
        import_module("aiosmtpd.controller")  # an extra
    except ImportError as error:
        raise NotDoneError(f"mail-relay needs aiosmtpd: {install_command('mail')}") from error
    from ros_diagnostics_tools.mail_server import Server  # noqa: PLC0415 - needs it

    user, password_file = given["smarthost_user"], given["smarthost_password_file"]
    if (user is None) != (password_file is None):
        raise click.UsageError(
            "give both --smarthost-user and --smarthost-password-file, or neither"
        )
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(message)s")
    host, port = given["smarthost"]
    ca_file = given["smarthost_ca_file"]
    smarthost = Smarthost(host, port, given["starttls"], user, password_file, ca_file)
    if user is not None and not smarthost.hides_password:
        raise click.UsageError(
            f"a login at {host} needs --starttls, or anyone on the way reads the password"
        )
    most = given["attach_below"]
    relay = Relay(smarthost, from_exporter(servers.exporter, most), most)
    host, port = given["listen"]
    server = Server(relay, host, port)
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    server.start()
    logging.getLogger(__name__).info("listening on %s:%d", host, port)
    stop.wait()
    server.stop()
