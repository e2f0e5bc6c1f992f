"""The protocol between a client and the application: time-outs, and how long a client lets us wait.

uvicorn has a time-out for idle connections, but none for a request that arrives byte by byte, nor
for a client that does not read its answer. This adds them. It leans on attributes of uvicorn's
H11Protocol (cycle, conn, flow, app_state), hence the upper bound of uvicorn's version in
pyproject.toml.
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
    ANSWER = "the application makes the answer"
    READING = "the client has not read all of its answer"
    IDLE = "kept alive for a next request"


# Seconds. A request's time runs from its first byte (the first one's from the connection).
TIMEOUTS = {Phase.REQUEST: 10.0, Phase.ANSWER: 60.0, Phase.READING: 60.0, Phase.IDLE: 120.0}


class GuardedProtocol(H11Protocol):
    """One client's connection, which no phase may hold for longer than its time-out.

    Attributes:
        address: The client's, as clients.py writes it.
        known: Whether the client has shown a right password or certificate on this connection.
        pipelines: Whether the client has ever asked again before it was answered.
    """

    transport: asyncio.Transport

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        # A request finds its connection here, so that an answer nobody reads can be dropped.
        self.app_state = {**self.app_state, "connection": self}
        self.known = False
        self.pipelines = False
        self.phase = Phase.REQUEST
        self.since = self.loop.time()
        self._unread_since = 0.0
        self._timer: asyncio.TimerHandle | None = None

    def opening(self, address: str, sock: socket.socket, lost: Callable[[], object]) -> None:
        """Note whose connection this is, its socket, and what to call when it has ended."""
        self.address = address
        self._sock = sock
        self._lost = lost

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to wait for the first request."""
        super().connection_made(transport)
        self.known = bool(transport.get_extra_info("peercert"))
        self._enter(Phase.REQUEST)

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the timer with the connection."""
        super().connection_lost(exc)
        self._lost()
        self._stop_timer()
        self.transport.close()  # Python 3.10's TLS transport does not know by itself that it is

    def data_received(self, data: bytes) -> None:
        """Hand the bytes on and see what the connection is waiting for now."""
        super().data_received(data)
        self._look()

    def on_response_complete(self) -> None:
        """See whether the client has read the answer, and whether it has asked again."""
        super().on_response_complete()
        self._look()

    def pause_writing(self) -> None:
        """Note since when the client has not read."""
        super().pause_writing()
        self._unread_since = self.loop.time()

    def waited(self) -> float:
        """Seconds for which the client has made no progress; 0 while the application is at work."""
        if self.phase is not Phase.ANSWER:
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
        with contextlib.suppress(OSError):  # it has just ended by itself
            self._sock.shutdown(socket.SHUT_RDWR)  # asyncio sees the end of the TLS handshake

    def _look(self) -> None:
        phase = self._judge()
        self.pipelines |= phase is Phase.ANSWER and self.conn.trailing_data[0] != b""
        if phase is not self.phase:
            self._enter(phase)

    def _judge(self) -> Phase:
        if self.cycle is None:
            return Phase.REQUEST
        if not self.cycle.response_complete:
            return Phase.ANSWER
        if self.transport.get_write_buffer_size() > 0:
            return Phase.READING
        # Between requests h11 holds no bytes and is ready for the next; anything else is a request
        # half received, or the rest of a body that the answer did not wait for.
        ready = self.conn.our_state == self.conn.their_state and not self.conn.trailing_data[0]
        return Phase.IDLE if ready else Phase.REQUEST

    def _enter(self, phase: Phase) -> None:
        self.phase = phase
        self.since = self.loop.time()
        self._stop_timer()
        self._timer = self.loop.call_later(TIMEOUTS[phase], self._too_long)

    def _stop_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _too_long(self) -> None:
        if self._judge() is self.phase:
            self.abort()
        else:
            self._look()
