"""Asks a running server of ours: the companions' way in, with the standard library alone.

A Nagios check is a new process every time: what is imported here is paid at every check.
"""

from __future__ import annotations

import argparse
import base64
import contextlib
import http.client
import json
import math
import ssl
import time
import urllib.error
import urllib.parse
import urllib.request
from pathlib import Path
from typing import Any

DEFAULT_URL = "http://127.0.0.1:9877"
LIMIT = 256 * 1024 * 1024  # bytes of an answer; a fleet of 1,000 robots has some four million
PART = 64 * 1024  # bytes read at once


class UnreachableError(Exception):
    """The server gave no answer that can be used; the text says why and where."""


def add_arguments(
    parser: argparse.ArgumentParser, server: str = "exporter", url: str = DEFAULT_URL
) -> None:
    """The flags that say where the server is and how it wants to be asked."""
    where = parser.add_argument_group(server)
    where.add_argument("-u", "--url", default=url, help=f"of the {server} (default: %(default)s)")
    where.add_argument("--user", help="for basic auth")
    where.add_argument(
        "--password-file", type=Path, metavar="FILE", help="the user's password, in one line"
    )
    where.add_argument("--ca-file", type=Path, metavar="FILE", help=f"CA of the {server}'s TLS")
    where.add_argument(
        "--cert-file", type=Path, metavar="FILE", help="own certificate, with --key-file"
    )
    where.add_argument("--key-file", type=Path, metavar="FILE", help="key of --cert-file")
    where.add_argument(
        "-t",
        "--timeout",
        type=seconds,
        default=10.0,
        metavar="SECONDS",
        help="how long to wait for an answer (default: %(default)g)",
    )


def seconds(text: str) -> float:
    """A flag's time to wait: seconds above 0.

    Raises:
        argparse.ArgumentTypeError: It is none.
    """
    with contextlib.suppress(ValueError):
        if 0 < (number := float(text)) < math.inf:
            return number
    raise argparse.ArgumentTypeError(f"{text!r} is no time to wait; give seconds, as 10 or 0.5")


def ask_fleet(options: argparse.Namespace, robots: tuple[str, ...] = ()) -> dict[str, Any]:
    """The fleet as /api/v1/fleet answers it, or of it the named ``robots``.

    Raises:
        UnreachableError: No answer, or none that is a fleet.
    """
    query = urllib.parse.urlencode([("robot", name) for name in robots])
    path = "/api/v1/fleet" + (f"?{query}" if query else "")
    fleet = ask(options, path)
    if not isinstance(fleet, dict) or "robots" not in fleet:
        raise UnreachableError(f"{options.url}{path} is not a ROS diagnostics exporter")
    return fleet


def ask(
    options: argparse.Namespace,
    path: str,
    body: Any = None,
    *,
    method: str = "",
    limit: int = LIMIT,
) -> Any:
    """The JSON that the server answers; a ``body`` is posted as JSON. None for an empty answer.

    Raises:
        UnreachableError: No answer, a refusal, more than ``limit`` bytes, or no JSON.
    """
    url = options.url.rstrip("/") + path
    content = None if body is None else json.dumps(body).encode()
    try:
        headers = _login(options) | ({} if body is None else {"Content-Type": "application/json"})
        opener = urllib.request.build_opener(*_handlers(options))
        request = urllib.request.Request(  # noqa: S310 - the user's
            url, content, headers, method=method or None
        )
        with opener.open(request, timeout=options.timeout) as answer:
            text = _read(answer, limit, time.monotonic() + options.timeout)
            return json.loads(text) if text else None
    except urllib.error.HTTPError as error:
        raise UnreachableError(f"{url} answered {error.code} {error.reason}") from error
    except (OSError, ValueError, RecursionError, http.client.HTTPException) as error:
        # URLError is an OSError, bad JSON a ValueError, JSON nested without end a RecursionError.
        raise UnreachableError(f"{url}: {getattr(error, 'reason', None) or error}") from error


def _read(answer: http.client.HTTPResponse, limit: int, deadline: float) -> bytes:
    """All of the answer: the socket's own timeout lets through what comes byte by byte."""
    parts: list[bytes] = []
    size = 0
    while part := answer.read1(PART):
        parts.append(part)
        size += len(part)
        if size > limit:
            raise ValueError(f"answered more than {limit} bytes")
        if time.monotonic() > deadline:
            raise TimeoutError("timed out")
    if answer.length:  # what is missing; only read() would have noticed
        raise http.client.IncompleteRead(b"".join(parts), answer.length)
    return b"".join(parts)


def _handlers(options: argparse.Namespace) -> list[urllib.request.BaseHandler]:
    # No proxies: the server is near, and those of the environment lead elsewhere.
    handlers: list[urllib.request.BaseHandler] = [urllib.request.ProxyHandler({})]
    if options.url.startswith("https:"):  # reading all CAs costs a quarter of a whole check
        handlers.append(urllib.request.HTTPSHandler(context=_trust(options)))
    return handlers


def _trust(options: argparse.Namespace) -> ssl.SSLContext:
    try:
        context = ssl.create_default_context(cafile=options.ca_file)
        if options.cert_file is not None:
            context.load_cert_chain(options.cert_file, options.key_file)
    except OSError as error:  # which does not name the file
        files = filter(None, (options.ca_file, options.cert_file, options.key_file))
        raise UnreachableError(f"{', '.join(map(str, files))}: {error}") from error
    return context


def _login(options: argparse.Namespace) -> dict[str, str]:
    if options.user is None:
        return {}
    if options.password_file is None:
        raise UnreachableError("--user needs --password-file")
    password = options.password_file.read_text("utf-8").rstrip("\r\n")
    coded = base64.b64encode(f"{options.user}:{password}".encode()).decode()
    return {"Authorization": f"Basic {coded}"}
