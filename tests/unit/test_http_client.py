"""The HTTP client: one time limit from connecting to the last byte, and no redirects."""

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler

import pytest

from ros_diagnostics_exporter.http_client import AnsweredError, Client, UnreachableError
from support.loopback import answering

TIMEOUT = 0.5
FINE = b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}"


@contextmanager
def dripping(at_once: bytes, pace: float = 0.1) -> Iterator[str]:
    """A server that sends some bytes at once, and then one after the other without end."""
    ended = threading.Event()

    def answer(listener: socket.socket) -> None:
        with suppress(OSError), listener.accept()[0] as connection:
            connection.sendall(at_once)
            while not ended.wait(pace):
                connection.sendall(b"x")

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=answer, args=(listener,))
        thread.start()
        yield f"127.0.0.1:{listener.getsockname()[1]}"
        ended.set()
        thread.join()


@pytest.mark.parametrize(
    "at_once",
    [
        pytest.param(b"", id="status line"),
        pytest.param(b"HTTP/1.1 200 OK\r\nX-A: ", id="header"),
        pytest.param(b"HTTP/1.1 100 Continue\r\nX-A: ", id="header of a 100"),
        pytest.param(b"HTTP/1.1 200 OK\r\nContent-Length: 99999\r\n\r\n", id="body"),
        pytest.param(b"HTTP/1.1 500 No\r\nContent-Length: 99999\r\n\r\n", id="body of an error"),
        pytest.param(
            b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n1;", id="size of a chunk"
        ),
    ],
)
def test_no_server_stretches_the_time_limit(at_once):
    with dripping(at_once) as address:
        begin = time.monotonic()
        with pytest.raises(UnreachableError):
            Client(f"http://{address}", timeout=TIMEOUT).get("/")
        assert time.monotonic() - begin < TIMEOUT + 0.5


def test_no_server_stretches_the_handshake_of_tls():
    record = b"\x16\x03\x03\x40\x00"  # the head of a handshake of 16 kB
    with dripping(record) as address:
        begin = time.monotonic()
        with pytest.raises(UnreachableError, match="timed out"):
            Client(f"https://{address}", timeout=TIMEOUT).get("/")
        assert time.monotonic() - begin < TIMEOUT + 0.5


def test_a_name_with_many_addresses_does_not_stretch_it(monkeypatch):
    """Each is tried in what is left of the time."""
    with socket.socket() as full:
        full.bind(("127.0.0.1", 0))
        full.listen(0)  # accepts nothing: what is beyond its queue gets no answer
        address = full.getsockname()
        found = [(socket.AF_INET, socket.SOCK_STREAM, 6, "", address)] * 20
        monkeypatch.setattr(socket, "getaddrinfo", lambda *_args, **_kwargs: found)
        waiting = [socket.socket() for _ in range(8)]
        for each in waiting:
            each.setblocking(False)
            each.connect_ex(address)
        begin = time.monotonic()
        with pytest.raises(UnreachableError, match="timed out"):
            Client("http://many.invalid", timeout=TIMEOUT).get("/")
        assert time.monotonic() - begin < TIMEOUT + 0.5
        for each in waiting:
            each.close()


def test_a_redirect_is_not_followed():
    """It would tell open ports from closed ones to whom the error's text is shown."""
    asked = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            asked.append(self.path)
            self.send_response(302)
            self.send_header("Location", "/elsewhere")
            self.send_header("Content-Length", "0")
            self.end_headers()

    with answering(Handler) as address, pytest.raises(AnsweredError, match="answered 302 Found"):
        Client(f"http://{address}").get("/api")
    assert asked == ["/api"]


@pytest.mark.parametrize("url", ["ftp://127.0.0.1", "127.0.0.1:80", "http://", "http://[::1", ""])
def test_an_url_that_is_none_is_an_error(url):
    with pytest.raises(UnreachableError):
        Client(url).get("/")
