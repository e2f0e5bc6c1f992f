"""The gate before every path: limits of requests, the login, and headers for the browser."""

from __future__ import annotations

import base64
import hashlib
import time

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ros_diagnostics_exporter.web.auth import Buckets, Logins
from ros_diagnostics_exporter.web.live_config import Settings
from ros_diagnostics_exporter.web.pages import STYLE
from ros_diagnostics_exporter.web.protocol import MAX_HEADER_BYTES
from ros_diagnostics_exporter.web.workers import BusyError

MAX_TARGET_BYTES = 8 * 1024  # path and query
_STYLE_HASH = base64.b64encode(hashlib.sha256(STYLE.encode()).digest()).decode()
# The pages have one style sheet, in the page, and nothing else: no script, image, frame or form.
DEFAULTS = {
    "Content-Security-Policy": (
        f"default-src 'none'; style-src 'sha256-{_STYLE_HASH}'; "
        "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "deny",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
_CLOSE = {"Connection": "close"}
_LONG_TARGET = PlainTextResponse("the URL is too long\n", 414, _CLOSE)
_LARGE_HEADERS = PlainTextResponse("the headers are too large\n", 431, _CLOSE)
_LIMITED = PlainTextResponse("too many requests\n", 429, {"Retry-After": "1"})
_BUSY = PlainTextResponse("too many logins wait\n", 503, {"Retry-After": "1"})
_UNKNOWN = PlainTextResponse(
    "Unauthorized\n",
    401,
    {"WWW-Authenticate": 'Basic realm="ros-diagnostics-exporter", charset="UTF-8"'},
)


class Gate:
    """ASGI middleware that the whole application stands behind."""

    def __init__(self, app: ASGIApp, settings: Settings, logins: Logins) -> None:
        self._app = app
        self._settings = settings
        self._logins = logins
        self._buckets = Buckets()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let the request in, or answer it with what is missing."""
        self._settings.refresh()
        app = _too_large(scope) or await self._choose(scope)
        await app(scope, receive, self._with_headers(send))

    async def _choose(self, scope: Scope) -> ASGIApp:
        config, connection = self._settings.config, scope["state"]["connection"]
        limit, now = config.rate_limit, time.monotonic()
        if not self._buckets.take(connection.address, limit.interval, limit.burst, now):
            return _LIMITED
        users = config.basic_auth_users
        if not users:
            return self._app
        try:
            known = await self._logins.allows(users, Headers(scope=scope).get("authorization", ""))
        except BusyError:
            return _BUSY
        connection.known |= known
        return self._app if known else _UNKNOWN

    def _with_headers(self, send: Send) -> Send:
        said = self._settings.config.http_server_config.headers.model_dump(by_alias=True)
        wanted = {**DEFAULTS, **{name: value for name, value in said.items() if value}}

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in wanted.items():
                    headers.setdefault(name, value)
            await send(message)

        return send_with_headers


def _too_large(scope: Scope) -> ASGIApp | None:
    """The answer to a request above the limits; h11 has them only for what comes in many parts."""
    if len(scope["raw_path"]) + len(scope["query_string"]) > MAX_TARGET_BYTES:
        return _LONG_TARGET
    size = sum(len(name) + len(value) + len(b": \r\n") for name, value in scope["headers"])
    return _LARGE_HEADERS if size > MAX_HEADER_BYTES else None
