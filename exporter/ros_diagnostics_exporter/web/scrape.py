"""Answers a scrape: which format, compressed or not, rendered once for all who ask at once."""

from __future__ import annotations

import zlib
from collections.abc import Callable

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import Receive, Scope, Send

from ros_diagnostics_exporter.web.answers import Answers, send_pieces
from ros_diagnostics_exporter.web.workers import Calls

TEXT = "text/plain; version=0.0.4; charset=utf-8"
OPENMETRICS = "application/openmetrics-text; version=1.0.0; charset=utf-8"
FIRST_SIZE = 8 * 1024 * 1024  # bytes that are counted for an answer until one was rendered
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


class Scrape:
    """The endpoint that Prometheus reads, an ASGI application.

    Args:
        metrics: Renders the exposition; True asks for OpenMetrics.
        calls: How it is asked, and where compressing is done.
        answers: Counts the answers under way.
    """

    def __init__(self, metrics: Callable[[bool], bytes], calls: Calls, answers: Answers) -> None:
        self._metrics = metrics
        self._calls = calls
        self._answers = answers
        self._sizes: dict[tuple[bool, bool], int] = {}  # of the last answer of each kind

    async def __call__(self, scope: Scope, _receive: Receive, send: Send) -> None:
        """Send the exposition; BusyError when it is not this one's turn for too long."""
        connection, asked = scope["state"]["connection"], Headers(scope=scope)
        openmetrics = wants_openmetrics(asked.get("accept", ""))
        gzip = wants_gzip(asked.get("accept-encoding", ""))
        # Before it is rendered: who waits must not hold an exposition.
        await self._answers.take_turn(connection, self._sizes.get((openmetrics, gzip), FIRST_SIZE))
        try:
            body = await self._calls.share(0, self._render, openmetrics, gzip)
            self._sizes[openmetrics, gzip] = len(body)
            self._answers.resize(connection, len(body))
            headers = _headers(len(body), openmetrics=openmetrics, gzip=gzip)
            await send({"type": "http.response.start", "status": 200, "headers": headers.raw})
            await send_pieces(body, send)
        finally:
            self._answers.release(connection)

    def _render(self, openmetrics: bool, gzip: bool) -> bytes:
        body = self._metrics(openmetrics)
        return compress(body) if gzip else body


def _headers(size: int, *, openmetrics: bool, gzip: bool) -> MutableHeaders:
    headers = MutableHeaders(
        {
            "Content-Type": OPENMETRICS if openmetrics else TEXT,
            "Content-Length": str(size),
            "Vary": "Accept, Accept-Encoding",
        }
    )
    if gzip:
        headers["Content-Encoding"] = "gzip"
    return headers
