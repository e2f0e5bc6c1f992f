"""What requests may cost: worker threads, calls that wait for them, bytes that nobody has read.

A flood of requests must only cost a limited number of threads and calls. Requests above that are
answered 503.

A response that is not read stays in memory until it times out. So the bytes of all large responses
are counted. When there are too many, a client that has stopped reading loses its connection; when
all are reading, a new scrape waits and any other request is answered 503. Scrapes have a limit of
their own, so other requests cannot use it up.
"""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable, Hashable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

from starlette.responses import JSONResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ros_diagnostics_exporter.web.connections import ClientConnection, Connections

T = TypeVar("T")


class BusyError(Exception):
    """Too many calls are pending; the HTTP status is 503."""


class Workers:
    """Runs functions in its own threads, for one kind of request.

    Args:
        name: Of the threads.
        threads: How many functions run at once.
        max_pending: How many requests may wait, including those that share a call.
    """

    def __init__(self, name: str, threads: int, max_pending: int) -> None:
        self._executor = ThreadPoolExecutor(threads, thread_name_prefix=name)
        self._max_pending = max_pending
        self._pending = 0
        self._shared: dict[Hashable, asyncio.Future[Any]] = {}

    async def run(self, function: Callable[..., T], *arguments: Any) -> T:
        """What ``function`` returns or raises; BusyError when too many requests wait."""
        if self._pending >= self._max_pending:
            raise BusyError
        return await self._wait(self._submit(function, *arguments))

    async def run_shared(self, seconds: float, function: Callable[..., T], *arguments: Any) -> T:
        """As ``run``, but the result is shared until it is ``seconds`` old.

        An exception is shared only with the requests that were already waiting. ``arguments`` are
        part of the cache's key, so clients must not be able to choose them.
        """
        if self._pending >= self._max_pending:
            raise BusyError
        key = (function, arguments)
        if key not in self._shared:
            call = self._submit(function, *arguments)
            self._shared[key] = call
            call.add_done_callback(lambda done: self._expire_later(key, done, seconds))
        return await self._wait(asyncio.shield(self._shared[key]))

    def invalidate(self) -> None:
        """Drop the shared results, because something has changed."""
        self._shared.clear()

    def _expire_later(self, key: Hashable, call: asyncio.Future[Any], seconds: float) -> None:
        if call.cancelled() or call.exception() is not None or seconds == 0:
            self._expire(key, call)
        else:
            call.get_loop().call_later(seconds, self._expire, key, call)

    def _expire(self, key: Hashable, call: asyncio.Future[Any]) -> None:
        if self._shared.get(key) is call:
            del self._shared[key]

    def close(self) -> None:
        """Wait for the running calls; none may follow."""
        self._executor.shutdown(cancel_futures=True)

    def _submit(self, function: Callable[..., T], *arguments: Any) -> asyncio.Future[T]:
        return asyncio.get_running_loop().run_in_executor(self._executor, function, *arguments)

    async def _wait(self, call: asyncio.Future[T]) -> T:
        self._pending += 1
        try:
            return await call
        finally:
            self._pending -= 1


MAX_BYTES = 128 << 20  # of responses to scrapes, and as many of all others
CHUNK = 256 << 10  # bytes passed to a connection at once; smaller responses are not counted
STALLED_AFTER = 0.5  # seconds without progress after which a client may lose its response
MAX_WAIT = 10.0  # seconds that a scrape waits: Prometheus' own default timeout


class ResponseLimit:
    """Counts the bytes of the responses being sent."""

    def __init__(self, connections: Connections) -> None:
        self._connections = connections
        self._sizes: dict[ClientConnection, int] = {}
        self._waiting: dict[asyncio.Future[None], ClientConnection] = {}

    def reserve(self, connection: ClientConnection, size: int) -> None:
        """Count a response of ``size`` bytes; clients that have stalled may lose theirs.

        A single response may have any size.

        Raises:
            BusyError: There are too many bytes, and all clients are reading.
        """
        while self._sizes and sum(self._sizes.values()) + size > MAX_BYTES:
            stalled = [each for each in self._sizes if each.stalled_for() > STALLED_AFTER]
            if not stalled:
                raise BusyError
            worst = max(stalled, key=self._connections.closing_order())
            del self._sizes[worst]
            worst.abort()
        self._sizes[connection] = size

    async def reserve_or_wait(self, connection: ClientConnection, size: int) -> None:
        """As ``reserve``, but wait for up to MAX_WAIT seconds."""
        give_up = time.monotonic() + MAX_WAIT
        while True:
            with contextlib.suppress(BusyError):
                return self.reserve(connection, size)
            if time.monotonic() >= give_up or connection.closed:
                raise BusyError
            turn = asyncio.get_running_loop().create_future()
            self._waiting[turn] = connection
            try:
                # Not for longer: another client may have stalled by then.
                await asyncio.wait([turn], timeout=STALLED_AFTER)
            finally:
                del self._waiting[turn]

    def resize(self, connection: ClientConnection, size: int) -> None:
        """Correct the size of a response, unless it has been lost since."""
        if connection in self._sizes:
            self._sizes[connection] = size

    def release(self, connection: ClientConnection) -> None:
        """The response has been read, or is lost; wake up one that waits."""
        self._sizes.pop(connection, None)
        # The newest first: an old one may have given up already, and a flood has filled the queue.
        waiting = [each for each in reversed(self._waiting) if not each.done()]
        if waiting:
            order = self._connections.closing_order()
            min(waiting, key=lambda each: order(self._waiting[each])).set_result(None)


async def send_chunks(pieces: Iterable[bytes], send: Send) -> None:
    """Send a body in chunks, each when the client has read most of the previous one."""
    for chunk in in_chunks(pieces):
        await send({"type": "http.response.body", "body": chunk, "more_body": True})
    await send({"type": "http.response.body"})


def in_chunks(pieces: Iterable[bytes]) -> Iterator[bytes]:
    """The same bytes in pieces of about ``CHUNK``, none longer than twice that."""
    waiting: list[bytes] = []
    size = 0
    for piece in pieces:
        waiting.append(piece)
        size += len(piece)
        if size >= CHUNK:
            joined = b"".join(waiting)
            yield from (joined[at : at + CHUNK] for at in range(0, size, CHUNK))
            waiting.clear()
            size = 0
    if waiting:
        yield b"".join(waiting)


def busy_response() -> Response:
    """503 with Retry-After."""
    return JSONResponse({"error": "too many requests are waiting"}, 503, {"Retry-After": "1"})


class ResponseLimiter:
    """ASGI middleware: sends large responses in chunks, or 503 if there are too many."""

    def __init__(self, app: ASGIApp, limit: ResponseLimit) -> None:
        self._app = app
        self._limit = limit

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, and limit its response."""
        start: Message | None = None  # held back: a 503 may take its place

        async def limited(message: Message) -> None:
            nonlocal start
            if message["type"] == "http.response.start":
                start = message
                return
            begin, start = start, None
            body = message.get("body", b"")
            if begin is not None and len(body) > CHUNK:
                connection = scope["state"]["connection"]
                if not await self._send_large(connection, begin, body, send):
                    await busy_response()(scope, receive, send)
                return
            if begin is not None:
                await send(begin)
            await send(message)  # also every chunk of a body that already comes in chunks

        await self._app(scope, receive, limited)

    async def _send_large(
        self, connection: ClientConnection, start: Message, body: bytes, send: Send
    ) -> bool:
        try:
            self._limit.reserve(connection, len(body))
        except BusyError:
            return False
        try:
            await send(start)
            await send_chunks([body], send)
        finally:
            self._limit.release(connection)
        return True
