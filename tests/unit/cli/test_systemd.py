"""What systemd is notified of, by a socket in its place."""

from __future__ import annotations

import os
import socket
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
