"""Answers a scrape: which format, compressed or not, rendered once for all who ask at once.

Owns the bound of answers on their way to clients: a client that reads slowly holds a rendered
exposition in memory (29 MB for 1,000 robots), so there may only be so many of them.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
import time
import zlib
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import Receive, Scope, Send

from .calls import BusyError, Calls
from .guard import GuardedProtocol

TEXT = "text/plain; version=0.0.4; charset=utf-8"
OPENMETRICS = "application/openmetrics-text; version=1.0.0; charset=utf-8"
MAX_ANSWERS = 16  # on their way at once
CHUNK = 256 * 1024  # bytes handed to a connection at once
PATIENCE = 10.0  # seconds a scrape waits for its turn: Prometheus' own default time-out
YOUNG = 0.25  # seconds for which an answer is not judged by its speed
GZIP_LEVEL = 1  # 29 MB: 55 ms at level 1, 153 ms at level 6, for little less


def parse_accept(header: str) -> dict[str, float]:
    """An Accept or Accept-Encoding header as value -> highest quality; parameters left out."""
    found: dict[str, float] = {}
    for part in header.split(","):
        value, *parameters = (piece.strip().lower() for piece in part.split(";"))
        found[value] = max(found.get(value, 0.0), _quality(parameters))
    return found


def _quality(parameters: list[str]) -> float:
    for parameter in parameters:
        name, _, number = parameter.partition("=")
        if name.strip() == "q":
            try:
                return float(number)
            except ValueError:
                return 0.0
    return 1.0


def wants_openmetrics(accept: str) -> bool:
    """Whether OpenMetrics is named and is liked at least as much as plain text."""
    liked = parse_accept(accept)
    openmetrics = liked.get("application/openmetrics-text", 0.0)
    return openmetrics > 0 and openmetrics >= liked.get("text/plain", 0.0)


def wants_gzip(accept_encoding: str) -> bool:
    """Whether the client takes gzip."""
    liked = parse_accept(accept_encoding)
    return liked.get("gzip", liked.get("*", 0.0)) > 0


def compress(body: bytes) -> bytes:
    """``body`` as gzip; zlib lets other threads run meanwhile."""
    squeezer = zlib.compressobj(GZIP_LEVEL, wbits=31)
    return squeezer.compress(body) + squeezer.flush()


@dataclass(eq=False)
class _Answer:
    connection: GuardedProtocol
    begun: float | None = None  # when the first byte was handed to the connection
    sent: int = 0

    def speed(self, now: float) -> float:
        """Bytes a second so far; an answer that is not begun, or young, counts as fast."""
        if self.begun is None or now - self.begun < YOUNG:
            return math.inf
        return self.sent / (now - self.begun)


class Scrape:
    """The endpoint that Prometheus reads, an ASGI application.

    Args:
        metrics: Renders the exposition; True asks for OpenMetrics.
        calls: How it is asked, and where compressing is done.
    """

    def __init__(self, metrics: Callable[[bool], bytes], calls: Calls) -> None:
        self._metrics = metrics
        self._calls = calls
        self._answers: set[_Answer] = set()
        self._waiting: deque[asyncio.Future[None]] = deque()

    async def __call__(self, scope: Scope, _receive: Receive, send: Send) -> None:
        """Send the exposition; BusyError when it is not this one's turn for too long."""
        answer = _Answer(scope["state"]["connection"])
        await self._admit(answer)
        try:
            await self._answer(Headers(scope=scope), answer, send)
        finally:
            self._leave(answer)

    async def _answer(self, asked: Headers, answer: _Answer, send: Send) -> None:
        openmetrics = wants_openmetrics(asked.get("accept", ""))
        gzip = wants_gzip(asked.get("accept-encoding", ""))
        body = await self._calls.share(0, self._render, openmetrics, gzip)
        headers = MutableHeaders(
            {
                "Content-Type": OPENMETRICS if openmetrics else TEXT,
                "Content-Length": str(len(body)),
                "Vary": "Accept, Accept-Encoding",
            }
        )
        if gzip:
            headers["Content-Encoding"] = "gzip"
        await send({"type": "http.response.start", "status": 200, "headers": headers.raw})
        answer.begun = time.monotonic()
        for start in range(0, len(body), CHUNK):
            # Returns when the connection takes more: a slow reader is waited for here.
            piece = body[start : start + CHUNK]
            await send({"type": "http.response.body", "body": piece, "more_body": True})
            answer.sent += len(piece)
        await send({"type": "http.response.body"})

    async def _admit(self, answer: _Answer) -> None:
        """Take the answer in, when there is room; for it, a reader that is slow is dropped."""
        give_up = time.monotonic() + PATIENCE
        while len(self._answers) >= MAX_ANSWERS and not self._drop_slowest():
            if time.monotonic() >= give_up:
                raise BusyError
            turn = asyncio.get_running_loop().create_future()
            self._waiting.append(turn)
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(turn, YOUNG)  # by then a reader may count as slow
        self._answers.add(answer)

    def _drop_slowest(self) -> bool:
        now = time.monotonic()
        slowest = min(self._answers, key=lambda each: each.speed(now))
        if slowest.speed(now) == math.inf:
            return False
        self._answers.discard(slowest)
        slowest.connection.abort()
        return True

    def _leave(self, answer: _Answer) -> None:
        """Give the room to who has waited longest."""
        self._answers.discard(answer)
        while self._waiting:
            turn = self._waiting.popleft()
            if not turn.done():
                turn.set_result(None)
                return

    def _render(self, openmetrics: bool, gzip: bool) -> bytes:
        body = self._metrics(openmetrics)
        return compress(body) if gzip else body
