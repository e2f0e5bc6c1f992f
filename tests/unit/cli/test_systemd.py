"""What systemd is notified of, by a socket in its place."""

import os
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from contextlib import suppress

import pytest

from ros_diagnostics_exporter.cli.main import Watchdog, notify


@pytest.fixture
def notified(tmp_path, monkeypatch) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.bind(str(tmp_path / "notify"))
        sock.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        yield sock


def received(notified: socket.socket) -> list[bytes]:
    found: list[bytes] = []
    with suppress(BlockingIOError):
        while True:
            found.append(notified.recv(100))
    return found


def test_the_watchdog_is_notified_and_not_at_each_turn(notified, monkeypatch):
    monkeypatch.setenv("WATCHDOG_USEC", "60000000")
    watchdog = Watchdog()
    for _ in range(100):
        watchdog.beat()
    assert received(notified) == [b"WATCHDOG=1"]


def test_it_is_notified_again_before_its_time_is_over(notified, monkeypatch):
    monkeypatch.setenv("WATCHDOG_USEC", "4")
    watchdog = Watchdog()
    watchdog.beat()
    watchdog.beat()
    assert received(notified) == [b"WATCHDOG=1"] * 2


def test_it_is_notified_four_times_in_its_time(notified, monkeypatch):
    now = 1_000.0
    monkeypatch.setattr("ros_diagnostics_exporter.cli.main.time.monotonic", lambda: now)
    monkeypatch.setenv("WATCHDOG_USEC", "60000000")
    watchdog, sent = Watchdog(), []
    for _second in range(60):
        watchdog.beat()
        sent += received(notified)
        now += 1.0
    assert len(sent) == 4


def test_an_abstract_socket_is_notified(monkeypatch):
    name = f"ros-diagnostics-{os.getpid()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.bind(f"\0{name}")
        sock.settimeout(5.0)
        monkeypatch.setenv("NOTIFY_SOCKET", f"@{name}")
        notify("READY=1")
        assert sock.recv(100) == b"READY=1"


def test_a_socket_that_is_gone_is_logged_and_nothing_else(monkeypatch, tmp_path, caplog):
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "gone"))
    notify("READY=1")
    assert "cannot notify systemd at" in caplog.text


@pytest.mark.parametrize("microseconds", [None, "", "soon"])
def test_without_a_watchdog_nothing_is_notified(notified, monkeypatch, microseconds):
    if microseconds is None:
        monkeypatch.delenv("WATCHDOG_USEC", raising=False)
    else:
        monkeypatch.setenv("WATCHDOG_USEC", microseconds)
    Watchdog().beat()
    assert received(notified) == []


# As systemd starts a service: the socket is file 3, and the environment says so.
ACTIVATED = """
import os, sys
os.dup2(int(sys.argv.pop(1)), 3)
os.environ |= {"LISTEN_FDS": "1", "LISTEN_PID": str(os.getpid() + int(sys.argv.pop(1)))}
from ros_diagnostics_exporter.cli.main import main
sys.exit(main())
"""


def activated(tmp_path, sock: socket.socket, other_process: int = 0, *more: str):
    """An exporter with a socket that systemd listens on; or that is another process'."""
    (tmp_path / "fleet.yml").write_text("fleet: hall\nrobots: [{name: ap_1, source: queries}]\n")
    given = ["--config.file", "fleet.yml", "--storage.path", "none", "--web.systemd-socket", *more]
    return subprocess.Popen(
        [sys.executable, "-c", ACTIVATED, str(sock.fileno()), str(other_process), *given],
        cwd=tmp_path,
        pass_fds=(sock.fileno(),),
        stderr=subprocess.PIPE,
        text=True,
    )


def test_who_asks_before_it_is_started_is_answered_on_the_socket_of_systemd(tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as listening:
        url = f"http://127.0.0.1:{listening.getsockname()[1]}/-/healthy"
        with activated(tmp_path, listening) as exporter:
            with urllib.request.urlopen(url, timeout=60) as answer:
                assert answer.status == 200
            assert exporter.stderr is not None
            assert any("serving fleet hall on 127.0.0.1:" in line for line in exporter.stderr)
            exporter.send_signal(signal.SIGTERM)
        assert exporter.returncode == 0
        with socket.create_connection(listening.getsockname(), 10):
            pass  # systemd goes on listening: the next start answers this one


@pytest.mark.parametrize(
    ("kind", "given", "complaint", "code"),
    [
        ((socket.AF_INET, socket.SOCK_STREAM), (1,), "systemd has passed no socket; start", 1),
        ((socket.AF_UNIX, socket.SOCK_STREAM), (), "not TCP; write ListenStream=9877", 1),
        ((socket.AF_INET, socket.SOCK_DGRAM), (), "not TCP; write ListenStream=9877", 1),
        (
            (socket.AF_INET, socket.SOCK_STREAM),
            (0, "--web.listen-address", ":9877"),
            "give --web.listen-address or --web.systemd-socket, not both",
            2,
        ),
    ],
)
def test_what_is_no_socket_of_systemd_ends_the_exporter(tmp_path, kind, given, complaint, code):
    with socket.socket(*kind) as sock, activated(tmp_path, sock, *given) as exporter:
        _output, errors = exporter.communicate(timeout=60)

    assert complaint in errors
    assert exporter.returncode == code
