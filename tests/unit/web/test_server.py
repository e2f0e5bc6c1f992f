import errno
import gzip
import logging
import socket
import threading

import pytest

from ros_diagnostics_exporter.model import Part
from ros_diagnostics_exporter.web import server as server_module
from ros_diagnostics_exporter.web.server import ListenError, Server, bind, parse_address
from support.web_server import FakeBackend, ask, wait_until

OPENMETRICS = "application/openmetrics-text"
PROMETHEUS = (
    "application/openmetrics-text;version=1.0.0;q=0.5,"
    "application/openmetrics-text;version=0.0.1;q=0.4,text/plain;version=0.0.4;q=0.3,*/*;q=0.2"
)


@pytest.mark.parametrize(
    ("accept", "kind", "body"),
    [
        ("", "text/plain; version=0.0.4; charset=utf-8", b"text\n"),
        ("*/*", "text/plain; version=0.0.4; charset=utf-8", b"text\n"),
        (
            PROMETHEUS,
            "application/openmetrics-text; version=1.0.0; charset=utf-8",
            b"openmetrics\n",
        ),
        (
            "application/openmetrics-text;q=0.1, text/plain",
            "text/plain; version=0.0.4; charset=utf-8",
            b"text\n",
        ),
        ("application/openmetrics-text;q=0", "text/plain; version=0.0.4; charset=utf-8", b"text\n"),
        (
            "application/openmetrics-text;q=nonsense",
            "text/plain; version=0.0.4; charset=utf-8",
            b"text\n",
        ),
        *(
            (each, "application/openmetrics-text; version=1.0.0; charset=utf-8", b"openmetrics\n")
            for each in (f"{OPENMETRICS};q=0.5", f"{OPENMETRICS}, text/plain")
        ),
    ],
)
def test_the_format_follows_the_accept_header(plain, accept, kind, body):
    answer = ask(plain, "/metrics", Accept=accept)
    assert (answer.status, answer.headers["Content-Type"], answer.body) == (200, kind, body)


@pytest.mark.parametrize(
    ("accepted", "gzipped"),
    [("gzip", True), ("br, gzip;q=0.5", True), ("*", True), ("gzip;q=0", False), ("br", False)],
)
def test_the_exposition_is_gzipped_for_clients_that_accept_it(plain, accepted, gzipped):
    answer = ask(plain, "/metrics", Accept_Encoding=accepted)
    assert (answer.headers["Content-Encoding"] == "gzip") is gzipped
    assert (gzip.decompress(answer.body) if gzipped else answer.body) == b"text\n"
    assert "Accept-Encoding" in answer.headers["Vary"]


@pytest.mark.parametrize("path", ["/probe", "/"])  # the latter in place of the landing page
def test_the_telemetry_path_can_be_changed(serve, path):
    server = serve(telemetry_path=path)
    assert ask(server, path).body == b"text\n"
    assert ask(server, "/metrics").status == 404


def test_what_is_not_ready_or_hangs_says_why(serve, plain):
    reasons = {"not_ready_reason": lambda: "no domain", "hanging_reason": lambda: "tick hangs"}
    for path, text in (("ready", "not ready: no domain\n"), ("healthy", "unhealthy: tick hangs\n")):
        answer = ask(serve(**reasons), f"/-/{path}")
        assert (answer.status, answer.text) == (503, text)
        assert ask(plain, f"/-/{path}").status == 200
    assert ask(serve(not_ready_reason=lambda: "not yet"), "/-/healthy").status == 200


def test_an_event_loop_that_makes_no_turn_hangs(serve, monkeypatch):
    monkeypatch.setattr(server_module, "HANGING", 0.5)
    entered, release = threading.Event(), threading.Event()

    def hang() -> None:
        entered.set()
        assert release.wait(20)

    server = serve(hanging_reason=hang)  # the one method that the event loop calls itself
    wait_until(lambda: not server.hangs)
    asking = threading.Thread(target=ask, args=(server, "/-/healthy"))
    asking.start()
    assert entered.wait(20)
    wait_until(lambda: server.hangs)
    release.set()
    asking.join(20)
    wait_until(lambda: not server.hangs)


def test_an_error_in_the_backend_is_a_500_and_logged(serve, caplog):
    def broken(openmetrics: bool, _parts: frozenset[Part]) -> list[bytes]:
        raise RuntimeError("the state is on fire")

    server = serve(render_metrics=broken)
    assert ask(server, "/metrics").status == 500
    wait_until(lambda: "the state is on fire" in caplog.text)
    assert ask(server, "/-/healthy").status == 200


def test_concurrent_scrapes_share_one_rendering(serve):
    entered, release, calls = threading.Event(), threading.Event(), []

    def slow(openmetrics: bool, _parts: frozenset[Part]) -> list[bytes]:
        calls.append(openmetrics)
        entered.set()
        assert release.wait(20)
        return [b"slow\n"]

    counted: list[None] = []
    server = serve(render_metrics=slow, count_scrape=lambda: counted.append(None))
    answers = []
    clients = [
        threading.Thread(target=lambda: answers.append(ask(server, "/metrics").body))
        for _ in range(8)
    ]
    for client in clients:
        client.start()
    assert entered.wait(20)
    # All eight requests have arrived before the rendering may end.
    wait_until(lambda: len(server._uvicorn.server_state.tasks) == len(clients))
    release.set()
    for client in clients:
        client.join(20)
    assert answers == [b"slow\n"] * 8
    assert calls == [False]
    wait_until(lambda: len(counted) == 8)  # each is a scrape


def test_a_port_in_use_is_named_with_the_remedy(serve):
    taken = serve().addresses[0]
    with pytest.raises(ListenError, match=f"cannot listen on {taken}: Address already in use") as e:
        Server(FakeBackend(), listen=["127.0.0.1:0", taken]).start()
    assert "--web.listen-address" in str(e.value)


@pytest.mark.parametrize("host", ["no-such-host.invalid", "x" * 70 + ".example", "a..b"])
def test_an_unknown_host_is_named(host):
    with pytest.raises(ListenError, match=f"cannot listen on {host}:0: ") as raised:
        Server(FakeBackend(), listen=[f"{host}:0"]).start()
    assert "choose an address of this machine" in str(raised.value)


def test_a_port_that_only_root_may_use_is_named_with_the_remedy(monkeypatch):
    def deny(*_arguments, **_more):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(socket, "create_server", deny)
    with pytest.raises(ListenError, match=":80: Permission denied; choose a port of 1024 or more"):
        bind("127.0.0.1:80")


def test_a_name_of_both_families_is_listened_on_by_ipv4(monkeypatch):
    places = (socket.AF_INET6, ("::1", 0, 0, 0)), (socket.AF_INET, ("127.0.0.1", 0))
    found = [(family, socket.SOCK_STREAM, 6, "", place) for family, place in places]
    monkeypatch.setattr(socket, "getaddrinfo", lambda *_arguments, **_more: found)
    with bind("localhost:0") as sock:
        assert sock.getsockname()[0] == "127.0.0.1"


def test_an_address_of_another_machine_is_not_a_port_in_use():
    with pytest.raises(ListenError, match="Cannot assign requested address") as raised:
        Server(FakeBackend(), listen=["192.0.2.1:0"]).start()
    assert "choose an address of this machine" in str(raised.value)
    assert "stop the program" not in str(raised.value)


@pytest.mark.parametrize("address", ["9100", "localhost", "localhost:", "a:http", ":65536", ":-1"])
def test_an_address_without_a_port_is_rejected(address):
    with pytest.raises(ListenError, match="no port"):
        parse_address(address)


def test_an_ipv6_host_needs_brackets():
    assert parse_address("[::1]:9100") == ("::1", 9100)
    assert parse_address(":65535") == ("", 65535)
    with pytest.raises(ListenError, match=r"\[host\]:port"):
        parse_address("::1:9100")


@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="no IPv6 on this machine")
def test_without_a_host_it_listens_on_ipv4_and_ipv6(serve):
    port = serve(":0").addresses[0].rpartition(":")[2]
    for host in ("127.0.0.1", "::1"):
        socket.create_connection((host, int(port)), timeout=20).close()


def test_a_server_that_fails_is_not_alive_and_logs_the_error(serve, caplog, monkeypatch):
    server = serve()
    assert server.alive
    idle = Server(FakeBackend(), listen=[])
    assert not idle.alive
    idle.stop()

    async def broken(_counter):
        raise RuntimeError("no more time")

    monkeypatch.setattr(server._uvicorn, "on_tick", broken)
    wait_until(lambda: not server.alive)
    assert "the web server has failed" in caplog.text
    assert "no more time" in caplog.text


def test_a_stopped_server_releases_its_port_and_threads(serve, caplog):
    before = set(threading.enumerate())
    server = serve()
    with caplog.at_level(logging.INFO):
        ask(server, "/metrics")
    assert "/metrics" not in caplog.text  # there is no access log
    server.stop()
    assert set(threading.enumerate()) <= before
    serve(server.addresses[0])
