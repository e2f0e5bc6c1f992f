"""What applies to every path: limits of requests, the login, and security headers."""

from __future__ import annotations

import base64
import hashlib
import time

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ros_diagnostics_exporter.web.auth import Buckets, Logins
from ros_diagnostics_exporter.web.pages import SCRIPT, STYLE
from ros_diagnostics_exporter.web.protocol import MAX_HEADER_BYTES
from ros_diagnostics_exporter.web.webconfig import LiveWebConfig
from ros_diagnostics_exporter.web.workers import BusyError

MAX_TARGET_BYTES = 8 * 1024  # path and query


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


# The pages have one inline style sheet, one script, which asks this exporter, and forms to it.
DEFAULT_HEADERS = {
    "Content-Security-Policy": (
        f"default-src 'none'; style-src {_hash(STYLE)}; script-src {_hash(SCRIPT)}; "
        "connect-src 'self'; base-uri 'none'; form-action 'self'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "deny",
    "Referrer-Policy": "same-origin",  # forms of the pages have an Origin by this
    "Cache-Control": "no-store",
}
_CLOSE = {"Connection": "close"}
_URL_TOO_LONG = PlainTextResponse("the URL is too long\n", 414, _CLOSE)
_HEADERS_TOO_LARGE = PlainTextResponse("the headers are too large\n", 431, _CLOSE)
_TWO_LENGTHS = PlainTextResponse(
    "Content-Length and Transfer-Encoding exclude each other\n", 400, _CLOSE
)
_RATE_LIMITED = PlainTextResponse("too many requests\n", 429, {"Retry-After": "1"})
_BUSY = PlainTextResponse("too many logins are waiting\n", 503, {"Retry-After": "1"})
_UNAUTHORIZED = PlainTextResponse(
    "Unauthorized\n",
    401,
    {"WWW-Authenticate": 'Basic realm="ros-diagnostics-exporter", charset="UTF-8"'},
)


class AccessControl:
    """ASGI middleware around the whole application."""

    def __init__(self, app: ASGIApp, web_config: LiveWebConfig, logins: Logins) -> None:
        self._app = app
        self._web_config = web_config
        self._logins = logins
        self._buckets = Buckets()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on, or respond with the reason why it is rejected."""
        app = _malformed(scope) or await self._authorize(scope)
        await app(scope, receive, self._with_headers(send))

    async def _authorize(self, scope: Scope) -> ASGIApp:
        config, connection = self._web_config.config, scope["state"]["connection"]
        limit, now = config.rate_limit, time.monotonic()
        if not self._buckets.take(connection.address, limit.interval, limit.burst, now):
            return _RATE_LIMITED
        users = config.basic_auth_users
        if not users:
            return self._app
        try:
            valid = await self._logins.allows(users, Headers(scope=scope).get("authorization", ""))
        except BusyError:
            return _BUSY
        connection.authenticated |= valid
        return self._app if valid else _UNAUTHORIZED

    def _with_headers(self, send: Send) -> Send:
        configured = self._web_config.config.http_server_config.headers.model_dump(by_alias=True)
        headers = {
            **DEFAULT_HEADERS,
            **{name: value for name, value in configured.items() if value},
        }

        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                response = MutableHeaders(scope=message)
                for name, value in headers.items():
                    response.setdefault(name, value)
            await send(message)

        return send_with_headers


def _malformed(scope: Scope) -> ASGIApp | None:
    """The response to a request that h11 lets pass and that is not answered otherwise."""
    # Limits: h11 checks only what comes in many parts.
    if len(scope["raw_path"]) + len(scope["query_string"]) > MAX_TARGET_BYTES:
        return _URL_TOO_LONG
    size = sum(len(name) + len(value) + len(b": \r\n") for name, value in scope["headers"])
    if size > MAX_HEADER_BYTES:
        return _HEADERS_TOO_LARGE
    # A proxy may see another end of it than we do (RFC 9112, 6.1).
    names = {name for name, _value in scope["headers"]}
    return _TWO_LENGTHS if names >= {b"content-length", b"transfer-encoding"} else None
