"""The flags of a command that connects to a server, and the client they describe."""

from __future__ import annotations

import argparse
import contextlib
import math
from pathlib import Path

from ros_diagnostics_exporter.http_client import Client

EXPORTER_URL = "http://127.0.0.1:9877"
INTERRUPTED = 130  # exit code after Ctrl-C, as shells have it


def add_arguments(
    parser: argparse.ArgumentParser, server: str = "exporter", url: str = EXPORTER_URL
) -> None:
    """Add the flags for the server's URL, login, TLS and timeout."""
    group = parser.add_argument_group(server)
    group.add_argument("-u", "--url", default=url, help=f"of the {server} (default: %(default)s)")
    group.add_argument("--user", help="for basic auth")
    group.add_argument(
        "--password-file", type=Path, metavar="FILE", help="the user's password, in one line"
    )
    group.add_argument(
        "--ca-file", type=Path, metavar="FILE", help=f"CA of the {server}'s certificate"
    )
    group.add_argument(
        "--cert-file", type=Path, metavar="FILE", help="client certificate, with --key-file"
    )
    group.add_argument("--key-file", type=Path, metavar="FILE", help="key of --cert-file")
    group.add_argument(
        "-t",
        "--timeout",
        type=seconds,
        default=10.0,
        metavar="SECONDS",
        help="how long to wait for a response (default: %(default)g)",
    )


def seconds(text: str) -> float:
    """The value of a flag that takes seconds, above 0.

    Raises:
        argparse.ArgumentTypeError: It is not such a number.
    """
    with contextlib.suppress(ValueError):
        if 0 < (number := float(text)) < math.inf:
            return number
    raise argparse.ArgumentTypeError(f"{text!r} is not a duration; give seconds, as 10 or 0.5")


def make_client(options: argparse.Namespace) -> Client:
    """The client that the parsed flags describe."""
    return Client(
        options.url,
        timeout=options.timeout,
        user=options.user,
        password_file=options.password_file,
        ca_file=options.ca_file,
        cert_file=options.cert_file,
        key_file=options.key_file,
    )
