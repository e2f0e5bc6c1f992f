"""``ros-diagnostics-exporter``: flags, start and stop, signals, exit codes, systemd."""

from __future__ import annotations

import argparse
import faulthandler
import gc
import logging
import os
import signal
import socket
import sys
import threading
import time
from collections.abc import Sequence

from ros_diagnostics_exporter import logs
from ros_diagnostics_exporter.alertmanager import Alertmanager
from ros_diagnostics_exporter.cli import flags
from ros_diagnostics_exporter.cli.systemd import passed_sockets
from ros_diagnostics_exporter.config.check import describe
from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.http_client import Client
from ros_diagnostics_exporter.model import ZENOH
from ros_diagnostics_exporter.service import Service
from ros_diagnostics_exporter.sources.dds import check_ros
from ros_diagnostics_exporter.sources.prometheus import TIMEOUT
from ros_diagnostics_exporter.sources.ros_environment import RosMissingError, split_arguments
from ros_diagnostics_exporter.storage.database import ForeignError, InUseError
from ros_diagnostics_exporter.storage.retention import Retention
from ros_diagnostics_exporter.storage.storage import Storage
from ros_diagnostics_exporter.web.server import AddressError, ListenError, Server, parse_address
from ros_diagnostics_exporter.web.webconfig import LiveWebConfig, WebConfigError

_log = logging.getLogger(__name__)

# New objects from one collection of garbage to the next, Python's default is 700: messages make
# thousands and drop as many, which are no garbage, and looking at them took a tenth of the CPU.
NEW_OBJECTS = 10_000


def notify(state: str) -> None:
    """Send ``state``, for example ``READY=1``, to $NOTIFY_SOCKET if it is set."""
    path = os.environ.get("NOTIFY_SOCKET", "")
    if not path:
        return
    # "@" stands for the zero byte with which an abstract socket's name starts.
    address = "\0" + path[1:] if path.startswith("@") else path
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
            sock.connect(address)
            sock.sendall(state.encode())
    except OSError as error:
        _log.warning("cannot notify systemd at %s: %s", path, error)


class Watchdog:
    """Notifies systemd that the service works, as often as WatchdogSec= of the unit needs it."""

    def __init__(self) -> None:
        microseconds = os.environ.get("WATCHDOG_USEC", "")
        self._interval = int(microseconds) / 4e6 if microseconds.isdecimal() else None
        self._beaten_at = float("-inf")

    def beat(self) -> None:
        """Notify, unless that was done a moment ago or nobody waits for it."""
        now = time.monotonic()
        if self._interval is not None and now - self._beaten_at >= self._interval:
            self._beaten_at = now
            notify("WATCHDOG=1")


TURN = 0.25  # seconds until a signal is followed
EXIT_FAILURE = 1
EXIT_USAGE = 2  # also for an invalid configuration; argparse exits so for an invalid flag

# Whoever reads the log slowly must not keep the state's lock from others.
LOGGED_UNDER_LOCK = tuple(
    f"ros_diagnostics_exporter.{each}" for each in ("faults", "fleet", "robots")
)

log = logging.getLogger("ros_diagnostics_exporter")


class WebEndedError(Exception):
    """The web server has failed; its own log line has the reason."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the exporter until SIGTERM or SIGINT; the exit code."""
    own, for_ros = split_arguments(sys.argv[1:] if arguments is None else arguments)
    options = flags.parse(own)
    wrapped = options.log_format == "json" and not options.config_check
    logs.set_up(options.log_level, options.log_format, logs.wrap_output() if wrapped else None)
    try:
        return _check(options) if options.config_check else _run(options, for_ros)
    except (ConfigError, WebConfigError) as error:
        print(error, file=sys.stderr)  # noqa: T201
        return EXIT_USAGE
    except (AddressError, ForeignError) as error:
        print(f"ros-diagnostics-exporter: {error}", file=sys.stderr)  # noqa: T201
        return EXIT_USAGE
    except WebEndedError:
        return EXIT_FAILURE
    except (InUseError, RosMissingError, ListenError) as error:
        print(f"ros-diagnostics-exporter: {error}", file=sys.stderr)  # noqa: T201
        return EXIT_FAILURE


def _check(options: argparse.Namespace) -> int:
    fleet = load(options.config_file, options.shard)
    print(describe(fleet), end="")  # noqa: T201
    LiveWebConfig(options.web_config_file)
    return 0


def _run(options: argparse.Namespace, for_ros: tuple[str, ...]) -> int:
    listen = _listen(options)
    fleet = load(options.config_file, options.shard)
    for warning in fleet.warnings:
        log.warning(warning)
    if any(each != ZENOH for each in fleet.domain_ids):
        check_ros()
    if ZENOH in fleet.domain_ids:
        from ros_diagnostics_exporter.sources.zenoh import check_zenoh  # noqa: PLC0415 - see there

        check_zenoh()
    logs.write_aside(*LOGGED_UNDER_LOCK)
    faulthandler.enable()  # the watchdog's SIGABRT shows where each thread is
    gc.set_threshold(NEW_OBJECTS)
    service = Service(
        fleet,
        options.config_file,
        _storage(options),
        for_ros,
        alertmanager=_alertmanager(options),
        prometheus=_prometheus(options),
    )
    _serve(options, listen, service)
    return 0


def _listen(options: argparse.Namespace) -> Sequence[str | socket.socket]:
    """What the web server listens on."""
    if options.web_systemd_socket:
        return passed_sockets()
    addresses: list[str] = options.web_listen_address or [flags.DEFAULT_ADDRESS]
    for each in addresses:
        parse_address(each)
    return addresses


def _storage(options: argparse.Namespace) -> Storage | None:
    if options.storage_path is None:
        return None
    retention = Retention(options.storage_retention_time, options.storage_retention_size)
    return Storage(options.storage_path, retention)


def _alertmanager(options: argparse.Namespace) -> Alertmanager | None:
    if not options.alertmanager_url:
        return None
    return Alertmanager(
        options.alertmanager_url,
        user=options.alertmanager_user,
        password_file=options.alertmanager_password_file,
        ca_file=options.alertmanager_ca_file,
    )


def _prometheus(options: argparse.Namespace) -> Client | None:
    if options.prometheus_url is None:
        return None
    return Client(
        options.prometheus_url,
        timeout=TIMEOUT,
        user=options.prometheus_user,
        password_file=options.prometheus_password_file,
        bearer_token_file=options.prometheus_bearer_token_file,
        ca_file=options.prometheus_ca_file,
    )


def _serve(
    options: argparse.Namespace, listen: Sequence[str | socket.socket], service: Service
) -> None:
    server = Server(
        service,
        listen=listen,
        telemetry_path=options.web_telemetry_path,
        web_config=options.web_config_file,
        lifecycle=options.web_enable_lifecycle,
        actions=options.web_enable_actions,
        grafana=options.grafana_url or "",
        domains=len(service.state.fleet.domain_ids),
    )
    service.watch(server.loop)
    # From the first answer on: without a handler, a signal to reload would end the process.
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda _number, _frame: stop.set())
    reload = threading.Event()
    signal.signal(signal.SIGHUP, lambda _number, _frame: reload.set())
    server.start()
    try:
        service.start()
        notify("READY=1")
        log.info("serving fleet %s on %s", service.state.fleet.name, ", ".join(server.addresses))
        watchdog = Watchdog()
        while not stop.wait(TURN):
            if not server.alive:
                raise WebEndedError  # without it nobody sees the faults; systemd restarts us
            if reload.is_set():
                reload.clear()
                service.reloader.request("SIGHUP")
            if not server.hangs and service.hanging_reason() is None:
                watchdog.beat()
    finally:
        notify("STOPPING=1")
        server.stop()
        service.stop()


if __name__ == "__main__":
    sys.exit(main())
