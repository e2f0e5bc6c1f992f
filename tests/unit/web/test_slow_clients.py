"""Slow and hostile clients, with a legitimate scrape beside them."""

import base64
import contextlib
import errno
import http.client
import itertools
import socket
import ssl
import threading
import time

import bcrypt
import pytest

from ros_diagnostics_exporter.web import changes, connections, responses, scrape
from ros_diagnostics_exporter.web.connections import Phase
from support.web_server import ask, component, connect, fleet, robot, wait_until

GET = b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n"
BIG = b"x" * 30_000_000  # 1,000 robots


@pytest.fixture
def short(monkeypatch):
    """Sets a time-out, in seconds; all others are longer than the test."""
    for phase in Phase:
        monkeypatch.setitem(connections.TIMEOUTS, phase, 1_000.0)

    def shorten(phase: Phase, seconds: float = 0.3) -> None:
        monkeypatch.setitem(connections.TIMEOUTS, phase, seconds)

    return shorten


def read_until(sock: socket.socket, end: bytes) -> bytes:
    received = b""
    while end not in received:
        part = sock.recv(1_000)
        assert part, received
        received += part
    return received


def ended(sock: socket.socket) -> bool:
    """Whether the server ends the connection within 10 s."""
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


@pytest.mark.parametrize("before", [0, 1])
def test_a_request_that_arrives_byte_by_byte_times_out(serve, short, before):
    short(Phase.REQUEST)
    with connect(serve()) as sock:
        for _ in range(before):
            sock.sendall(GET)
            read_until(sock, b"text\n")
        assert drip(sock, b"GET /metrics HTTP/1.1\r\nX: " + b"a" * 1_000, pause=0.05)


@pytest.mark.parametrize("sent", [b"", b"GET / HT"])
def test_a_connection_without_a_complete_request_times_out(serve, short, sent):
    short(Phase.REQUEST)
    with connect(serve()) as sock:
        sock.sendall(sent)
        assert ended(sock)


def test_a_kept_alive_connection_is_reused_and_closed_when_idle(serve, short):
    short(Phase.IDLE)
    with connect(serve()) as sock:
        for _ in range(3):
            sock.sendall(GET)
            read_until(sock, b"text\n")
        assert ended(sock)


def test_hundreds_of_idle_connections_do_not_block_a_scrape(serve, short):
    server = serve()
    server.connections.limit = 300  # both ends of each are here: an ordinary user has 1,024 files
    with contextlib.ExitStack() as crowd:
        idle = [crowd.enter_context(connect(server)) for _ in range(400)]
        assert ask(server, "/metrics").status == 200
        connections = server._uvicorn.server_state.connections
        wait_until(lambda: len(connections) <= 300)
        assert ended(idle[0])  # the one that was idle longest is closed
        assert len(connections) > 290
        assert ask(server, "/metrics").status == 200


def test_hundreds_of_dripping_connections_do_not_block_a_scrape(serve, short):
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


@pytest.mark.parametrize(
    ("request_", "statuses"),
    [
        (b"GET / HTTP/1.1\r\nHost: x\r\nX: " + b"a" * 17_000, {431}),
        (b"GET / HTTP/1.1\r\nHost: x" + b"\r\nA: b" * 4_000, {431}),
        (b"GET /api/v1/fleet?robot=" + b"a" * 9_000 + b" HTTP/1.1\r\nHost: x", {414}),
        # 400 where it does not arrive in one piece: h11 gives up before the application sees it.
        (b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\nHost: x", {414, 400}),
    ],
)
def test_large_requests_are_rejected_also_in_one_piece(serve, short, request_, statuses):
    server = serve()
    with connect(server) as sock:
        sock.sendall(request_ + b"\r\n\r\n")
        assert int(sock.recv(1_000).split()[1]) in statuses
        assert ended(sock)
    answer = ask(server, "/-/healthy", X="a" * 15_000)
    assert answer.status == 200


def test_two_lengths_of_one_body_are_rejected_and_the_connection_closed(serve):
    with connect(serve()) as sock:
        sock.sendall(
            b"POST /api/v1/notifications HTTP/1.1\r\nHost: x\r\n"
            b"Content-Length: 4\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"
        )
        assert sock.recv(1_000).startswith(b"HTTP/1.1 400")
        assert ended(sock)


def test_a_client_that_leaves_within_its_body_logs_nothing(serve, caplog):
    server = serve()
    with connect(server) as sock:
        sock.sendall(
            b"POST /api/v1/notifications HTTP/1.1\r\nHost: x\r\nContent-Length: 100\r\n\r\n{"
        )
        wait_until(lambda: server._uvicorn.server_state.tasks)
    wait_until(lambda: not server._uvicorn.server_state.tasks)

    assert ask(server, "/-/healthy").status == 200
    assert not [each for each in caplog.records if each.levelname == "ERROR"]


def test_too_many_headers_are_rejected_and_the_connection_closed(serve, short):
    server = serve()
    with connect(server) as sock:
        with contextlib.suppress(ConnectionError):
            sock.sendall(b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 100_000)
        assert ended(sock)
    assert ask(server, "/metrics").status == 200


@pytest.mark.parametrize("path", [b"/-/reload", b"/metrics", b"/nothing"])
def test_an_endless_body_is_not_read(serve, short, path):
    short(Phase.REQUEST)
    with connect(serve()) as sock:
        sock.sendall(
            b"POST " + path + b" HTTP/1.1\r\nHost: x\r\nContent-Length: 99999999999\r\n\r\n"
        )
        assert sock.recv(1_000).startswith(b"HTTP/1.1 40")
        assert drip(sock, b"x" * 10_000, pause=0.01)


def test_garbage_is_rejected(serve, short):
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


def test_pipelined_requests_are_answered_in_order(serve, short):
    server = serve()
    with connect(server) as sock:
        sock.sendall(GET)
        read_until(sock, b"\r\n\r\ntext\n")
        [client] = server._uvicorn.server_state.connections
        assert not client.pipelines
    with connect(server) as sock:
        sock.sendall(GET * 99 + GET.replace(b"Host", b"Connection: close\r\nHost"))
        received = b""
        while piece := sock.recv(100_000):
            received += piece
    assert received.count(b"HTTP/1.1 200 OK") == 100
    assert received.count(b"\r\n\r\ntext\n") == 100


def test_a_client_that_does_not_read_its_response_times_out(serve, short):
    short(Phase.READING)
    short(Phase.RESPONSE)
    server = serve(render_metrics=lambda *_: [BIG])
    with connect(server) as sock:
        sock.sendall(GET)
        wait_until(lambda: not server._uvicorn.server_state.connections)


def test_a_scrape_that_waits_too_long_gets_503(serve, short, monkeypatch):
    monkeypatch.setattr(responses, "MAX_WAIT", 0.0)
    release, entered = threading.Event(), threading.Event()

    def slow(_openmetrics, _parts):
        entered.set()
        assert release.wait(20)
        return [b"slow\n"]

    server = serve(render_metrics=slow)
    with contextlib.ExitStack() as crowd:
        in_flight = responses.MAX_BYTES // scrape.FIRST_SIZE
        for _ in range(in_flight):
            crowd.enter_context(connect(server)).sendall(GET)
        assert entered.wait(20)
        wait_until(lambda: len(server._uvicorn.server_state.tasks) == in_flight)
        answer = ask(server, "/metrics")
        assert (answer.status, answer.headers["Retry-After"]) == (503, "1")
        release.set()
    wait_until(lambda: ask(server, "/metrics").status == 200)


def test_a_flood_of_slow_requests_does_not_delay_a_scrape(serve, short):
    release, entered = threading.Event(), threading.Event()

    def slow(_wanted):
        entered.set()
        assert release.wait(20)
        return []

    server = serve(find_events=slow)
    with contextlib.ExitStack() as crowd:
        for _ in range(200):
            sock = crowd.enter_context(connect(server))
            sock.sendall(GET.replace(b"/metrics", b"/api/v1/events"))
        assert entered.wait(20)
        assert ask(server, "/metrics").status == 200
        # Further ones are rejected instead of waiting for ever.
        wait_until(lambda: ask(server, "/api/v1/events").status == 503)
        release.set()
    wait_until(lambda: ask(server, "/api/v1/events").status == 200)


def test_an_incomplete_tls_handshake_times_out(serve, short, tls_config):
    short(Phase.REQUEST)
    with connect(serve(web_config=tls_config)) as sock:
        sock.sendall(b"\x16\x03\x01")
        assert ended(sock)


def test_stopping_does_not_wait_for_clients(serve, short, monkeypatch, caplog):
    monkeypatch.setattr("ros_diagnostics_exporter.web.server.GRACE", 1)
    before = set(threading.enumerate())
    server = serve(render_metrics=lambda *_: [BIG])
    with connect(server) as reader, connect(server):
        reader.sendall(GET)
        assert reader.recv(1_000).startswith(b"HTTP/1.1 200")
        server.stop()
    assert set(threading.enumerate()) <= before
    assert not caplog.records  # a client that does not read is not an error


def unread(
    crowd: contextlib.ExitStack, server, number: int, source: str, path: bytes = b"/metrics"
) -> list[socket.socket]:
    """Connections that request ``path`` and do not read the response, closed with ``crowd``."""
    host, _, port = server.addresses[0].rpartition(":")
    made = []
    for _ in range(number):
        sock = crowd.enter_context(socket.socket())
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
        sock.bind((source, 0))
        sock.settimeout(20)
        sock.connect((host, int(port)))
        sock.sendall(GET.replace(b"/metrics", path))
        made.append(sock)
    return made


def test_a_client_that_reads_keeps_its_connection(serve, short):
    """It scrapes repeatedly on one connection, from the attackers' own address."""
    server = serve(render_metrics=lambda *_: [b"x" * 2_000_000])
    server.connections.limit = 50
    host, _, port = server.addresses[0].rpartition(":")
    reader = http.client.HTTPConnection(host, int(port), timeout=20)
    with contextlib.ExitStack() as crowd:
        crowd.callback(reader.close)
        reader.connect()
        own = reader.sock
        for _ in range(10):
            unread(crowd, server, 10, "127.0.0.1")
            reader.request("GET", "/metrics")
            assert len(reader.getresponse().read()) == 2_000_000
        assert reader.sock is own
        assert len(server.connections) <= 50


def test_where_no_more_files_can_be_opened_it_goes_on_with_fewer_connections(
    serve, short, monkeypatch, caplog
):
    server, accept, failed = serve(), socket.socket.accept, []

    def accept_later(sock: socket.socket):
        if len(failed) < 3:
            failed.append(sock)
            raise OSError(errno.EMFILE, "Too many open files")
        return accept(sock)

    monkeypatch.setattr(socket.socket, "accept", accept_later)
    assert ask(server, "/metrics").status == 200
    said = "no connection can be accepted: [Errno 24] Too many open files; the limit is now 5 "
    assert caplog.text.count(said) == 1


def test_an_address_with_too_many_connections_loses_its_own(serve, short):
    server = serve()
    server.connections.limit = 50
    with contextlib.ExitStack() as crowd:
        idle = [crowd.enter_context(connect(server)) for _ in range(5)]  # idle longest
        wait_until(lambda: len(server.connections) == 5)
        unread(crowd, server, 100, "127.0.0.2", b"/-/healthy")
        assert ask(server, "/metrics").status == 200
        for sock in idle:
            sock.sendall(GET)
            assert sock.recv(1_000).startswith(b"HTTP/1.1 200")


def test_unauthenticated_connections_are_closed_first(serve, short, tmp_path):
    path = tmp_path / "web.yml"
    path.write_text(
        f"basic_auth_users: {{alice: {bcrypt.hashpw(b'x', bcrypt.gensalt(4)).decode()}}}"
    )
    server = serve(web_config=path)
    server.connections.limit = 20
    login = b"Authorization: Basic " + base64.b64encode(b"alice:x")
    with contextlib.ExitStack() as crowd:
        known = crowd.enter_context(connect(server))
        known.sendall(GET.replace(b"Host: x", b"Host: x\r\n" + login))
        assert read_until(known, b"text\n").startswith(b"HTTP/1.1 200")
        unread(crowd, server, 50, "127.0.0.1")
        wait_until(lambda: len(server.connections) <= 20)
        known.sendall(GET.replace(b"Host: x", b"Host: x\r\n" + login))
        assert read_until(known, b"text\n").startswith(b"HTTP/1.1 200")


def test_incomplete_tls_handshakes_do_not_block_others(serve, short, tls_config, ca):
    server = serve(web_config=tls_config)
    server.connections.limit = 20
    context = ssl.create_default_context()
    ca.configure_trust(context)
    with contextlib.ExitStack() as crowd:
        silent = [crowd.enter_context(connect(server)) for _ in range(100)]
        assert ended(silent[0])
        assert ask(server, "/metrics", tls=context).status == 200
        assert len(server.connections) <= 20


@pytest.mark.parametrize("path", ["/api/v1/fleet", "/", "/api/v1/events?limit=10000", "/sd/node"])
def test_the_memory_of_unread_responses_is_limited(serve, short, monkeypatch, path):
    monkeypatch.setattr(responses, "MAX_BYTES", 10_000_000)
    monkeypatch.setattr(responses, "STALLED_AFTER", 1_000.0)  # none of them counts as stalled
    large = robot("r" * 2_000_000, component("m" * 2_000_000, "ERROR"), up=False)
    server = serve(
        fleet_snapshot=lambda: fleet(large),
        find_events=lambda _: [{"id": 1, "message": "x" * 4_000_000}],
        targets=lambda _job, _port: [{"targets": ["x" * 4_000_000], "labels": {}}],
    )
    with contextlib.ExitStack() as crowd:
        unread(crowd, server, 10, "127.0.0.1", path.encode())
        wait_until(lambda: ask(server, path).status == 503)
        assert ask(server, path).headers["Retry-After"] == "1"
        assert ask(server, "/metrics").status == 200
        monkeypatch.setattr(responses, "STALLED_AFTER", 0.0)  # now all do
        assert ask(server, path).status == 200


@pytest.mark.parametrize("path", ["/metrics", "/sd/node"])
def test_a_response_whose_client_has_gone_counts_no_more(serve, short, monkeypatch, path):
    monkeypatch.setattr(responses, "MAX_BYTES", 10_000_000)
    monkeypatch.setattr(responses, "STALLED_AFTER", 1_000.0)  # none counts as stalled
    monkeypatch.setattr(responses, "MAX_WAIT", 0.0)
    monkeypatch.setattr(scrape, "FIRST_SIZE", 4_000_000)
    server = serve(
        render_metrics=lambda *_: [b"x" * 4_000_000],
        targets=lambda _job, _port: [{"targets": ["x" * 4_000_000], "labels": {}}],
    )
    with contextlib.ExitStack() as crowd:
        unread(crowd, server, 10, "127.0.0.1", path.encode())
        wait_until(lambda: ask(server, path).status == 503)
    wait_until(lambda: ask(server, path).status == 200)


CHANGES = GET.replace(b"/metrics", b"/-/changes")


def test_an_event_is_sent_when_something_has_changed_and_not_before(serve, short, monkeypatch):
    monkeypatch.setattr(changes, "LOOK", 0.01)
    monkeypatch.setattr(changes, "PAUSE", 1_000.0)
    last, looks = [7], []

    def last_event() -> int:
        looks.append(last[0])
        return last[0]

    def let_it_look() -> None:
        before = len(looks)
        wait_until(lambda: len(looks) > before + 3)

    server = serve(last_event=last_event)
    with connect(server) as sock:
        sock.sendall(CHANGES)
        received = read_until(sock, b"retry: 2000\n\n")
        assert b"content-type: text/event-stream" in received.lower()
        let_it_look()
        last[0] = 8
        received += read_until(sock, b"data: 8\n\n")
        last[0] = 9  # sooner than a browser asks again
        let_it_look()
        server.stop()
        received += read_until(sock, b"0\r\n\r\n")
    assert received.count(b"data: ") == 1


def test_streams_are_a_tenth_of_all_connections_and_none_hinders_a_scrape(serve, short):
    server = serve()
    server.connections.limit = 54
    for _ in range(2):
        with contextlib.ExitStack() as crowd:
            for sock in unread(crowd, server, 5, "127.0.0.2", b"/-/changes"):
                assert b"200 OK" in read_until(sock, b"retry")
            answer = ask(server, "/-/changes")
            assert (answer.status, answer.headers["Retry-After"]) == (503, "1")
            for _ in range(3):
                assert ask(server, "/metrics").status == 200
        wait_until(lambda: not server.connections)  # streams end with their clients


def test_a_stream_ends_before_its_response_would_time_out():
    assert connections.TIMEOUTS[Phase.RESPONSE] > changes.LASTS


def test_a_connection_can_be_used_again_after_a_stream(serve, short, monkeypatch):
    monkeypatch.setattr(changes, "LASTS", 0.0)
    with connect(serve()) as sock:
        sock.sendall(CHANGES)
        assert read_until(sock, b"\r\n0\r\n\r\n").count(b"HTTP/1.1") == 1
        sock.sendall(GET)
        assert read_until(sock, b"text\n").startswith(b"HTTP/1.1 200")


def test_a_client_that_does_not_read_its_events_is_dropped_and_harms_nobody(
    serve, short, monkeypatch
):
    """Its events are held back, in a buffer that does not grow, until the response times out."""
    monkeypatch.setattr(changes, "LOOK", 0.0)
    monkeypatch.setattr(changes, "PAUSE", 0.0)
    monkeypatch.setattr(changes, "LASTS", 1_000.0)
    number = itertools.count(10**3_000)  # long: the kernel takes 256 KiB before any is held back
    short(Phase.RESPONSE, 3.0)
    server = serve(last_event=lambda: next(number))
    with contextlib.ExitStack() as crowd:
        unread(crowd, server, 5, "127.0.0.2", b"/-/changes")
        connections = server._uvicorn.server_state.connections
        wait_until(lambda: any(each.flow.write_paused for each in connections))
        held = [each.transport.get_write_buffer_size() for each in connections if each.transport]
        assert max(held) < 200_000
        assert ask(server, "/metrics").status == 200
        wait_until(lambda: not connections)


def test_stopping_does_not_wait_for_streams(serve, short, monkeypatch):
    monkeypatch.setattr("ros_diagnostics_exporter.web.server.GRACE", 1_000)
    server = serve()
    with connect(server) as sock:
        sock.sendall(CHANGES)
        read_until(sock, b"retry")
        server.stop()
    assert not server.alive
