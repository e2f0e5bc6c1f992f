"""The gate before every path: the limit of requests, the login, and headers for the browser."""

from __future__ import annotations

import base64
import hashlib
import time

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .auth import Bucket, Logins
from .calls import BusyError
from .pages import STYLE
from .settings import Settings

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
        self._bucket = Bucket()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Let the request in, or answer it with what is missing."""
        self._settings.refresh()
        app = await self._choose(Headers(scope=scope).get("authorization", ""))
        await app(scope, receive, self._with_headers(send))

    async def _choose(self, authorization: str) -> ASGIApp:
        config = self._settings.config
        limit = config.rate_limit
        if not self._bucket.take(limit.interval, limit.burst, time.monotonic()):
            return _LIMITED
        users = config.basic_auth_users
        try:
            known = not users or await self._logins.allows(users, authorization)
        except BusyError:
            return _BUSY
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
