"""What applies to every path: limits of requests, the login, cross-site checks, security headers.

bcrypt takes a tenth of a second by design, so valid logins are cached until their hash changes.
Invalid ones are computed each time, in one thread with a short queue.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import ipaddress
import secrets
import socket
import time
from collections import OrderedDict
from collections.abc import Mapping
from urllib.parse import urlsplit

import bcrypt
from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from ros_diagnostics_exporter.rejected_logins import RejectedLogins
from ros_diagnostics_exporter.web.connections import MAX_HEADER_BYTES
from ros_diagnostics_exporter.web.pages import SCRIPT, STYLE
from ros_diagnostics_exporter.web.responses import BusyError, Workers
from ros_diagnostics_exporter.web.webconfig import LiveWebConfig

CACHED_LOGINS = 100
MAX_BUCKETS = 1_000  # addresses whose requests are counted
BCRYPT_BYTES = 72  # bcrypt ignores the rest of a password


def parse_basic(header: str) -> tuple[str, bytes] | None:
    """User and password of an Authorization header; None if it is not basic authentication."""
    scheme, _, coded = header.partition(" ")
    if scheme.lower() != "basic":
        return None
    try:
        user, colon, password = base64.b64decode(coded.strip(), validate=True).partition(b":")
    except (binascii.Error, ValueError):
        return None
    return (user.decode("utf-8", "replace"), password) if colon else None


class Logins:
    """Checks logins, in the same time for known and unknown users."""

    def __init__(self) -> None:
        self._workers = Workers("web-auth", threads=1, max_pending=20)
        self._secret = secrets.token_bytes(32)
        self._valid: OrderedDict[bytes, None] = OrderedDict()

    async def allows(
        self, users: Mapping[str, str], header: str, *, only_known: bool = False
    ) -> bool:
        """Whether ``header`` is a valid login of one of ``users`` (name -> bcrypt hash).

        ``only_known``: one that was verified before.

        Raises:
            BusyError: Too many logins are waiting to be checked.
        """
        login = parse_basic(header)
        if login is None:
            return False
        user, password = login
        hashed = users.get(user) or _dummy_hash(users)
        digest = self._digest(user, hashed, password)
        if digest in self._valid:
            return True
        if only_known:
            return False
        valid = await self._workers.run(_matches, password, hashed) and user in users
        if valid:
            self._cache(digest)
        return valid

    def close(self) -> None:
        """End the thread."""
        self._workers.close()

    def _digest(self, user: str, hashed: str, password: bytes) -> bytes:
        """The cache's key for a login; it has a fixed length and does not reveal the password."""
        parts = (hashlib.sha256(part).digest() for part in (user.encode(), hashed.encode()))
        return hmac.digest(self._secret, b"".join(parts) + password, "sha256")

    def _cache(self, digest: bytes) -> None:
        self._valid[digest] = None
        if len(self._valid) > CACHED_LOGINS:
            self._valid.popitem(last=False)


def _matches(password: bytes, hashed: str) -> bool:
    if b"\0" in password:
        return False
    return bcrypt.checkpw(password[:BCRYPT_BYTES], hashed.encode())


def _dummy_hash(users: Mapping[str, str]) -> str:
    """A hash that matches no password and costs as much as those of the users."""
    cost = max((hashed[4:6] for hashed in users.values()), default="10")
    return f"$2b${cost}$" + "." * 53


class Buckets:
    """A token bucket per client address; above MAX_BUCKETS the least recently used is dropped."""

    def __init__(self) -> None:
        self._buckets: OrderedDict[str, tuple[float, float]] = OrderedDict()  # tokens, when

    def take(self, address: str, interval: float, burst: int, now: float) -> bool:
        """Whether a request of ``address`` is allowed at ``now`` (monotonic seconds).

        One is every ``interval`` seconds, up to ``burst`` at once; interval 0 allows all.
        """
        if interval <= 0:
            return True
        tokens, last = self._buckets.pop(address, (burst, now))
        tokens = min(burst, tokens + (now - last) / interval)
        is_allowed = tokens >= 1
        self._buckets[address] = (tokens - is_allowed, now)
        if len(self._buckets) > MAX_BUCKETS:
            self._buckets.popitem(last=False)
        return is_allowed


def is_cross_site(headers: Mapping[str, str], scheme: str) -> bool:
    """Whether a browser sent this request for a page of another site.

    Only browsers send the headers that are examined here, and a page cannot suppress all of them.
    Requests of tools (curl, Prometheus, scripts) have none and are never cross-site.

    Args:
        headers: The request's; names in lower case.
        scheme: That the exporter itself serves, http or https.
    """
    # https://www.w3.org/TR/fetch-metadata/#sec-fetch-site-header; not sent over plain HTTP.
    if headers.get("sec-fetch-site", "none") not in {"none", "same-origin"}:
        return True
    page = headers.get("origin", headers.get("referer"))
    return page is not None and not _same_origin(page, headers.get("host", ""), scheme)


def _same_origin(page: str, host: str, scheme: str) -> bool:
    try:
        origin, own = urlsplit(page), urlsplit(f"//{host}")
        same = host != "" and origin.netloc.lower() == own.netloc.lower()
        # Without TLS here, a proxy in front may still serve https to browsers.
        return same and origin.scheme in {scheme, "https"} and _is_local_name(own.hostname or "")
    except ValueError:  # not a URL
        return False


def _is_local_name(host: str) -> bool:
    """Whether nobody else can register this name and point it here (DNS rebinding)."""
    try:
        ipaddress.ip_address(host)
    except ValueError:
        return "." not in host or host == socket.gethostname().lower()
    return True


MAX_TARGET_BYTES = 8 << 10  # path and query


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
_PAUSED = PlainTextResponse("too many wrong passwords\n", 429, {"Retry-After": "60"})
_BUSY = PlainTextResponse("too many logins are waiting\n", 503, {"Retry-After": "1"})
_UNAUTHORIZED = PlainTextResponse(
    "Unauthorized\n",
    401,
    {"WWW-Authenticate": 'Basic realm="ros-diagnostics-exporter", charset="UTF-8"'},
)


class AccessControl:
    """ASGI middleware around the whole application."""

    def __init__(
        self, app: ASGIApp, web_config: LiveWebConfig, logins: Logins, rejected: RejectedLogins
    ) -> None:
        self._app = app
        self._rejected = rejected
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
        header, address = Headers(scope=scope).get("authorization", ""), connection.address
        has_pause = self._rejected.has_pause(address, now)
        try:
            valid = await self._logins.allows(users, header, only_known=has_pause)
        except BusyError:
            return _BUSY
        if header and not valid:  # a browser asks without one first
            self._rejected.note(address, now)
        if has_pause and not valid:
            return _PAUSED
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
