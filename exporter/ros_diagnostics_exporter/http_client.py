"""A small JSON client over HTTP(S), with the standard library alone.

A request has one time limit, from connecting to the last byte of the answer, whatever the server
does in between. A redirect is an error: the text of an error may be shown to anybody, and would
say which ports of other hosts are open.

Used by the commands, and by the exporter for Alertmanager and Prometheus. A Nagios check is a new
process every time, so every import here is paid at every check.
"""

from __future__ import annotations

import base64
import http.client
import json
import socket
import ssl
import time
import urllib.parse
from collections.abc import Iterator
from copy import copy
from pathlib import Path
from typing import Any, cast

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
        timeout: Seconds from connecting to the last byte of the response.
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
        self._authorization: str | None = None

    def logged_in(self, authorization: str) -> Client:
        """The same client with this header in place of a user and a password."""
        other = copy(self)
        other._authorization = authorization  # noqa: SLF001 - of this class
        return other

    def fleet(self, robots: tuple[str, ...] = ()) -> dict[str, Any]:
        """The fleet as the exporter's /api/v1/fleet returns it; only ``robots`` if any are named.

        Raises:
            UnreachableError: No response, or the server is not an exporter.
        """
        return self.ask("/api/v1/fleet", "robots", robot=robots or None)

    def events(self, since: str, **wanted: str) -> Iterator[dict[str, Any]]:
        """The events that are not older than ``since``, as "10m", the newest first.

        ``wanted`` are other parameters of /api/v1/events: ``robot``, ``kind``.

        Raises:
            UnreachableError: No response, or the server is not an exporter.
        """
        query = {**wanted, "since": since, "limit": "10000"}
        while True:
            page = self.ask("/api/v1/events", "events", **query)
            yield from page["events"]
            if "next" not in page:
                return
            query["before"] = str(page["next"])

    def ask(self, path: str, *keys: str, **query: str | tuple[str, ...] | None) -> dict[str, Any]:
        """The exporter's answer at ``path``, which has these keys; ``query`` None is not given.

        Raises:
            UnreachableError: No response, or the server is not an exporter.
        """
        given = {name: value for name, value in query.items() if value is not None}
        path += f"?{urllib.parse.urlencode(given, doseq=True)}" if given else ""
        found = self.get(path)
        if not isinstance(found, dict) or not found.keys() >= {*keys}:
            raise UnreachableError(f"{self.url}{path} is not a ROS diagnostics exporter")
        return found

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
            where = f"{self.url.rstrip('/')}{path.partition('?')[0]}"
            raise UnreachableError(f"{where}: the answer is not JSON") from error

    def _bytes(self, path: str, body: Any, limit: int, method: str | None = None) -> bytes:
        url = self.url.rstrip("/") + path
        try:
            connection, target = self._connection(url)
            content = None if body is None else json.dumps(body).encode()
            headers = {"Connection": "close", **self._login()}
            if content is not None:
                headers["Content-Type"] = "application/json"
            try:
                method = method or ("GET" if content is None else "POST")
                connection.request(method, target, content, headers)
                with connection.getresponse() as response:
                    return _read(response, url, limit)
            finally:
                connection.close()
        except (OSError, ValueError, http.client.HTTPException) as error:
            # Without the question: it may be a page long.
            raise UnreachableError(f"{url.partition('?')[0]}: {_reason(error)}") from error

    def _connection(self, url: str) -> tuple[_Connection, str]:
        """A connection to the server, and what to ask it for."""
        parts = urllib.parse.urlsplit(url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError("it is not the URL of a server, such as http://HOST:PORT")
        # Reading all CAs costs a quarter of a whole check.
        tls = self._tls_context() if parts.scheme == "https" else None
        port = parts.port or (http.client.HTTP_PORT if tls is None else http.client.HTTPS_PORT)
        target = urllib.parse.urlunsplit(("", "", parts.path or "/", parts.query, ""))
        return _Connection(parts.hostname, port, time.monotonic() + self._timeout, tls), target

    def _tls_context(self) -> ssl.SSLContext:
        try:
            context = ssl.create_default_context(cafile=self._ca_file)
            if self._cert_file is not None:
                context.load_cert_chain(self._cert_file, self._key_file)
        except OSError as error:  # which does not name the file
            files = filter(None, (self._ca_file, self._cert_file, self._key_file))
            names = ", ".join(map(str, files))
            raise UnreachableError(f"{names}: cannot be used: {error.strerror}") from error
        return context

    def _login(self) -> dict[str, str]:
        if self._authorization is not None:
            return {"Authorization": self._authorization}
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


class _Socket(socket.socket):
    """A socket that waits until a moment, not for a time between two pieces."""

    deadline: float  # monotonic

    def wait_no_longer(self) -> None:
        """Let the next call take what is left of the time."""
        left = self.deadline - time.monotonic()
        if left <= 0:
            raise TimeoutError("timed out")
        self.settimeout(left)

    def recv_into(self, *given: Any, **named: Any) -> int:
        self.wait_no_longer()
        return super().recv_into(*given, **named)

    def send(self, *given: Any, **named: Any) -> int:
        self.wait_no_longer()
        return super().send(*given, **named)

    def sendall(self, *given: Any, **named: Any) -> None:
        self.wait_no_longer()
        super().sendall(*given, **named)


class _TlsSocket(_Socket, ssl.SSLSocket):
    """The same with TLS."""


class _Connection(http.client.HTTPConnection):
    """A connection that ends at ``deadline`` (monotonic), with TLS where ``tls`` is given."""

    def __init__(self, host: str, port: int, deadline: float, tls: ssl.SSLContext | None) -> None:
        super().__init__(host, port)
        self._deadline = deadline
        self._tls = tls
        self.default_port = http.client.HTTP_PORT if tls is None else http.client.HTTPS_PORT

    def connect(self) -> None:
        """Connect to the first of the host's addresses that answers."""
        self.sock = connected = self._connected()
        if self._tls is not None:
            connected.wait_no_longer()
            self._tls.sslsocket_class = _TlsSocket
            secured = self._tls.wrap_socket(connected, server_hostname=self.host)
            cast("_TlsSocket", secured).deadline = self._deadline
            self.sock = secured

    def _connected(self) -> _Socket:
        failed: OSError | None = None
        for family, kind, protocol, _name, address in socket.getaddrinfo(
            self.host, self.port, type=socket.SOCK_STREAM
        ):
            tried = _Socket(family, kind, protocol)
            tried.deadline = self._deadline
            try:
                tried.wait_no_longer()
                tried.connect(address)
            except OSError as error:
                tried.close()
                failed = error
            else:
                return tried
        raise failed or OSError("it has no address")


def _read(response: http.client.HTTPResponse, url: str, limit: int) -> bytes:
    """The whole body of an answer that is no error."""
    if response.status >= http.client.MULTIPLE_CHOICES:
        what = f"{url} answered {response.status} {response.reason}"
        raise AnsweredError(what, response.status, _beginning(response))
    chunks: list[bytes] = []
    size = 0
    while chunk := response.read1(CHUNK):
        chunks.append(chunk)
        size += len(chunk)
        if size > limit:
            raise ValueError(f"answered more than {limit} bytes")
    if response.length:  # bytes are missing; only read() would have noticed
        raise http.client.IncompleteRead(b"".join(chunks), response.length)
    return b"".join(chunks)


def _reason(error: Exception) -> str:
    """Why there is no answer, without the number of an error of the network."""
    if isinstance(error, (ConnectionError, socket.gaierror)) and error.strerror:
        return error.strerror
    return str(error) or type(error).__name__


def _beginning(response: http.client.HTTPResponse) -> bytes:
    """The body of an error, as far as it arrives; the error counts, not its body."""
    body = b""
    try:
        while len(body) < MAX_ERROR and (chunk := response.read1(MAX_ERROR - len(body))):
            body += chunk
    except (OSError, http.client.HTTPException):
        return body
    return body
