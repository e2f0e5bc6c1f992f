"""Which exporter and Alertmanager a subcommand asks: flags, or a file with named exporters.

The file is ``ros-diagnostics.yml`` in ``$XDG_CONFIG_HOME`` or ``~/.config``; its first exporter is
the one that is asked without ``--url``:

    exporters:
      north: {url: "https://north:9877", alertmanager: "https://north:9093", ca_file: north.crt}
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Any, NamedTuple

import click
import yaml

from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.silences import Kind, valid
from ros_diagnostics_tools.flag_types import PATH
from ros_diagnostics_tools.times import Duration

EXPORTER_URL = "http://127.0.0.1:9877"
ALERTMANAGER_URL = "http://127.0.0.1:9093"
FILE = "ros-diagnostics.yml"
_URLS = ("url", "alertmanager")
_PATHS = ("password_file", "ca_file", "cert_file", "key_file")
_KEYS = (*_URLS, "user", *_PATHS)


class Servers(NamedTuple):
    """The clients of one site; ``options`` are those of a client of another server."""

    exporter: Client
    alertmanager: Client
    options: dict[str, Any]


def listed(alertmanager: Client, kind: type[Kind], path: str) -> list[Kind]:
    """The alerts or silences that Alertmanager has at a path.

    Raises:
        UnreachableError: It does not answer, or is none.
    """
    try:
        return valid(kind, alertmanager.get(path))
    except ValueError as error:
        raise UnreachableError(f"{alertmanager.url} is not an Alertmanager") from error


def with_servers(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the flags for the servers; the function gets them as ``servers``."""

    @wraps(function)
    def run(**given: Any) -> Any:
        flags = {name: given.pop(name) for name in (*_KEYS, "timeout")}
        return function(servers=_servers(flags), **given)

    options = (
        click.option(
            "-u",
            "--url",
            metavar="URL|NAME",
            help=f"The exporter, or its name in ~/.config/{FILE}.  [default: {EXPORTER_URL}]",
        ),
        click.option(
            "--alertmanager", metavar="URL", help=f"Alertmanager.  [default: {ALERTMANAGER_URL}]"
        ),
        click.option("--user", metavar="NAME", help="For basic auth at these servers."),
        click.option("--password-file", type=PATH, help="The user's password, in one line."),
        click.option("--ca-file", type=PATH, help="CA of the servers' certificates."),
        click.option("--cert-file", type=PATH, help="Client certificate, with --key-file."),
        click.option("--key-file", type=PATH, help="Key of --cert-file."),
        click.option(
            "-t",
            "--timeout",
            type=Duration(),
            default="10s",
            help="How long to wait for a response.",
        ),
    )
    decorated: Callable[..., Any] = run
    for option in reversed(options):
        decorated = option(decorated)
    return decorated


def _servers(flags: dict[str, Any]) -> Servers:
    named = _named(flags["url"])
    if named:
        flags = {**flags, "url": named["url"]}
    known = {**named, **{key: value for key, value in flags.items() if value}}
    for key in known.keys() & set(_PATHS):
        if not os.access(known[key], os.R_OK):
            raise click.UsageError(f"{key}: {known[key]}: no such file, or it cannot be read")
    options = {key: value for key, value in known.items() if key not in _URLS}
    return Servers(
        Client(known.get("url", EXPORTER_URL), **options),
        Client(known.get("alertmanager", ALERTMANAGER_URL), **options),
        options,
    )


def _named(url: str | None) -> dict[str, Any]:
    """What the file says of the exporter; of the first one if there is no --url."""
    if url is not None and "://" in url:
        return {}
    path = Path(os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config") / FILE
    if url is None and not path.exists():
        return {}
    exporters = _read(path)
    name = next(iter(exporters)) if url is None else url
    if name not in exporters:
        raise click.UsageError(
            f"--url {name}: neither a URL such as {EXPORTER_URL} nor one of the exporters in "
            f"{path}: {', '.join(exporters)}"
        )
    entry = exporters[name]
    files = {key: path.parent / entry[key] for key in _PATHS if key in entry}
    return {**entry, **files}


def _read(path: Path) -> dict[str, dict[str, str]]:
    try:
        found = yaml.safe_load(path.read_text(encoding="utf-8"))["exporters"]
        for name, entry in found.items():
            if unknown := entry.keys() - set(_KEYS):
                raise click.UsageError(
                    f"{path}: exporters: {name}: {min(unknown)}: no such key; there are "
                    f"{', '.join(_KEYS)}"
                )
            if "url" not in entry or not all(isinstance(each, str) for each in entry.values()):
                raise click.UsageError(f"{path}: exporters: {name}: needs url; all values are text")
    except OSError as error:
        raise click.UsageError(f"{path}: {error.strerror or error}") from error
    except (yaml.YAMLError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise click.UsageError(
            f"{path} is no list of exporters; write exporters: {{NAME: {{url: {EXPORTER_URL}}}}}"
        ) from error
    if not found:
        raise click.UsageError(f"{path}: exporters: names no exporter")
    return {str(name): dict(entry) for name, entry in found.items()}
