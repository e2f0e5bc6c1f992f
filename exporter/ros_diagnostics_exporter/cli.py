"""The command: flags, wiring, signals, exit codes. The only file that knows all others."""

from __future__ import annotations

import argparse
import logging
import signal
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from ros_diagnostics_exporter import __version__, ros
from ros_diagnostics_exporter.config.check import describe
from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.service import Service
from ros_diagnostics_exporter.web.listen import ListenError
from ros_diagnostics_exporter.web.server import Server

EXIT_FAILURE = 1
EXIT_USAGE = 2  # also a config that cannot be read, as argparse exits for a wrong flag

log = logging.getLogger("ros_diagnostics_exporter")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the exporter until SIGTERM or SIGINT; the exit code."""
    options = _parser().parse_args(arguments)
    logging.basicConfig(
        level=options.log_level.upper(),
        format="%(asctime)s level=%(levelname)s logger=%(name)s %(message)s",
        stream=sys.stderr,
    )
    try:
        return _run(options)
    except ConfigError as error:
        print(error, file=sys.stderr)  # noqa: T201
        return EXIT_USAGE
    except (ros.RosMissingError, ListenError) as error:
        print(f"ros-diagnostics-exporter: {error}", file=sys.stderr)  # noqa: T201
        return EXIT_FAILURE


def _run(options: argparse.Namespace) -> int:
    fleet = load(options.config_file)
    if options.config_check:
        print(describe(fleet), end="")  # noqa: T201
        return 0
    for warning in fleet.warnings:
        log.warning(warning)
    ros.check_ros()
    service = Service(fleet, options.config_file, options.storage_path)
    server = Server(
        service.doors(),
        listen=options.listen_addresses or [":9877"],
        telemetry_path=options.telemetry_path,
    )
    server.start()
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _number, _frame: stop.set())
    reload = threading.Event()
    signal.signal(signal.SIGHUP, lambda _number, _frame: reload.set())
    try:
        service.start()
        log.info("serving fleet %s on %s", fleet.name, ", ".join(server.addresses))
        while not stop.is_set():
            if reload.is_set():
                reload.clear()
                service.reload_quietly("SIGHUP")
            service.tick()
            stop.wait(service.TICK)
    finally:
        server.stop()
        service.stop()
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ros-diagnostics-exporter",
        description="Exports the diagnostics of a fleet of ROS 2 robots to Prometheus.",
    )
    parser.add_argument(
        "--config.file",
        dest="config_file",
        type=Path,
        default=Path("fleet.yml"),
        metavar="FILE",
        help="the fleet: robots, discovery, profiles (default: %(default)s)",
    )
    parser.add_argument(
        "--config.check",
        dest="config_check",
        action="store_true",
        help="tell what is understood of the config, or what is wrong with it, and exit",
    )
    parser.add_argument(
        "--web.listen-address",
        dest="listen_addresses",
        action="append",
        metavar="HOST:PORT",
        help="where to serve; may be given more than once (default: :9877)",
    )
    parser.add_argument(
        "--web.telemetry-path",
        dest="telemetry_path",
        default="/metrics",
        metavar="PATH",
        help="where the metrics are (default: %(default)s)",
    )
    parser.add_argument(
        "--storage.path",
        dest="storage_path",
        type=Path,
        metavar="FILE",
        help="keep what is known about the robots in this file over restarts",
    )
    parser.add_argument(
        "--log.level",
        dest="log_level",
        choices=("debug", "info", "warning", "error"),
        default="info",
        help="(default: %(default)s)",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    return parser


if __name__ == "__main__":
    sys.exit(main())
