"""The exporter's flags, in the style of Prometheus' exporters, and a --help that teaches."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlsplit

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.logs import FORMATS

DEFAULT_ADDRESS = ":9877"

EPILOG = """\
The smallest fleet.yml finds every robot that publishes <name>/diagnostics_agg in DDS domain 0:

  fleet: warehouse
  discovery:
    - {topic: "/{robot}/diagnostics_agg", domain_ids: [0]}

Look at it:    ros-diagnostics-exporter --config.file fleet.yml --config.check
Run it:        ros-diagnostics-exporter --config.file fleet.yml
See it:        http://localhost:9877/ in a browser, ros-diagnostics-status in a terminal
Scrape it:     scrape_configs: [{job_name: ros-diagnostics, honor_labels: true,
                 static_configs: [{targets: ["localhost:9877"], labels: {fleet: warehouse}}]}]
Keep Nagios:   check_ros_diagnostics -H robot_1 -N motor

Exit codes: 0 ended by SIGTERM or SIGINT, 1 it cannot run (port taken, no ROS), 2 a flag or a file
is wrong. SIGHUP reads fleet.yml again, as does a change of the file.
"""


def parse(arguments: Sequence[str] | None = None) -> argparse.Namespace:
    """The flags of the command line, or of ``arguments``; ends the process if they are wrong."""
    parser = argparse.ArgumentParser(
        prog="ros-diagnostics-exporter",
        description="Exports the diagnostics of a fleet of ROS 2 robots to Prometheus.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    _add_fleet(parser)
    _add_web(parser)
    _add_alertmanager(parser)
    _add_logs(parser)
    options = parser.parse_args(arguments)
    if options.alertmanager_user and not options.alertmanager_password_file:
        parser.error("--alertmanager.user needs --alertmanager.password-file")
    return options


def _add_fleet(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("fleet")
    group.add_argument(
        "--config.file",
        dest="config_file",
        type=Path,
        default=Path("fleet.yml"),
        metavar="FILE",
        help="the fleet: robots, discovery, profiles (default: %(default)s)",
    )
    group.add_argument(
        "--config.check",
        dest="config_check",
        action="store_true",
        help="say what was understood of the config, or all that is wrong with it, and end",
    )
    group.add_argument(
        "--storage.path",
        dest="storage_path",
        type=Path,
        metavar="FILE",
        help="keep what is known about the robots in this file over restarts",
    )
    group.add_argument(
        "--events.path",
        dest="events_path",
        type=Path,
        metavar="FILE",
        help="append every change of a level, silence and change of the config to this file, one "
        "JSON object a line; at 10 MB it is renamed to FILE.1, and five of those are kept",
    )


def _add_web(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("web")
    group.add_argument(
        "--web.listen-address",
        dest="listen_addresses",
        action="append",
        metavar="HOST:PORT",
        help="where to serve; may be given more than once; IPv6 as [::1]:9877; without a host on "
        f"all interfaces (default: {DEFAULT_ADDRESS})",
    )
    group.add_argument(
        "--web.telemetry-path",
        dest="telemetry_path",
        type=_path,
        default="/metrics",
        metavar="PATH",
        help="where the metrics are (default: %(default)s)",
    )
    group.add_argument(
        "--web.config.file",
        dest="web_config",
        type=Path,
        metavar="FILE",
        help="TLS, users and limits, in the format of Prometheus' exporter-toolkit; read again "
        "when it changes",
    )
    group.add_argument(
        "--web.enable-lifecycle",
        dest="lifecycle",
        action="store_true",
        help="let POST /-/reload and /-/forget change something; let nobody reach them whom you "
        "do not trust",
    )


def _add_alertmanager(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("Alertmanager, to show which faults are acknowledged")
    group.add_argument(
        "--alertmanager.url",
        dest="alertmanager_urls",
        action="append",
        type=_url,
        metavar="URL",
        help="ask it every few seconds for this fleet's acknowledgements and export them; may be "
        "given more than once for a pair: the first that answers is believed (default: nobody is "
        "asked)",
    )
    group.add_argument(
        "--alertmanager.user",
        dest="alertmanager_user",
        metavar="NAME",
        help="for basic auth",
    )
    group.add_argument(
        "--alertmanager.password-file",
        dest="alertmanager_password_file",
        type=Path,
        metavar="FILE",
        help="the user's password, in one line",
    )
    group.add_argument(
        "--alertmanager.ca-file",
        dest="alertmanager_ca_file",
        type=Path,
        metavar="FILE",
        help="CA of its TLS (default: the system's)",
    )


def _add_logs(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("log, on standard error")
    group.add_argument(
        "--log.level",
        dest="log_level",
        choices=("debug", "info", "warning", "error"),
        default="info",
        help="(default: %(default)s)",
    )
    group.add_argument(
        "--log.format",
        dest="log_format",
        choices=FORMATS,
        default="logfmt",
        help='json also wraps what the middleware writes past the log, logger "output" '
        "(default: %(default)s)",
    )


def _url(text: str) -> str:
    found = urlsplit(text)
    if found.scheme not in {"http", "https"} or not found.hostname or found.query or found.fragment:
        raise argparse.ArgumentTypeError(f"{text!r} is no URL such as http://localhost:9093")
    if "@" in found.netloc:
        raise argparse.ArgumentTypeError(
            "a URL in a flag is seen by everybody: give the user as --alertmanager.user and the "
            "password in --alertmanager.password-file"
        )
    return text


def _path(text: str) -> str:
    if not text.startswith("/") or set(text) & set("{}?#"):
        raise argparse.ArgumentTypeError(f"{text!r} is no path such as /metrics")
    return text
