"""Server-sent events: an open page is notified of changes, and renews itself.

A stream ends after less than the time-out of a response, and the browser opens the next. A client
that does not read holds back its own stream only, until that time-out. Streams are a tenth of all
connections at most; the pages of further clients ask every few seconds instead.
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import AsyncIterator

from starlette.responses import StreamingResponse
from starlette.types import Receive, Scope, Send

from ros_diagnostics_exporter.web.backend import Backend
from ros_diagnostics_exporter.web.connections import SHARE, Connections
from ros_diagnostics_exporter.web.responses import busy_response

LASTS = 45.0  # seconds until a stream ends; less than the time-out of a response
LOOK = 0.5  # seconds between two looks at whether something has changed
PAUSE = 3.0  # seconds between two events, however much changes
RETRY = 2_000  # milliseconds after which the browser opens the next stream


class ChangeStreams:
    """The streams.

    Args:
        backend: Says what the last event is.
        connections: The clients', of which streams are a part.

    Attributes:
        stopping: Whether all streams are to end.
    """

    def __init__(self, backend: Backend, connections: Connections) -> None:
        self.stopping = False
        self._backend = backend
        self._connections = connections
        self._open = 0

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Serve a stream; 503 where there are too many."""
        if self._open >= self._connections.limit // SHARE:
            await busy_response()(scope, receive, send)
            return
        self._open += 1
        try:
            stream = StreamingResponse(self._stream(), media_type="text/event-stream")
            await stream(scope, receive, send)
        finally:
            self._open -= 1

    async def _stream(self) -> AsyncIterator[bytes]:
        begin = quiet_until = time.monotonic()
        seen = self._backend.last_event()
        yield b"retry: %d\n\n" % RETRY
        while time.monotonic() < begin + LASTS and not self.stopping:
            await asyncio.sleep(LOOK)
            last, now = self._backend.last_event(), time.monotonic()
            if last != seen and now >= quiet_until:
                seen, quiet_until = last, now + PAUSE
                yield b"data: %d\n\n" % last
