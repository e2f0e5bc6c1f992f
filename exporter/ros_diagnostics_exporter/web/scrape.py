"""The metrics endpoint: content negotiation, parts, compression, sharing by concurrent scrapes."""

from __future__ import annotations

import zlib
from collections.abc import Iterable, Sequence

from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.types import Receive, Scope, Send

from ros_diagnostics_exporter.model import ALL_PARTS, Part
from ros_diagnostics_exporter.web.api import ApiError
from ros_diagnostics_exporter.web.backend import Backend
from ros_diagnostics_exporter.web.responses import ResponseLimit, Workers, in_chunks, send_chunks

TEXT = "text/plain; version=0.0.4; charset=utf-8"
OPENMETRICS = "application/openmetrics-text; version=1.0.0; charset=utf-8"
FIRST_SIZE = 8 << 20  # bytes reserved for a response until one was rendered
GZIP_LEVEL = 1  # 20 MB: 34 ms and 0.64 MB at level 1, 100 ms and 0.47 MB at level 6


_KNOWN = ", ".join(part.value for part in Part)


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
    """Whether OpenMetrics is accepted with at least the quality of plain text."""
    quality = parse_accept(accept)
    openmetrics = quality.get("application/openmetrics-text", 0.0)
    return openmetrics > 0 and openmetrics >= quality.get("text/plain", 0.0)


def wants_gzip(accept_encoding: str) -> bool:
    """Whether the client accepts gzip."""
    quality = parse_accept(accept_encoding)
    return quality.get("gzip", quality.get("*", 0.0)) > 0


def wanted_parts(query: bytes) -> frozenset[Part]:
    """The parts that ``collect[]`` names, all but those that ``exclude[]`` names, or all.

    Args:
        query: The URL's, as received. Other parameters are ignored.

    Raises:
        ApiError: It names both, or what is no part.
    """
    parameters = QueryParams(query)
    collect, exclude = _named(parameters, "collect[]"), _named(parameters, "exclude[]")
    if collect and exclude:
        what = "collect[] and exclude[] cannot be combined: give one of them"
        raise ApiError(400, f"{what}, with some of {_KNOWN}")
    return collect or ALL_PARTS - exclude


def _named(parameters: QueryParams, name: str) -> frozenset[Part]:
    found = set(parameters.getlist(name))
    unknown = sorted(found - {part.value for part in Part})
    if unknown:
        raise ApiError(400, f"{name} is {unknown[0]!r:.80}, not one of {_KNOWN}")
    return frozenset(map(Part, found))


def compress(pieces: Iterable[bytes]) -> bytes:
    """The pieces as gzip; zlib releases the interpreter lock."""
    compressor = zlib.compressobj(GZIP_LEVEL, wbits=31)
    found = [compressor.compress(chunk) for chunk in in_chunks(pieces)]
    return b"".join([*found, compressor.flush()])


class Scrape:
    """The metrics endpoint, an ASGI application.

    Args:
        backend: Renders the exposition.
        workers: Where it is rendered and compressed.
        limit: Of the responses' bytes.
    """

    def __init__(self, backend: Backend, workers: Workers, limit: ResponseLimit) -> None:
        self._backend = backend
        self._workers = workers
        self._limit = limit
        # of the last response of each kind
        self._sizes: dict[tuple[bool, bool, frozenset[Part]], int] = {}

    async def __call__(self, scope: Scope, _receive: Receive, send: Send) -> None:
        """Send the exposition; BusyError after waiting too long, ApiError for a wrong query."""
        connection, headers = scope["state"]["connection"], Headers(scope=scope)
        parts = wanted_parts(scope["query_string"])
        openmetrics = wants_openmetrics(headers.get("accept", ""))
        gzip = wants_gzip(headers.get("accept-encoding", ""))
        # Before it is rendered: a waiting request must not hold an exposition.
        kind = openmetrics, gzip, parts
        size = self._sizes.get(kind, FIRST_SIZE)
        await self._limit.reserve_or_wait(connection, size)
        try:
            # Shared by kind; there are 32, whatever clients ask for.
            pieces = await self._workers.run_shared(0, self._render, *kind)
            size = self._sizes[kind] = sum(map(len, pieces))
            self._limit.resize(connection, size)
            raw = _response_headers(size, openmetrics=openmetrics, gzip=gzip).raw
            await send({"type": "http.response.start", "status": 200, "headers": raw})
            await send_chunks(pieces, send)
            self._backend.count_scrape()
        finally:
            self._limit.release(connection)

    def _render(self, openmetrics: bool, gzip: bool, parts: frozenset[Part]) -> Sequence[bytes]:
        # Those that are kept, of 20 MB: joined only as they are sent.
        pieces = self._backend.render_metrics(openmetrics, parts)
        return [compress(pieces)] if gzip else pieces


def _response_headers(size: int, *, openmetrics: bool, gzip: bool) -> MutableHeaders:
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
