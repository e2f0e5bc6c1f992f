"""A small JSON client over HTTP(S), with the standard library alone.

Used by the commands, and by the exporter for Alertmanager. A Nagios check is a new process every
time, so every import here is paid at every check.
"""

from __future__ import annotations

import base64
import http.client
import json
import ssl
import time
import urllib.error
import urllib.parse
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

LIMIT = 256 * 1024 * 1024  # bytes of a response; a fleet of 1,000 robots has some four million
CHUNK = 64 * 1024  # bytes read at once


MAX_ERROR = 16 * 1024  # bytes of an error's body that are read


class UnreachableError(Exception):
    """There is no usable response from the server; the text names the URL and the reason."""


class AnsweredError(UnreachableError):
    """The server answered an HTTP error: ``body`` is the beginning of what it said."""

    def __init__(self, text: str, status: int, body: bytes) -> None:
        super().__init__(text)
        self.status = status
        self.body = body


class Client:
    """Sends requests to one server.

    Args:
        url: Of the server; paths are appended to it.
        timeout: Seconds for a whole response.
        user: For basic authentication; needs a password_file.
        password_file: Holds the password in one line; read for each request.
        bearer_token_file: Holds a bearer token in one line, in place of user and password; read
            for each request.
        ca_file: The CA that signed the server's certificate; None: the system's.
        cert_file: The client's own certificate.
        key_file: The key of cert_file.
    """

    def __init__(
        self,
        url: str,
        *,
        timeout: float = 10.0,
        user: str | None = None,
        password_file: Path | None = None,
        bearer_token_file: Path | None = None,
        ca_file: Path | None = None,
        cert_file: Path | None = None,
        key_file: Path | None = None,
    ) -> None:
        self.url = url
        self._timeout = timeout
        self._user = user
        self._password_file = password_file
        self._bearer_token_file = bearer_token_file
        self._ca_file = ca_file
        self._cert_file = cert_file
        self._key_file = key_file

    def fleet(self, robots: tuple[str, ...] = ()) -> dict[str, Any]:
        """The fleet as the exporter's /api/v1/fleet returns it; only ``robots`` if any are named.

        Raises:
            UnreachableError: No response, or the server is not an exporter.
        """
        query = urllib.parse.urlencode([("robot", name) for name in robots])
        path = "/api/v1/fleet" + (f"?{query}" if query else "")
        fleet = self.get(path)
        if not isinstance(fleet, dict) or "robots" not in fleet:
            raise UnreachableError(f"{self.url}{path} is not a ROS diagnostics exporter")
        return fleet

    def events(self, since: str, **wanted: str) -> Iterator[dict[str, Any]]:
        """The events that are not older than ``since``, as "10m", the newest first.

        ``wanted`` are other parameters of /api/v1/events: ``robot``, ``kind``.

        Raises:
            UnreachableError: No response, or the server is not an exporter.
        """
        query = {**wanted, "since": since, "limit": "10000"}
        while True:
            path = "/api/v1/events?" + urllib.parse.urlencode(query)
            page = self.get(path)
            if not isinstance(page, dict) or "events" not in page:
                raise UnreachableError(f"{self.url}{path} is not a ROS diagnostics exporter")
            yield from page["events"]
            if "next" not in page:
                return
            query["before"] = str(page["next"])

    def get(self, path: str, *, limit: int = LIMIT) -> Any:
        """The JSON at ``path``; None for an empty response.

        Raises:
            UnreachableError: No response, an HTTP error, more than ``limit`` bytes, or no JSON.
        """
        return self._request(path, None, limit)

    def download(self, path: str, *, limit: int = LIMIT) -> bytes:
        """The bytes at ``path``.

        Raises:
            UnreachableError: No response, an HTTP error, or more than ``limit`` bytes.
        """
        return self._bytes(path, None, limit)

    def post(self, path: str, body: Any) -> Any:
        """Post ``body`` as JSON; the JSON of the response, None for an empty one.

        Raises:
            UnreachableError: As for ``get``.
        """
        return self._request(path, body, LIMIT)

    def delete(self, path: str) -> Any:
        """Delete what is at ``path``; the JSON of the response, None for an empty one.

        Raises:
            UnreachableError: As for ``get``.
        """
        return self._request(path, None, LIMIT, method="DELETE")

    def _request(self, path: str, body: Any, limit: int, method: str | None = None) -> Any:
        try:
            text = self._bytes(path, body, limit, method)
            return json.loads(text) if text else None
        except (ValueError, RecursionError) as error:  # deeply nested JSON is the latter
            raise UnreachableError(f"{self.url.rstrip('/')}{path}: {error}") from error

    def _bytes(self, path: str, body: Any, limit: int, method: str | None = None) -> bytes:
        url = self.url.rstrip("/") + path
        content = None if body is None else json.dumps(body).encode()
        try:
            headers = {} if body is None else {"Content-Type": "application/json"}
            opener = urllib.request.build_opener(*self._handlers())
            request = urllib.request.Request(  # noqa: S310 - the user's
                url, content, headers, method=method
            )
            for name, login in self._login().items():
                request.add_unredirected_header(name, login)  # a redirect may lead anywhere
            with opener.open(request, timeout=self._timeout) as response:
                return _read(response, limit, time.monotonic() + self._timeout)
        except urllib.error.HTTPError as error:
            said = _beginning(error, time.monotonic() + self._timeout)
            what = f"{url} answered {error.code} {error.reason}"
            raise AnsweredError(what, error.code, said) from error
        except (OSError, ValueError, http.client.HTTPException) as error:
            # URLError is an OSError, a bad URL a ValueError.
            raise UnreachableError(f"{url}: {getattr(error, 'reason', None) or error}") from error

    def _handlers(self) -> list[urllib.request.BaseHandler]:
        # No proxies: the server is near, and those of the environment lead elsewhere.
        handlers: list[urllib.request.BaseHandler] = [urllib.request.ProxyHandler({})]
        if self.url.startswith("https:"):  # reading all CAs costs a quarter of a whole check
            handlers.append(urllib.request.HTTPSHandler(context=self._tls_context()))
        return handlers

    def _tls_context(self) -> ssl.SSLContext:
        try:
            context = ssl.create_default_context(cafile=self._ca_file)
            if self._cert_file is not None:
                context.load_cert_chain(self._cert_file, self._key_file)
        except OSError as error:  # which does not name the file
            files = filter(None, (self._ca_file, self._cert_file, self._key_file))
            raise UnreachableError(f"{', '.join(map(str, files))}: {error}") from error
        return context

    def _login(self) -> dict[str, str]:
        if self._bearer_token_file is not None:
            token = self._bearer_token_file.read_text("utf-8").strip()
            return {"Authorization": f"Bearer {token}"}
        if self._user is None:
            return {}
        if self._password_file is None:
            raise UnreachableError("--user needs --password-file")
        password = self._password_file.read_text("utf-8").rstrip("\r\n")
        encoded = base64.b64encode(f"{self._user}:{password}".encode()).decode()
        return {"Authorization": f"Basic {encoded}"}


def _beginning(error: urllib.error.HTTPError, deadline: float) -> bytes:
    """The body of an error, as far as it arrives; the error counts, not its body."""
    body = b""
    try:
        while len(body) < MAX_ERROR and time.monotonic() < deadline:
            chunk = error.read1(MAX_ERROR - len(body))
            if not chunk:
                break
            body += chunk
    except (OSError, http.client.HTTPException):
        return body
    return body


def _read(response: http.client.HTTPResponse, limit: int, deadline: float) -> bytes:
    """The whole body. The socket's own timeout does not stop a server that sends byte by byte."""
    chunks: list[bytes] = []
    size = 0
    while chunk := response.read1(CHUNK):
        chunks.append(chunk)
        size += len(chunk)
        if size > limit:
            raise ValueError(f"answered more than {limit} bytes")
        if time.monotonic() > deadline:
            raise TimeoutError("timed out")
    if response.length:  # bytes are missing; only read() would have noticed
        raise http.client.IncompleteRead(b"".join(chunks), response.length)
    return b"".join(chunks)
