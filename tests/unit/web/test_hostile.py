"""Clients that are slow or hostile, with a legitimate scrape going on beside them."""

from __future__ import annotations

import contextlib
import socket
import threading
import time

import pytest

from ros_diagnostics_exporter.web import guard, scrape
from ros_diagnostics_exporter.web.guard import Phase

from .conftest import ask, connect, wait_until

GET = b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n"
BIG = b"x" * 30_000_000  # 1,000 robots


@pytest.fixture
def short(monkeypatch):
    """Sets a time-out, in seconds; all others are too long for the test to end by them."""
    for phase in Phase:
        monkeypatch.setitem(guard.TIMEOUTS, phase, 1_000.0)

    def shorten(phase: Phase, seconds: float = 0.3) -> None:
        monkeypatch.setitem(guard.TIMEOUTS, phase, seconds)

    return shorten


def ended(sock: socket.socket) -> bool:
    """Whether the server ends the connection; False if it does nothing for a while."""
    sock.settimeout(10)
    try:
        while sock.recv(1_000_000):
            pass
    except ConnectionError:
        return True
    except TimeoutError:
        return False
    return True


def drip(sock: socket.socket, data: bytes, pause: float = 0.0) -> bool:
    """Send byte by byte; whether the server ended the connection."""
    try:
        for byte in data:
            sock.sendall(bytes([byte]))
            threading.Event().wait(pause)
    except ConnectionError:
        return True
    return False


def test_a_request_that_arrives_byte_by_byte_is_cut_off(serve, short):
    short(Phase.REQUEST)
    server = serve()
    with connect(server) as sock:
        assert drip(sock, b"GET /metrics HTTP/1.1\r\nX: " + b"a" * 1_000, pause=0.05)


def test_the_next_request_on_a_connection_may_not_take_longer_than_the_first(serve, short):
    short(Phase.REQUEST)
    server = serve()
    with connect(server) as sock:
        sock.sendall(GET)
        assert sock.recv(1_000).startswith(b"HTTP/1.1 200")
        assert drip(sock, b"GET /metrics HTTP/1.1\r\nX: " + b"a" * 1_000, pause=0.05)


@pytest.mark.parametrize("said", [b"", b"\r\n", b"GET / HT"])
def test_a_connection_that_says_too_little_is_closed(serve, short, said):
    short(Phase.REQUEST)
    server = serve()
    with connect(server) as sock:
        sock.sendall(said)
        assert ended(sock)


def test_a_kept_alive_connection_is_reused_and_closed_when_it_stays_idle(serve, short):
    short(Phase.IDLE)
    server = serve()
    with connect(server) as sock:
        for _ in range(3):
            sock.sendall(GET)
            received = b""
            while not received.endswith(b"text\n"):
                received += sock.recv(1_000)
        assert ended(sock)


def test_hundreds_of_idle_connections_do_not_keep_a_scrape_out(serve, short, monkeypatch):
    # Both ends of each are here, and an ordinary user may open 1,024 files.
    monkeypatch.setattr(guard, "MAX_CONNECTIONS", 300)
    server = serve()
    with contextlib.ExitStack() as crowd:
        idle = [crowd.enter_context(connect(server)) for _ in range(guard.MAX_CONNECTIONS + 100)]
        assert ask(server, "/metrics").status == 200
        connections = server._uvicorn.server_state.connections
        wait_until(lambda: len(connections) <= guard.MAX_CONNECTIONS)
        assert ended(idle[0])  # who waited longest had to go
        assert len(connections) > guard.MAX_CONNECTIONS - 10
        assert ask(server, "/metrics").status == 200


def test_hundreds_of_dripping_connections_do_not_keep_a_scrape_out(serve, short):
    short(Phase.REQUEST, 2.0)
    server = serve()
    with contextlib.ExitStack() as crowd:
        loris = [crowd.enter_context(connect(server)) for _ in range(400)]
        answered = 0
        deadline = time.monotonic() + 60
        while loris and time.monotonic() < deadline:
            loris = [sock for sock in loris if not drip(sock, b"G")]
            assert ask(server, "/metrics").status == 200
            answered += 1
        assert not loris
        assert answered > 0


def test_large_headers_are_refused_and_the_connection_closed(serve, short):
    server = serve()
    with connect(server) as sock:
        sock.sendall(b"GET / HTTP/1.1\r\nX: " + b"a" * 20_000)
        assert sock.recv(1_000).startswith(b"HTTP/1.1 400")
        assert ended(sock)


def test_many_headers_are_refused_and_the_connection_closed(serve, short):
    server = serve()
    with connect(server) as sock:
        with contextlib.suppress(ConnectionError):
            sock.sendall(b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 100_000)
        assert ended(sock)
    assert ask(server, "/metrics").status == 200


@pytest.mark.parametrize("path", [b"/-/reload", b"/metrics", b"/nothing"])
def test_a_body_without_end_is_neither_read_nor_waited_for(serve, short, path):
    short(Phase.REQUEST)
    server = serve()
    with connect(server) as sock:
        sock.sendall(
            b"POST " + path + b" HTTP/1.1\r\nHost: x\r\nContent-Length: 99999999999\r\n\r\n"
        )
        assert sock.recv(1_000).startswith(b"HTTP/1.1 40")
        assert drip(sock, b"x" * 10_000, pause=0.01)


def test_garbage_is_refused(serve, short):
    server = serve()
    for garbage in (
        b"\x16\x03\x01\x02\x00\x01\x00",
        b"GET\r\n\r\n",
        b"\0" * 100,
        b"GET / HTTP/9\r\n\r\n",
    ):
        with connect(server) as sock:
            sock.sendall(garbage + b"\r\n\r\n")
            assert ended(sock), garbage
    assert ask(server, "/metrics").status == 200


def test_pipelined_requests_are_answered_one_after_the_other(serve, short):
    server = serve()
    with connect(server) as sock:
        sock.sendall(GET * 99 + GET.replace(b"Host", b"Connection: close\r\nHost"))
        received = b""
        while piece := sock.recv(100_000):
            received += piece
    assert received.count(b"HTTP/1.1 200 OK") == 100
    assert received.count(b"\r\n\r\ntext\n") == 100


def test_a_client_that_does_not_read_its_answer_is_cut_off(serve, short):
    short(Phase.READING)
    short(Phase.ANSWER)
    server = serve(metrics=lambda _: BIG)
    with connect(server) as sock:
        sock.sendall(GET)
        wait_until(lambda: not server._uvicorn.server_state.connections)


def test_clients_that_do_not_read_do_not_keep_a_scrape_out(serve, short):
    server = serve(metrics=lambda _: BIG)
    with contextlib.ExitStack() as crowd:
        for _ in range(2 * scrape.MAX_ANSWERS):
            crowd.enter_context(connect(server)).sendall(GET)
        for _ in range(3):
            assert ask(server, "/metrics").body == BIG


def test_a_scrape_that_waits_too_long_for_its_turn_is_told_to_come_again(serve, short, monkeypatch):
    monkeypatch.setattr(scrape, "PATIENCE", 0.0)
    release, entered = threading.Event(), threading.Event()

    def slow(_openmetrics):
        entered.set()
        assert release.wait(20)
        return b"slow\n"

    server = serve(metrics=slow)
    with contextlib.ExitStack() as crowd:
        for _ in range(scrape.MAX_ANSWERS):
            crowd.enter_context(connect(server)).sendall(GET)
        assert entered.wait(20)
        wait_until(lambda: len(server._uvicorn.server_state.tasks) == scrape.MAX_ANSWERS)
        answer = ask(server, "/metrics")
        assert (answer.status, answer.headers["Retry-After"]) == (503, "1")
        release.set()
    wait_until(lambda: ask(server, "/metrics").status == 200)


def test_a_flood_of_slow_questions_does_not_delay_a_scrape(serve, short):
    release, entered = threading.Event(), threading.Event()

    def slow(_wanted):
        entered.set()
        assert release.wait(20)
        return []

    server = serve(events=slow)
    with contextlib.ExitStack() as crowd:
        for _ in range(200):
            sock = crowd.enter_context(connect(server))
            sock.sendall(GET.replace(b"/metrics", b"/api/v1/events"))
        assert entered.wait(20)
        assert ask(server, "/metrics").status == 200
        # The next ones are told to come again instead of waiting for ever.
        wait_until(lambda: ask(server, "/api/v1/events").status == 503)
        release.set()
    wait_until(lambda: ask(server, "/api/v1/events").status == 200)


def test_a_tls_handshake_that_does_not_go_on_is_cut_off(serve, short, tls_config):
    short(Phase.REQUEST)
    server = serve(web_config=tls_config)
    with connect(server) as sock:
        sock.sendall(b"\x16\x03\x01")
        assert ended(sock)


def test_stopping_does_not_wait_for_clients(serve, short, monkeypatch, caplog):
    monkeypatch.setattr("ros_diagnostics_exporter.web.server.GRACE", 1)
    before = set(threading.enumerate())
    server = serve(metrics=lambda _: BIG)
    with connect(server) as reader, connect(server):
        reader.sendall(GET)
        assert reader.recv(1_000).startswith(b"HTTP/1.1 200")
        server.stop()
    assert set(threading.enumerate()) <= before
    assert not caplog.records  # that somebody did not read is no error of ours
