"""Clients' connections: accepted, limited in number, each phase of each with a time-out.

When there are too many, a client that makes no progress loses its connection before one that does,
one without a login before one with, and an address with more than its share before all others. So
a client that opens connections without end closes its own.

uvicorn has a time-out for idle connections, but none for a request that arrives byte by byte, nor
for a client that does not read its response. Its limit of connections answers 503 to a scrape while
others are idle, and counts no TLS handshake: with it alone a third of the tests of slow clients
fail. `ClientConnection` relies on attributes of uvicorn's H11Protocol (cycle, conn, flow,
app_state), hence the upper bound of its version in pyproject.toml.
"""

from __future__ import annotations

import asyncio
import contextlib
import enum
import ipaddress
import logging
import math
import resource
import socket
import ssl
from collections import Counter
from collections.abc import Callable
from functools import partial
from itertools import count
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

MAX_HEADER_BYTES = 16 << 10


class Phase(enum.Enum):
    """What a connection is waiting for."""

    REQUEST = "the client has not sent all of its request"
    RESPONSE = "the application is preparing the response"
    READING = "the client has not read all of its response"
    IDLE = "kept alive for a next request"


# Seconds. A request's time starts with its first byte (the first request's with the connection).
TIMEOUTS = {Phase.REQUEST: 10.0, Phase.RESPONSE: 60.0, Phase.READING: 60.0, Phase.IDLE: 120.0}


class ClientConnection(H11Protocol):
    """One client's connection; no phase lasts longer than its time-out.

    Attributes:
        address: The client's, as connections.client_address returns it.
        authenticated: Whether the client has sent a valid password or certificate on it.
        pipelines: Whether the client has ever sent a request before its last one was answered.
    """

    transport: asyncio.Transport

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        # Requests find their connection here, so that a response nobody reads can be dropped.
        self.app_state = {**self.app_state, "connection": self}
        self.authenticated = False
        self.pipelines = False
        self.phase = Phase.REQUEST
        self.since = self.loop.time()
        self._unread_since = 0.0

    def accepted(self, address: str, sock: socket.socket, on_lost: Callable[[], object]) -> None:
        """Set the client's address, the socket, and what to call when the connection ends."""
        self.address = address
        self._sock = sock
        self._on_lost = on_lost

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Wait for the first request."""
        super().connection_made(transport)
        self.authenticated = bool(transport.get_extra_info("peercert"))
        self._enter(Phase.REQUEST)

    def connection_lost(self, exc: Exception | None) -> None:
        """Count no more."""
        super().connection_lost(exc)
        self._on_lost()
        self.transport.close()  # Python 3.10's TLS transport does not notice the loss

    def data_received(self, data: bytes) -> None:
        """Process the bytes and update the phase."""
        super().data_received(data)
        self._update_phase()

    def on_response_complete(self) -> None:
        """Update the phase: is the response read, is there another request?"""
        super().on_response_complete()
        self._update_phase()

    def pause_writing(self) -> None:
        """Note since when the client has not been reading."""
        super().pause_writing()
        self._unread_since = self.loop.time()

    def stalled_for(self) -> float:
        """Seconds without progress by the client; 0 while the application is at work."""
        if self.phase is not Phase.RESPONSE:
            return self.loop.time() - self.since
        return self.loop.time() - self._unread_since if self.flow.write_paused else 0.0

    @property
    def closed(self) -> bool:
        """Whether the client is gone."""
        return self.transport is not None and self.transport.is_closing()

    def abort(self) -> None:
        """Drop the connection with whatever is still to be sent on it."""
        if self.transport is not None:
            self.transport.abort()
            return
        with contextlib.suppress(OSError):  # it has just ended
            self._sock.shutdown(socket.SHUT_RDWR)  # ends the TLS handshake in asyncio

    def _update_phase(self) -> None:
        phase = self._current_phase()
        self.pipelines |= phase is Phase.RESPONSE and self.conn.trailing_data[0] != b""
        if phase is not self.phase:
            self._enter(phase)

    def _current_phase(self) -> Phase:
        if self.cycle is None:
            return Phase.REQUEST
        if not self.cycle.response_complete:
            return Phase.RESPONSE
        if self.transport.get_write_buffer_size() > 0:
            return Phase.READING
        # Between requests h11 holds no bytes and is ready for the next. Otherwise there is part of
        # a request, or the rest of a body that the response did not wait for.
        ready = self.conn.our_state == self.conn.their_state and not self.conn.trailing_data[0]
        return Phase.IDLE if ready else Phase.REQUEST

    def _enter(self, phase: Phase) -> None:
        self.phase = phase
        self.since = self.loop.time()

    def end_overdue(self) -> None:
        """Drop the connection if its phase has lasted too long; a TLS handshake's, too."""
        if self.loop.time() < self.since + TIMEOUTS[self.phase]:
            return
        if self._current_phase() is self.phase:
            self.abort()
        else:
            self._update_phase()


MAX_CONNECTIONS = 500
MIN_CONNECTIONS = 20  # however low the limit of open files is
OWN_FILES = 60  # of the exporter itself: libraries, the database, logs, listening sockets
DOMAIN_FILES = 20  # of a DDS domain; measured: eleven
MIN_AFTER_ERROR = 5  # connections, even if accepting fails
SHARE = 10  # an address may have a tenth of all connections before its own are closed first

ACCEPT_BATCH = 100  # connections accepted before others are served again
RETRY_AFTER = 0.1  # seconds until accepting is tried again after an error
LOG_EVERY = 10.0  # seconds
# Bytes of a response that the kernel buffers for a client; by default it would be megabytes.
SEND_BUFFER = 256 << 10

_log = logging.getLogger(__name__)


def connection_limit(domains: int) -> int:
    """The number of connections that the limit of open files allows; raises that limit first.

    Go's runtime does so for its servers, too. A limit that is too low is logged with the remedy.
    """
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if soft != hard:
        try:
            resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
            soft = hard
        except (OSError, ValueError) as error:  # a sandbox may forbid it
            _log.warning("the limit of open files cannot be raised above %d: %s", soft, error)
    others = OWN_FILES + DOMAIN_FILES * domains
    connections = max(MIN_CONNECTIONS, min(MAX_CONNECTIONS, soft - others))
    if connections < MAX_CONNECTIONS:
        _log.warning(
            "only %d files may be open: %d connections are accepted at once instead of %d; raise "
            "the limit to %d (LimitNOFILE= of a systemd unit, ulimit -n, --ulimit nofile=)",
            soft,
            connections,
            MAX_CONNECTIONS,
            MAX_CONNECTIONS + others,
        )
    return connections


def client_address(host: str) -> str:
    """The address that identifies a client: of IPv6 the /64, all of which one host may use."""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(address, ipaddress.IPv4Address):
        return str(address)
    if address.ipv4_mapped is not None:  # from a socket that listens on both
        return str(address.ipv4_mapped)
    return str(ipaddress.ip_network((address, 64), strict=False))


class Connections:
    """All open connections, TLS handshakes included; never more than ``limit``."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._open: set[ClientConnection] = set()

    def __len__(self) -> int:
        """How many there are."""
        return len(self._open)

    def add(self, connection: ClientConnection) -> None:
        """Add a new connection; closes others if there are too many."""
        while self._open and len(self._open) >= self.limit:
            self.close_worst()
        self._open.add(connection)

    def discard(self, connection: ClientConnection) -> None:
        """Remove a connection that has ended."""
        self._open.discard(connection)

    def end_overdue(self) -> None:
        """Drop those of which a phase has lasted too long."""
        for each in tuple(self._open):
            each.end_overdue()

    def lower_limit(self) -> None:
        """Allow fewer connections than there are now: the process cannot have more."""
        self.limit = max(MIN_AFTER_ERROR, len(self._open) - 2)
        while len(self._open) > self.limit:
            self.close_worst()

    def close_worst(self) -> None:
        """Close the connection that is last in the closing order."""
        worst = max(self._open, key=self.closing_order())
        self._open.discard(worst)  # now: the loop may accept many more before it closes it
        worst.abort()

    def closing_order(self) -> Callable[[ClientConnection], tuple[bool, int, bool, float]]:
        """A sort key for connections; the last one is closed first."""
        number = Counter(each.address for each in self._open)
        share = self.limit // SHARE
        return lambda each: (
            not each.authenticated,
            max(0, number[each.address] - share),
            each.pipelines,  # a client that pipelines keeps the server busy
            each.stalled_for(),
        )


class Acceptor:
    """Accepts connections on a listening socket until it is closed.

    It takes the place of asyncio's own server, which does not limit connections, and which, when no
    more files can be opened, tries and logs as often as the backlog is long each second.

    Args:
        sock: Is listening; the caller closes it.
        factory: Makes the protocol of a new connection.
        context: For TLS; None without.
        connections: Limits their number.
    """

    def __init__(
        self,
        sock: socket.socket,
        factory: Callable[[], ClientConnection],
        context: ssl.SSLContext | None,
        connections: Connections,
    ) -> None:
        self._loop = asyncio.get_running_loop()
        self._sock = sock
        self._factory = factory
        self._context = context
        self._connections = connections
        self._opening: dict[asyncio.Task[None], ClientConnection] = {}
        self._logged_at = -math.inf
        sock.setblocking(False)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, SEND_BUFFER)  # inherited
        # asyncio sets it only for sockets that were made with the protocol's number. Without it the
        # end of a response waits for the client's delayed ACK, 40 ms for each scrape.
        sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._accepting = self._loop.create_task(self._accept())

    def close(self) -> None:
        """Stop accepting, and drop the connections whose handshake is not complete."""
        self._accepting.cancel()
        for connection in self._opening.values():
            connection.abort()

    async def wait_closed(self) -> None:
        """Wait for the dropped connections to end."""
        await asyncio.gather(self._accepting, *self._opening, return_exceptions=True)

    async def _accept(self) -> None:
        for number in count(1):
            try:
                accepted, (host, *_) = await self._loop.sock_accept(self._sock)
            except ConnectionAbortedError:
                continue
            except OSError as error:
                self._lower_limit(error)
                await asyncio.sleep(RETRY_AFTER)
                continue
            self._start(accepted, client_address(host))
            if number % ACCEPT_BATCH == 0:
                await asyncio.sleep(0)

    def _start(self, accepted: socket.socket, address: str) -> None:
        connection = self._factory()
        connection.accepted(address, accepted, partial(self._connections.discard, connection))
        self._connections.add(connection)
        task = self._loop.create_task(self._open(accepted, connection))
        self._opening[task] = connection
        task.add_done_callback(self._opening.pop)

    async def _open(self, accepted: socket.socket, connection: ClientConnection) -> None:
        """Pass the socket to asyncio; returns when the TLS handshake is done."""
        try:
            await self._loop.connect_accepted_socket(
                lambda: connection,
                accepted,
                ssl=self._context,
            )
        except OSError as error:  # a client that does not speak TLS must not fill the log
            _log.debug("a TLS handshake failed: %s", error)
        finally:
            if connection.transport is None:
                self._connections.discard(connection)

    def _lower_limit(self, error: OSError) -> None:
        """Most likely no more files can be opened: close some connections."""
        self._connections.lower_limit()
        now = self._loop.time()
        if now >= self._logged_at + LOG_EVERY:
            self._logged_at = now
            _log.error(
                "no connection can be accepted: %s; the limit is now %d connections at once. If "
                "the limit of open files is low, raise it (LimitNOFILE= of a systemd unit, "
                "ulimit -n) and restart the exporter",
                error,
                self._connections.limit,
            )
