"""Accepts connections for the server; asyncio's own server counts none and has no bound of them.

When the process may open no more files, asyncio's tries, and logs, as often as the backlog is long
(a thousand times) each second; here it is tried again after a pause, and logged now and then.
"""

from __future__ import annotations

import asyncio
import logging
import math
import socket
import ssl
from collections.abc import Callable
from functools import partial

from ros_diagnostics_exporter.web.connections import Connections, address_of
from ros_diagnostics_exporter.web.protocol import TIMEOUTS, GuardedProtocol, Phase

AT_ONCE = 100  # connections accepted before others are served again
PAUSE = 0.1  # seconds until accepting is tried again after an error
LOG_EVERY = 10.0  # seconds
# Bytes of an answer that the kernel holds for a client; it would take megabytes for each.
SEND_BUFFER = 256 * 1024

_log = logging.getLogger(__name__)


class Acceptor:
    """Accepts connections on a listening socket until it is closed.

    Args:
        sock: Listens already; stays the caller's to close.
        factory: Makes the protocol of a new connection.
        context: For TLS; None without.
        connections: Where each is counted.
    """

    def __init__(
        self,
        sock: socket.socket,
        factory: Callable[[], GuardedProtocol],
        context: ssl.SSLContext | None,
        connections: Connections,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._sock = sock
        self._factory = factory
        self._context = context
        self._connections = connections
        self._opening: dict[asyncio.Task[None], GuardedProtocol] = {}
        self._again: asyncio.TimerHandle | None = None
        self._logged = -math.inf
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)  # inherited
        # asyncio sets it only for sockets that were made with the protocol's number. Without it the
        # end of an answer waits for the client's delayed ACK, 40 ms for each scrape.
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._loop.add_reader(sock, self._accept)

    def close(self) -> None:
        """Accept no more; what is not open yet is dropped."""
        self._loop.remove_reader(self._sock)
        if self._again is not None:
            self._again.cancel()
        for protocol in self._opening.values():
            protocol.abort()

    async def wait_closed(self) -> None:
        """Wait for what was dropped."""
        await asyncio.gather(*self._opening, return_exceptions=True)

    def _accept(self) -> None:
        for _ in range(AT_ONCE):
            try:
                accepted, (host, *_) = self._sock.accept()
            except (BlockingIOError, InterruptedError, ConnectionAbortedError):
                return
            except OSError as error:
                self._pause(error)
                return
            self._begin(accepted, address_of(host))

    def _begin(self, accepted: socket.socket, address: str) -> None:
        accepted.setblocking(False)
        protocol = self._factory()
        protocol.opening(address, accepted, partial(self._connections.discard, protocol))
        self._connections.add(protocol)
        task = self._loop.create_task(self._open(accepted, protocol))
        self._opening[task] = protocol
        task.add_done_callback(self._opening.pop)

    async def _open(self, accepted: socket.socket, protocol: GuardedProtocol) -> None:
        """Hand the socket to asyncio; returns when the TLS handshake is done."""
        try:
            await self._loop.connect_accepted_socket(
                lambda: protocol,
                accepted,
                ssl=self._context,
                ssl_handshake_timeout=None if self._context is None else TIMEOUTS[Phase.REQUEST],
            )
        except OSError as error:  # whoever cannot speak TLS must not fill the log
            _log.debug("a TLS handshake failed: %s", error)
        finally:
            if protocol.transport is None:
                self._connections.discard(protocol)

    def _pause(self, error: OSError) -> None:
        """Most likely no more files may be opened: close some connections, and wait for it."""
        self._connections.shrink()
        now = self._loop.time()
        if now >= self._logged + LOG_EVERY:
            self._logged = now
            _log.error(
                "no connection can be accepted: %s; from now on %d at once are. If the limit of "
                "open files is low, raise it (LimitNOFILE= of a systemd unit, ulimit -n) and "
                "restart the exporter",
                error,
                self._connections.limit,
            )
        self._loop.remove_reader(self._sock)
        self._again = self._loop.call_later(PAUSE, self._loop.add_reader, self._sock, self._accept)
