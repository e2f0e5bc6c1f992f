from __future__ import annotations

import time

import pytest

from ros_diagnostics_tools.main import main

LEDGER = {
    "fleet": "hall",
    "robot": "robot_1",
    "component": None,
    "time": 1_060.0,
    "at": 1_060.0,
    "entries": [{"time": 1_000.0, "text": "/Motor/Motor 1 OK → ERROR: \x1b[31mhot"}],
    "now": ["critical /Motor/Motor 1: confirmed; notified 1 min ago: email"],
}


@pytest.fixture(autouse=True)
def in_utc(monkeypatch):
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()


def test_the_history_is_printed_in_order_and_then_what_is_now(serve, capsys):
    asked = []
    server = serve(why=lambda *given: asked.append(given) or LEDGER)
    url = f"http://{server.addresses[0]}"

    assert main(["why", "robot_1", "Motor 1", "--at", "1970-01-01T00:10", "--url", url]) == 0
    assert asked == [("robot_1", "Motor 1", 600.0)]
    lines = capsys.readouterr().out.splitlines()
    assert "00:16:40  /Motor/Motor 1 OK → ERROR: " in lines[1]
    assert "\x1b" not in "".join(lines)
    assert lines[-1] == "  critical /Motor/Motor 1: confirmed; notified 1 min ago: email"
