"""The web server: listening sockets, a thread with its own event loop, and an orderly shutdown.

It has one thread for the event loop, and those of app.start_threads. There is no access log.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import socket
import ssl
import threading
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import uvicorn
from starlette.applications import Starlette

from ros_diagnostics_exporter.loops import Loop
from ros_diagnostics_exporter.web.app import build, start_threads
from ros_diagnostics_exporter.web.backend import Backend
from ros_diagnostics_exporter.web.changes import ChangeStreams
from ros_diagnostics_exporter.web.connections import (
    MAX_HEADER_BYTES,
    TIMEOUTS,
    Acceptor,
    ClientConnection,
    Connections,
    Phase,
    connection_limit,
)
from ros_diagnostics_exporter.web.grafana import Grafana
from ros_diagnostics_exporter.web.webconfig import LiveWebConfig, WebConfigError

BACKLOG = 1024
RELOAD_INTERVAL = 1.0  # seconds between two checks of the web config's files
HANGING = 30.0  # seconds without a turn after which the event loop hangs
GRACE = 3  # seconds to finish responses when the server stops

_log = logging.getLogger(__name__)


class ListenError(OSError):
    """Cannot listen on an address; the text names it and the remedy."""


class AddressError(ListenError):
    """A listen address is malformed."""


def bind_all(listen: Sequence[str | socket.socket]) -> list[socket.socket]:
    """Listening sockets for all addresses, or for none; a socket is taken as it is.

    Raises:
        ListenError: For the first address that fails.
    """
    with contextlib.ExitStack() as stack:
        sockets = [
            stack.enter_context(bind(each) if isinstance(each, str) else each) for each in listen
        ]
        stack.pop_all()
    return sockets


def bind(address: str) -> socket.socket:
    """A listening socket for ``address``; without a host on all interfaces, IPv6 and IPv4.

    Raises:
        ListenError: The address is malformed, not of this machine, or in use.
    """
    host, port = parse_address(address)
    try:
        return _bind_everywhere(port) if host in {"", "::"} else _bind_one(host, port)
    except (OSError, UnicodeError) as error:  # UnicodeError: not a valid host name
        why = getattr(error, "strerror", None) or error
        raise ListenError(f"cannot listen on {address}: {why}; {_remedy(error)}") from error


def parse_address(address: str) -> tuple[str, int]:
    """Split ``host:port``, ``:port`` or ``[::1]:port``; the host is without brackets.

    Raises:
        AddressError: There is no port, or an IPv6 host has no brackets.
    """
    host, colon, port = address.rpartition(":")
    bare = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    if not colon or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise AddressError(
            f"listen address {address!r} has no port 0..65535; write host:port, :port or [::1]:port"
        )
    if ":" in host and bare == host:
        raise AddressError(f"listen address {address!r} has an IPv6 host; write it as [host]:port")
    return bare, int(port)


def name_of(sock: socket.socket) -> str:
    """The address that ``sock`` listens on, as ``host:port``."""
    host, port = sock.getsockname()[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _bind_everywhere(port: int) -> socket.socket:
    if socket.has_dualstack_ipv6():
        return socket.create_server(
            ("::", port), family=socket.AF_INET6, dualstack_ipv6=True, backlog=BACKLOG
        )
    return socket.create_server(("", port), backlog=BACKLOG)


def _bind_one(host: str, port: int) -> socket.socket:
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    # For a name with addresses of both families (localhost) take IPv4, as Go does.
    family, *_, where = min(found, key=lambda each: each[0] != socket.AF_INET)
    return socket.create_server(where[:2], family=family, backlog=BACKLOG)


def _remedy(error: Exception) -> str:
    number = getattr(error, "errno", None)
    if number == errno.EADDRINUSE:
        return "stop the program that uses the port, or choose another with --web.listen-address"
    if number == errno.EACCES:
        return "choose a port of 1024 or more with --web.listen-address"
    return "choose an address of this machine with --web.listen-address, or all of them: :PORT"


class Server:
    """Serves a backend over HTTP from its own thread; started once, stopped once.

    Args:
        backend: What is served.
        listen: Addresses, ``host:port``; without a host all interfaces, port 0 is any free port.
            Or listening sockets.
        telemetry_path: Where the metrics are.
        web_config: A file in the format of Prometheus' exporter-toolkit (TLS, basic auth).
        lifecycle: Whether /-/reload is enabled, and /-/forget for everybody.
        actions: Whether the pages have forms by which who has logged in acts.
        grafana: The address of the Grafana that the pages link; none if "".
        domains: The number of DDS domains, which need open files too.

    Raises:
        WebConfigError: The web_config is invalid, or has no users and ``actions`` are enabled.

    Attributes:
        addresses: Those it listens on, once started.
        connections: The clients'.
        loop: Reloads the web config.
    """

    def __init__(
        self,
        backend: Backend,
        listen: Sequence[str | socket.socket],
        *,
        telemetry_path: str = "/metrics",
        web_config: Path | None = None,
        lifecycle: bool = False,
        actions: bool = False,
        grafana: str = "",
        domains: int = 1,
    ) -> None:
        self.addresses: tuple[str, ...] = ()
        self._listen = tuple(listen)
        live_config = LiveWebConfig(web_config)
        if actions and not live_config.config.basic_auth_users:
            raise WebConfigError(
                "--web.enable-actions needs basic_auth_users in the file of --web.config.file, "
                "because people have to log in before they act"
            )
        self.loop = Loop("web-config", RELOAD_INTERVAL, live_config.refresh)
        self._threads = start_threads()
        self.connections = Connections(connection_limit(domains))
        self._changes = ChangeStreams(backend, self.connections)
        app = build(
            backend,
            self._threads,
            self.connections,
            self._changes,
            web_config=live_config,
            telemetry_path=telemetry_path,
            lifecycle=lifecycle,
            actions=actions,
            grafana=Grafana(grafana),
        )
        self._uvicorn = _Uvicorn(_configure(app, live_config), self.connections)
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Listen on all addresses; returns when requests are served.

        Raises:
            ListenError: Cannot listen on an address; then it listens on none.
        """
        sockets = bind_all(self._listen)
        self.addresses = tuple(name_of(each) for each in sockets)
        self._thread = threading.Thread(target=self._run, args=(sockets,), name="web-server")
        self._thread.start()
        self._uvicorn.ready.wait()
        self.loop.start()

    @property
    def alive(self) -> bool:
        """Whether requests are served."""
        return self._thread is not None and self._thread.is_alive()

    @property
    def hangs(self) -> bool:
        """Whether the event loop has made no turn for long."""
        return time.monotonic() - self._uvicorn.last_turn > HANGING

    def stop(self) -> None:
        """Accept no more connections, finish the responses (3 s at most) and end."""
        if self._thread is None:
            return
        self.loop.ask_to_stop()
        self._changes.stopping = True
        self._uvicorn.should_exit = True
        self._thread.join()
        self._threads.close()

    def _run(self, sockets: list[socket.socket]) -> None:
        loop = _Loop(self.connections)
        try:
            loop.run_until_complete(self._uvicorn.serve(sockets))
        except Exception:  # noqa: BLE001 - logged; `alive` is False from now on
            _log.exception("the web server has failed")
        finally:
            for each in sockets:
                each.close()
            self._uvicorn.ready.set()
            loop.close()


class _Uvicorn(uvicorn.Server):
    """Sets ``ready`` once it serves, and closes all connections on shutdown."""

    def __init__(self, config: uvicorn.Config, connections: Connections) -> None:
        super().__init__(config)
        self._connections = connections
        self.ready = threading.Event()
        self.last_turn = time.monotonic()

    async def on_tick(self, counter: int) -> bool:
        """Note that the loop goes on, and drop clients; uvicorn calls it ten times a second."""
        self.last_turn = time.monotonic()
        self._connections.end_overdue()
        return await super().on_tick(counter)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self.ready.set()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        # Before uvicorn's own timeout, which would cancel responses and log each as an error.
        timer = asyncio.get_running_loop().call_later(GRACE, self._abort_connections)
        await super().shutdown(sockets)
        timer.cancel()
        self._abort_connections()
        await asyncio.sleep(0)  # so that the loop closes them

    def _abort_connections(self) -> None:
        for connection in list(self.server_state.connections):
            cast(ClientConnection, connection).abort()


class _Loop(asyncio.SelectorEventLoop):
    """The standard loop with a server that limits its connections."""

    def __init__(self, connections: Connections) -> None:
        super().__init__()
        self._connections = connections

    async def create_server(  # type: ignore[override]
        self, factory: Any, *, sock: socket.socket, ssl: ssl.SSLContext | None, backlog: int
    ) -> Acceptor:
        """As uvicorn calls it."""
        sock.listen(backlog)
        return Acceptor(sock, factory, ssl, self._connections)


def _configure(app: Starlette, live_config: LiveWebConfig) -> uvicorn.Config:
    # uvicorn warns of every malformed request; clients must not be able to fill the log.
    logging.getLogger("uvicorn.error").setLevel(logging.ERROR)
    config = uvicorn.Config(
        app,
        http=ClientConnection,
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        proxy_headers=False,
        server_header=False,
        backlog=BACKLOG,
        timeout_keep_alive=int(TIMEOUTS[Phase.IDLE]) + 1,  # ClientConnection's own comes before it
        timeout_graceful_shutdown=GRACE + 5,
        h11_max_incomplete_event_size=MAX_HEADER_BYTES,
    )
    config.load()
    config.ssl = live_config.context
    return config
