"""The exporter's flags, named as in Prometheus' own exporters, and its --help."""

from __future__ import annotations

import argparse
import os
import re
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from ros_diagnostics_exporter import __version__, durations
from ros_diagnostics_exporter.config import shard
from ros_diagnostics_exporter.config.shard import Shard
from ros_diagnostics_exporter.logs import FORMATS

DEFAULT_ADDRESS = ":9877"
DATABASE = "exporter.db"
NO_STORAGE = "none"
_SIZE = re.compile(r"([0-9]+)(B|KB|MB|GB)", re.ASCII)
_UNITS = {"B": 1, "KB": 1 << 10, "MB": 1 << 20, "GB": 1 << 30}

EPILOG = """\
The smallest fleet.yml finds every robot that publishes <name>/diagnostics_agg in DDS domain 0:

  fleet: warehouse
  discovery:
    - {topic: "/{robot}/diagnostics_agg", domain_ids: [0]}

Check it:      ros-diagnostics-exporter --config.file fleet.yml --config.check
Run it:        ros-diagnostics-exporter --config.file fleet.yml
See it:        http://localhost:9877/ in a browser, ros-diagnostics status in a terminal
Scrape it:     scrape_configs: [{job_name: ros-diagnostics, honor_labels: true,
                 static_configs: [{targets: ["localhost:9877"]}]}]
Keep Nagios:   check_ros_diagnostics -H robot_1 -N motor

The configuration is reloaded when its files change and on SIGHUP.
Exit codes: 0 stopped by SIGTERM or SIGINT, 1 cannot run (port in use, no ROS), 2 invalid flag or
configuration file.
"""


def parse(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """Parse the command line, or ``arguments``; exits with code 2 if they are invalid."""
    parser = argparse.ArgumentParser(
        prog="ros-diagnostics-exporter",
        description="Exports the diagnostics of a fleet of ROS 2 robots to Prometheus.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    _add_fleet(parser)
    _add_storage(parser)
    _add_web(parser)
    _add_alertmanager(parser)
    _add_prometheus(parser)
    _add_logs(parser)
    options = parser.parse_args(arguments)
    if options.alertmanager_user and not options.alertmanager_password_file:
        parser.error("--alertmanager.user needs --alertmanager.password-file")
    if options.prometheus_user and not options.prometheus_password_file:
        parser.error("--prometheus.user needs --prometheus.password-file")
    if options.prometheus_user and options.prometheus_bearer_token_file:
        parser.error("give --prometheus.user or --prometheus.bearer-token-file, not both")
    if options.web_enable_actions and not options.alertmanager_url:
        parser.error("--web.enable-actions needs --alertmanager.url: acknowledgements are there")
    if options.shard and not (options.alertmanager_url and options.prometheus_url):
        parser.error(
            "--shard needs --alertmanager.url and --prometheus.url: exporters learn there which "
            "faults their robots had before, and what the robots of the others have in common"
        )
    if options.web_systemd_socket and options.web_listen_address:
        parser.error("give --web.listen-address or --web.systemd-socket, not both")
    return options


_FILE: dict[str, Any] = {"type": Path, "metavar": "FILE"}


def _section(parser: argparse.ArgumentParser, title: str) -> Callable[..., None]:
    """A function that adds a flag: its name, what it means, and argparse's settings.

    ``--a.b-c`` is the attribute ``a_b_c``.
    """
    group = parser.add_argument_group(title)

    def add(flag: str, meaning: str, **settings: Any) -> None:
        attribute = re.sub("[.-]", "_", flag.removeprefix("--"))
        group.add_argument(flag, dest=attribute, help=meaning, **settings)

    return add


def _add_fleet(parser: argparse.ArgumentParser) -> None:
    add = _section(parser, "fleet")
    add(
        "--config.file",
        "the fleet's configuration: robots, discovery, profiles (default: %(default)s)",
        default=Path("fleet.yml"),
        **_FILE,
    )
    add(
        "--shard",
        "serve one part of the robots, such as 2/4 for the second of four exporters that share "
        "one fleet.yml; needs --alertmanager.url and --prometheus.url (default: all robots)",
        type=_shard,
        metavar="NUMBER/COUNT",
    )
    add(
        "--config.check",
        "check the configuration files, print a summary or all errors, and exit",
        action="store_true",
    )


def _add_storage(parser: argparse.ArgumentParser) -> None:
    add = _section(parser, "storage")
    add(
        "--storage.path",
        "SQLite database that keeps the state of the robots, faults and events across "
        f"restarts; {NO_STORAGE}: keep nothing (default: {DATABASE} in systemd's "
        f"$STATE_DIRECTORY, else data/{DATABASE})",
        type=_storage_path,
        default=_default_storage_path(),
        metavar="FILE",
    )
    add(
        "--storage.retention.time",
        "how long events are kept (default: %(default)s)",
        type=_duration,
        default="90d",
        metavar="DURATION",
    )
    add(
        "--storage.retention.size",
        "size of the database above which the oldest events are deleted; units B, KB, MB, "
        "GB (default: %(default)s)",
        type=_size,
        default="256MB",
        metavar="SIZE",
    )


def _add_web(parser: argparse.ArgumentParser) -> None:
    add = _section(parser, "web")
    add(
        "--web.listen-address",
        "address to listen on, repeatable; IPv6 as [::1]:9877; without a host all interfaces "
        f"(default: {DEFAULT_ADDRESS})",
        action="append",
        metavar="HOST:PORT",
    )
    add(
        "--web.systemd-socket",
        "listen on the sockets that systemd passes, in place of --web.listen-address",
        action="store_true",
    )
    add(
        "--web.telemetry-path",
        "path under which to expose metrics (default: %(default)s)",
        type=_path,
        default="/metrics",
        metavar="PATH",
    )
    add(
        "--web.config.file",
        "TLS, basic authentication and rate limit, in the format of Prometheus' "
        "exporter-toolkit; reloaded when it changes",
        **_FILE,
    )
    add(
        "--web.enable-lifecycle",
        "enable POST /-/reload, and POST /-/forget for everybody; allow only trusted "
        "clients to reach the exporter then",
        action="store_true",
    )
    add(
        "--web.enable-actions",
        "show forms on the pages; a person who has logged in (basic_auth_users) can acknowledge "
        "a fault or plan a downtime, at --alertmanager.url",
        action="store_true",
    )
    add(
        "--grafana.url",
        "address of the Grafana with the dashboards, as people open it: the pages of the fleet, of "
        "robots and of faults link them (default: no link)",
        type=_page,
        metavar="URL",
    )


def _add_alertmanager(parser: argparse.ArgumentParser) -> None:
    add = _section(parser, "Alertmanager, for acknowledgements and downtimes")
    meaning = (
        "read this fleet's acknowledgements and downtimes from it every few seconds, and which "
        "faults fire, in case the database is lost; repeatable for a cluster: the first that "
        "responds is used (default: none)"
    )
    url = partial(_server, example="http://localhost:9093", flags="--alertmanager")
    add("--alertmanager.url", meaning, action="append", type=url, metavar="URL")
    _add_login(add, "--alertmanager")


def _add_prometheus(parser: argparse.ArgumentParser) -> None:
    add = _section(parser, "Prometheus, for the queries of fleet.yml")
    meaning = (
        "ask it the queries of fleet.yml; the answers become components of the robots "
        "(default: none)"
    )
    url = partial(_server, example="http://localhost:9090", flags="--prometheus")
    add("--prometheus.url", meaning, type=url, metavar="URL")
    meaning = "a file with a bearer token in one line, in place of user and password"
    add("--prometheus.bearer-token-file", meaning, **_FILE)
    _add_login(add, "--prometheus")


def _add_login(add: Callable[..., None], server: str) -> None:
    add(f"{server}.user", "for basic auth", metavar="NAME")
    add(f"{server}.password-file", "a file with the user's password in one line", **_FILE)
    add(f"{server}.ca-file", "CA of its certificate (default: the system's)", **_FILE)


def _add_logs(parser: argparse.ArgumentParser) -> None:
    add = _section(parser, "log (standard error)")
    add(
        "--log.level",
        "lowest level to log (default: %(default)s)",
        choices=("debug", "info", "warning", "error"),
        default="info",
    )
    add(
        "--log.format",
        'json also wraps lines that the ROS middleware writes itself, with logger "output" '
        "(default: %(default)s)",
        choices=FORMATS,
        default="logfmt",
    )


def _default_storage_path() -> Path:
    # systemd separates several folders by colons.
    folder = os.environ.get("STATE_DIRECTORY", "").split(":")[0] or "data"
    return Path(folder) / DATABASE


def _storage_path(text: str) -> Path | None:
    if not text:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not the name of a file; with {NO_STORAGE} nothing is stored"
        )
    return None if text == NO_STORAGE else Path(text)


def _shard(text: str) -> Shard:
    try:
        return shard.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from error


def _duration(text: str) -> float:
    try:
        return durations.parse(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(f"{error} such as 90d or 12h") from error


def _size(text: str) -> int:
    match = _SIZE.fullmatch(text)
    if match is None:
        raise argparse.ArgumentTypeError(f"{text!r} is not a size such as 256MB")
    return int(match[1]) * _UNITS[match[2]]


def _server(text: str, example: str, flags: str) -> str:
    if "@" in text:  # first: what follows prints the text
        raise argparse.ArgumentTypeError(
            f"every user of the machine can see flags: give the user as {flags}.user and the "
            f"password in {flags}.password-file"
        )
    return _url(text, example)


def _page(text: str) -> str:
    if "@" in text:
        raise argparse.ArgumentTypeError(
            "give it without a user: everybody who opens a page sees it"
        )
    return _url(text, "http://localhost:3000")


def _url(text: str, example: str) -> str:
    found = urlsplit(text)
    if found.scheme not in {"http", "https"} or not found.hostname or found.query or found.fragment:
        raise argparse.ArgumentTypeError(f"{text!r} is not a URL such as {example}")
    return text


def _path(text: str) -> str:
    if not text.startswith("/") or set(text) & set("{}?#"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a path such as /metrics")
    return text
