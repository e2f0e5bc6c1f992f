import pytest

LEDGER = {
    "fleet": "hall",
    "robot": "robot_1",
    "component": None,
    "time": 1_060.0,
    "at": 1_060.0,
    "entries": [{"time": 1_000.0, "text": "/Motor/Motor 1 OK → ERROR: \x1b[31mhot"}],
    "now": ["critical /Motor/Motor 1: confirmed; notified 1 min ago: email"],
}


@pytest.mark.usefixtures("in_utc")
def test_the_history_is_printed_in_order_and_then_what_is_now(serve, run):
    asked = []
    server = serve(why=lambda *given: asked.append(given) or LEDGER)
    said = run("why", "robot_1", "Motor 1", "--at", "1970-01-01T00:10", at=server).out
    assert asked == [("robot_1", "Motor 1", 600.0)]
    lines = said.splitlines()
    assert "00:16:40  /Motor/Motor 1 OK → ERROR: " in lines[1]
    assert "\x1b" not in "".join(lines)
    assert lines[-1] == "  critical /Motor/Motor 1: confirmed; notified 1 min ago: email"
