"""The server: sockets, a thread with an event loop of its own, and a clean end.

Threads are bounded: one for the event loop, and those of app.start_threads. No access log is kept.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import ssl
import threading
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, cast

import uvicorn
from starlette.applications import Starlette

from ros_diagnostics_exporter.web.accept import Acceptor
from ros_diagnostics_exporter.web.app import build, start_threads
from ros_diagnostics_exporter.web.backend import Doors
from ros_diagnostics_exporter.web.connections import Connections
from ros_diagnostics_exporter.web.file_limit import allowed_connections
from ros_diagnostics_exporter.web.listen import BACKLOG, bind_all, name_of
from ros_diagnostics_exporter.web.live_config import Settings
from ros_diagnostics_exporter.web.protocol import MAX_HEADER_BYTES, TIMEOUTS, GuardedProtocol, Phase
from ros_diagnostics_exporter.web.tls import follow

GRACE = 3  # seconds for answers under way when the server stops

_log = logging.getLogger(__name__)


class Server:
    """Serves the doors over HTTP from a thread of its own; started once, stopped once.

    Args:
        doors: What is served.
        listen: Addresses, ``host:port``; without a host all interfaces, port 0 picks a free one.
        telemetry_path: Where the metrics are.
        web_config: A file in the format of Prometheus' exporter-toolkit (TLS, basic auth).
        lifecycle: Whether /-/reload and /-/forget are open.
        domains: How many DDS domains need files of this process, too.

    Raises:
        WebConfigError: The web_config cannot be used.

    Attributes:
        addresses: What is really listened on, once started.
        connections: The clients'.
    """

    def __init__(
        self,
        doors: Doors,
        listen: Sequence[str],
        *,
        telemetry_path: str = "/metrics",
        web_config: Path | None = None,
        lifecycle: bool = False,
        domains: int = 1,
    ) -> None:
        self.addresses: tuple[str, ...] = ()
        self._listen = tuple(listen)
        settings = Settings(web_config)
        self._threads = start_threads()
        self.connections = Connections(allowed_connections(domains))
        app = build(
            doors,
            self._threads,
            self.connections,
            settings=settings,
            telemetry_path=telemetry_path,
            lifecycle=lifecycle,
        )
        self._uvicorn = _Uvicorn(_configure(app, settings))
        self._thread: threading.Thread | None = None

    def start(self) -> None:
        """Listen on all addresses and serve; returns when requests are answered.

        Raises:
            ListenError: An address cannot be listened on; none is then.
        """
        sockets = bind_all(self._listen)
        self.addresses = tuple(name_of(each) for each in sockets)
        self._thread = threading.Thread(target=self._run, args=(sockets,), name="web-server")
        self._thread.start()
        self._uvicorn.ready.wait()

    @property
    def alive(self) -> bool:
        """Whether requests are answered."""
        return self._thread is not None and self._thread.is_alive()

    def stop(self) -> None:
        """Take no more connections, finish the answers under way (3 s at most) and end."""
        if self._thread is None:
            return
        self._uvicorn.should_exit = True
        self._thread.join()
        self._threads.close()

    def _run(self, sockets: list[socket.socket]) -> None:
        loop = _Loop(self.connections)
        try:
            loop.run_until_complete(self._uvicorn.serve(sockets))
        except Exception:  # noqa: BLE001 - logged; the owner sees by `alive` that it is over
            _log.exception("the web server has ended")
        finally:
            for each in sockets:
                each.close()
            self._uvicorn.ready.set()
            loop.close()


class _Uvicorn(uvicorn.Server):
    """Says when it is ready, and leaves no connection behind."""

    def __init__(self, config: uvicorn.Config) -> None:
        super().__init__(config)
        self.ready = threading.Event()

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        self.ready.set()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        # Before uvicorn's own time is up: it would cancel the answers and log each as an error.
        timer = asyncio.get_running_loop().call_later(GRACE, self._abort_connections)
        await super().shutdown(sockets)
        timer.cancel()
        self._abort_connections()
        await asyncio.sleep(0)  # lets the loop close them

    def _abort_connections(self) -> None:
        for connection in list(self.server_state.connections):
            cast(GuardedProtocol, connection).abort()


class _Loop(asyncio.SelectorEventLoop):
    """The standard loop with a server that bounds its connections."""

    def __init__(self, connections: Connections) -> None:
        super().__init__()
        self._connections = connections

    async def create_server(  # type: ignore[override]
        self, factory: Any, *, sock: socket.socket, ssl: ssl.SSLContext | None, backlog: int
    ) -> Acceptor:
        """As uvicorn calls it."""
        sock.listen(backlog)
        return Acceptor(sock, factory, ssl, self._connections)


def _configure(app: Starlette, settings: Settings) -> uvicorn.Config:
    # uvicorn warns of every malformed request; whoever sends those must not fill the log.
    logging.getLogger("uvicorn.error").setLevel(logging.ERROR)
    config = uvicorn.Config(
        app,
        http=GuardedProtocol,
        ws="none",
        lifespan="off",
        log_config=None,
        access_log=False,
        proxy_headers=False,
        server_header=False,
        backlog=BACKLOG,
        timeout_keep_alive=int(TIMEOUTS[Phase.IDLE]) + 1,  # the guard's own comes before it
        timeout_graceful_shutdown=GRACE + 5,
        h11_max_incomplete_event_size=MAX_HEADER_BYTES,
    )
    config.load()
    if settings.context is not None:
        config.ssl = follow(partial(_current_context, settings))
    return config


def _current_context(settings: Settings) -> ssl.SSLContext:
    settings.refresh()
    if settings.context is None:
        raise RuntimeError("TLS cannot be switched off while it is served")
    return settings.context
