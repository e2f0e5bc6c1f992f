from __future__ import annotations

import argparse
import time
from datetime import datetime, timezone

import pytest

from ros_diagnostics_tools.commands.why import main, moment

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


def test_the_ledger_is_printed_in_order_and_then_what_is_now(serve, capsys):
    asked = []
    server = serve(why=lambda *given: asked.append(given) or LEDGER)
    url = f"http://{server.addresses[0]}"

    assert main(["robot_1", "Motor 1", "--at", "1970-01-01T00:10", "--url", url]) == 0
    assert asked == [("robot_1", "Motor 1", 600.0)]
    lines = capsys.readouterr().out.splitlines()
    assert "00:16:40  /Motor/Motor 1 OK → ERROR: " in lines[1]
    assert "\x1b" not in "".join(lines)
    assert lines[-1] == "  critical /Motor/Motor 1: confirmed; notified 1 min ago: email"


def test_an_unknown_robot_and_a_server_that_does_not_answer_are_errors(serve, capsys):
    def no_robot(*_given):
        raise LookupError("no robot 'x'")

    server = serve(why=no_robot)
    assert main(["x", "--url", f"http://{server.addresses[0]}"]) == 1
    assert "404" in capsys.readouterr().err
    server.stop()
    assert main(["x", "--url", f"http://{server.addresses[0]}"]) == 1


@pytest.mark.parametrize(
    ("text", "query"),
    [
        ("10m", "10m"),
        ("14:30", "1800023400.0"),
        ("17:00", "1799946000.0"),  # yesterday's
        ("2027-01-15T08:00", "1800000000.0"),
        ("2027-01-15 09:00+01:00", "1800000000.0"),
    ],
)
def test_a_time_is_absolute_or_so_long_ago(text, query):
    assert moment(text, datetime(2027, 1, 15, 15, 0, tzinfo=timezone.utc)) == query


@pytest.mark.parametrize("text", ["", "soon", "25:00", "2027-13-01"])
def test_what_is_no_time_is_an_error(text):
    with pytest.raises(argparse.ArgumentTypeError, match="is no time"):
        moment(text)
