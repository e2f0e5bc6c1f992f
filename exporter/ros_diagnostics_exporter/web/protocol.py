"""The protocol of one client's connection, with a time-out for each of its phases.

uvicorn has a time-out for idle connections, but none for a request that arrives byte by byte, nor
for a client that does not read its response. This relies on attributes of uvicorn's H11Protocol
(cycle, conn, flow, app_state), hence the upper bound of uvicorn's version in pyproject.toml.
"""

from __future__ import annotations

import asyncio
import contextlib
import enum
import socket
from collections.abc import Callable
from typing import Any

from uvicorn.protocols.http.h11_impl import H11Protocol

MAX_HEADER_BYTES = 16 * 1024


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
        self._timer: asyncio.TimerHandle | None = None

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
        """Cancel the timer."""
        super().connection_lost(exc)
        self._on_lost()
        self._cancel_timer()
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
        self._cancel_timer()
        self._timer = self.loop.call_later(TIMEOUTS[phase], self._timed_out)

    def _cancel_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _timed_out(self) -> None:
        if self._current_phase() is self.phase:
            self.abort()
        else:
            self._update_phase()
