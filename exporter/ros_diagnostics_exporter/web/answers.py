"""Answers on their way to clients, and the bound of their bytes.

An answer that is not read stays in memory until its time is up. So the bytes of all large answers
are counted; when there are too many, who has not read for a while loses its answer, and where all
read steadily, a newcomer waits (a scrape) or is answered 503. Scrapes have a count of their own:
nothing else takes their place.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from dataclasses import dataclass

from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ros_diagnostics_exporter.web.connections import Connections
from ros_diagnostics_exporter.web.protocol import GuardedProtocol
from ros_diagnostics_exporter.web.workers import BusyError

MAX_BYTES = 128 * 1024 * 1024  # of scrapes' answers under way, and as many of all others
PIECE = 256 * 1024  # bytes handed to a connection at once; smaller answers are not counted
UNREAD = 0.5  # seconds without progress after which a client may lose its answer to another
PATIENCE = 10.0  # seconds a scrape waits for its turn: Prometheus' own default time-out


class Answers:
    """Counts the answers under way."""

    def __init__(self, connections: Connections) -> None:
        self._connections = connections
        self._sizes: dict[GuardedProtocol, int] = {}
        self._waiting: dict[asyncio.Future[None], GuardedProtocol] = {}

    def take(self, connection: GuardedProtocol, size: int) -> None:
        """Count an answer of ``size`` bytes; readers that make no progress may lose theirs.

        One that is alone may be of any size.

        Raises:
            BusyError: There are too many bytes under way, and all are being read.
        """
        while self._sizes and sum(self._sizes.values()) + size > MAX_BYTES:
            idle = [each for each in self._sizes if each.waited() > UNREAD]
            if not idle:
                raise BusyError
            worst = max(idle, key=self._connections.order())
            del self._sizes[worst]
            worst.abort()
        self._sizes[connection] = size

    async def take_turn(self, connection: GuardedProtocol, size: int) -> None:
        """As ``take``, but wait for up to PATIENCE seconds."""
        give_up = time.monotonic() + PATIENCE
        while True:
            with contextlib.suppress(BusyError):
                return self.take(connection, size)
            if time.monotonic() >= give_up or connection.closed:
                raise BusyError
            await self._wait(connection)

    def resize(self, connection: GuardedProtocol, size: int) -> None:
        """An answer turned out to be of another size; nothing if it was lost meanwhile."""
        if connection in self._sizes:
            self._sizes[connection] = size

    def release(self, connection: GuardedProtocol) -> None:
        """The answer has been read, or is lost; the next one who waits may try."""
        self._sizes.pop(connection, None)
        # The newest first: an old one may have given up already, and a flood has filled the queue.
        waiting = [turn for turn in reversed(self._waiting) if not turn.done()]
        if waiting:
            order = self._connections.order()
            min(waiting, key=lambda turn: order(self._waiting[turn])).set_result(None)

    async def _wait(self, connection: GuardedProtocol) -> None:
        turn = asyncio.get_running_loop().create_future()
        self._waiting[turn] = connection
        try:
            await asyncio.wait([turn], timeout=UNREAD)  # by then a reader may have stopped
        finally:
            del self._waiting[turn]


async def send_pieces(body: bytes, send: Send) -> None:
    """Send ``body`` piece by piece, each when the client has read most of the one before."""
    for start in range(0, len(body), PIECE):
        piece = body[start : start + PIECE]
        await send({"type": "http.response.body", "body": piece, "more_body": True})
    await send({"type": "http.response.body"})


def busy() -> Response:
    """The answer to who has to come again."""
    return JSONResponse({"error": "too many requests wait"}, 503, {"Retry-After": "1"})


class Counted:
    """ASGI middleware: sends large answers piece by piece, and 503 where there are too many."""

    def __init__(self, app: ASGIApp, answers: Answers) -> None:
        self._app = app
        self._answers = answers

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and its answer back."""
        await self._app(scope, receive, _Sender(self._answers, scope, receive, send))


@dataclass
class _Sender:
    """One request's ``send``."""

    answers: Answers
    scope: Scope
    receive: Receive
    send: Send
    start: Message | None = None  # held back: it may have to be another one

    async def __call__(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self.start = message
            return
        start, self.start = self.start, None
        body = message.get("body", b"")
        if start is not None and len(body) > PIECE:
            await self._send_large(start, body)
            return
        if start is not None:
            await self.send(start)
        await self.send(message)  # also every piece of what comes in pieces already

    async def _send_large(self, start: Message, body: bytes) -> None:
        connection = self.scope["state"]["connection"]
        try:
            self.answers.take(connection, len(body))
        except BusyError:
            await busy()(self.scope, self.receive, self.send)
            return
        try:
            await self.send(start)
            await send_pieces(body, self.send)
        finally:
            self.answers.release(connection)
