"""Asking Alertmanager: what it answers is believed, and nothing that it does hurts the exporter."""

import json
import logging
import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from datetime import timedelta
from http.server import BaseHTTPRequestHandler
from types import SimpleNamespace
from typing import Any
from unittest.mock import patch

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st

from ros_diagnostics_exporter.alertmanager import Alertmanager
from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.silences import downtime_matchers, silence
from support.loopback import answering
from support.silences import MADE, MOTOR, listed

NOW = Instant(100.0, MOTOR.at + 60)
Reply = Callable[[BaseHTTPRequestHandler], None]


@pytest.fixture
def server() -> Iterator[SimpleNamespace]:
    """An HTTP server whose ``reply`` a test sets; ``asked`` are the paths it was asked for."""
    server = SimpleNamespace(asked=[], reply=say(json.dumps([listed()]).encode()))

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            server.asked.append((self.path, dict(self.headers)))
            server.reply(self)

    with answering(Handler) as address:
        server.url = f"http://{address}"
        yield server


def say(body: bytes, code: int = 200, length: int | None = None) -> Reply:
    def reply(handler: BaseHTTPRequestHandler) -> None:
        handler.send_response(code)
        handler.send_header("Content-Length", str(len(body) if length is None else length))
        handler.end_headers()
        handler.wfile.write(body)

    return reply


def drip(handler: BaseHTTPRequestHandler) -> None:
    """A byte now and then, without end: each comes in time."""
    handler.send_response(200)
    handler.end_headers()
    stopped = threading.Event()
    with suppress(OSError):
        while not stopped.wait(0.02):
            handler.wfile.write(b" ")


def flood(handler: BaseHTTPRequestHandler) -> None:
    handler.send_response(200)
    handler.end_headers()
    with suppress(OSError):
        while True:
            handler.wfile.write(b" " * 65536)


def hang_up(handler: BaseHTTPRequestHandler) -> None:
    handler.close_connection = True


def test_it_asks_for_its_own_fleet_and_believes_the_answer(server):
    alertmanager = Alertmanager([server.url])
    assert (alertmanager.known(NOW.wall), alertmanager.answers(NOW)) == ([], False)

    alertmanager.update("f", NOW)

    assert alertmanager.known(NOW.wall) == [MOTOR]
    assert alertmanager.answers(NOW)
    ((path, _headers),) = server.asked
    assert path == (
        "/api/v2/silences?filter=alertname%3D%22RosDiagnosticsUnacknowledged%22"
        "&filter=fleet%3D%22f%22"
    )


def test_an_acknowledgement_is_known_only_while_it_is_in_force(server):
    alertmanager = Alertmanager([server.url])
    alertmanager.update("f", NOW)

    assert alertmanager.known(MOTOR.at - 1) == alertmanager.known(MOTOR.until) == []
    assert alertmanager.known(MOTOR.until - 1) == [MOTOR]


@pytest.mark.parametrize(
    "reply",
    [
        pytest.param(say(b"", 500), id="an error"),
        pytest.param(say(b"<html>log in</html>"), id="no JSON"),
        pytest.param(say(b"[" * 100_000), id="nested without end"),
        pytest.param(say(b"\xff\xfe"), id="no text"),
        pytest.param(say(b"[]", length=50), id="cut off"),
        pytest.param(drip, id="byte by byte"),
        pytest.param(flood, id="without end"),
        pytest.param(hang_up, id="none at all"),
    ],
)
def test_what_was_known_outlives_an_answer_that_cannot_be_used(server, monkeypatch, reply):
    monkeypatch.setattr(Alertmanager, "TIMEOUT", 0.3)
    alertmanager = Alertmanager([server.url])
    alertmanager.update("f", NOW)
    server.reply = reply

    alertmanager.update("f", NOW)

    assert not alertmanager.answers(NOW)
    assert alertmanager.known(NOW.wall) == [MOTOR]


def test_an_answer_that_does_not_come_is_none():
    """A look may hang in ways that no timeout ends; then the last answer becomes old."""
    alertmanager = Alertmanager(["http://127.0.0.1:1"])
    alertmanager._answers, alertmanager._answered_at = True, NOW.mono

    assert alertmanager.answers(Instant(NOW.mono + 19, 0.0))
    assert not alertmanager.answers(Instant(NOW.mono + 21, 0.0))


def test_it_says_once_that_it_is_not_answered_and_once_that_it_is(server, caplog):
    caplog.set_level(logging.INFO)
    alertmanager = Alertmanager([server.url])
    good, bad = server.reply, say(b"", 503)
    for reply in (bad, bad, good, good, bad, bad, good):
        server.reply = reply
        alertmanager.update("f", NOW)

    levels = [record.levelname for record in caplog.records]
    assert levels == ["ERROR", "INFO", "ERROR", "INFO"]
    assert "503" in caplog.records[0].getMessage()
    assert server.url in caplog.records[1].getMessage()


def test_of_a_pair_the_half_that_answers_is_believed(server):
    alertmanager = Alertmanager(["http://127.0.0.1:1", server.url])
    alertmanager.update("f", NOW)

    assert alertmanager.known(NOW.wall) == [MOTOR]


def test_the_password_is_read_from_its_file_at_each_look(server, tmp_path):
    file = tmp_path / "password"
    alertmanager = Alertmanager([server.url], user="ann", password_file=file)

    alertmanager.update("f", NOW)  # before the file is there
    assert not alertmanager.answers(NOW)

    file.write_text("secret\n")
    alertmanager.update("f", NOW)
    assert server.asked[-1][1]["Authorization"] == "Basic YW5uOnNlY3JldA=="
    assert alertmanager.answers(NOW)


ID = "0b8f1c52-52d5-4a11-9f1a-7fd8c9a1e0aa"
SILENCE = {
    "createdBy": "ann\n",
    "comment": "on it",
    "matchers": [],
    "startsAt": "2026-01-01T10:05:00.250Z",
    "endsAt": "2026-01-31T10:05:00.250Z",
}


def alert(name: str, state: str = "active", **status: list[str]) -> dict[str, Any]:
    return {
        "fingerprint": name,
        "labels": {"alertname": name, "fleet": "f", "robot": "r"},
        "receivers": [{"name": "email"}, {"name": "sms"}],
        "status": {"state": state, "silencedBy": [], "inhibitedBy": [], **status},
    }


def in_json(answer: Callable[[str], Any]) -> Reply:
    """Replies with the JSON for the path that is asked for."""
    return lambda handler: say(json.dumps(answer(handler.path)).encode())(handler)


def test_what_alertmanager_holds_back_is_explained(server):
    switch = {**alert("PortDown"), "labels": {"alertname": "PortDown", "component": "ap_1"}}
    own = [
        alert("A"),
        alert("B", "suppressed", silencedBy=[ID]),
        alert("C", "suppressed", inhibitedBy=["PortDown"]),
    ]

    def answer(path: str) -> Any:
        if path.startswith("/api/v2/silence/"):
            return SILENCE
        return own if "robot" in path else [*own, switch]

    server.reply = in_json(answer)
    assert asked(server).explain("f", "r", None) == [
        "alert A r: active, for email, sms",
        "alert B r: silenced by ann until 2026-01-31 10:05 UTC: on it",
        "alert C r: inhibited by PortDown ap_1",
    ]


def asked(server: SimpleNamespace) -> Alertmanager:
    return Alertmanager([server.url])


JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=9), inner),
    max_leaves=5,
)
PLANNED = {
    **silence(
        downtime_matchers("f", "r", "Motor"), MADE, MADE + timedelta(hours=1), "ann", "gears"
    ),
    "status": {"state": "active"},
}
ALERT = {
    "fingerprint": "a",
    "labels": {"alertname": "RosDiagnosticsComponentCritical", "robot": "r"},
    "status": {"state": "suppressed", "silencedBy": [], "inhibitedBy": ["b"]},
    "receivers": [{"name": "email"}],
}


def put_junk(content: Any, draw: st.DrawFn) -> Any:
    """The content with junk in the place of one of its parts, or of all of it."""
    if not isinstance(content, dict | list) or not content or draw(st.integers(0, 4)) == 0:
        return draw(JUNK)
    parts = content if isinstance(content, dict) else dict(enumerate(content))
    key = draw(st.sampled_from(list(parts)))
    changed = {**parts, key: put_junk(parts[key], draw)}
    return changed if isinstance(content, dict) else list(changed.values())


@settings(max_examples=100, deadline=None, phases=[Phase.generate])
@given(st.data())
def test_an_answer_of_any_shape_raises_nothing(data):
    answer = put_junk([listed(), PLANNED], data.draw)
    alertmanager = Alertmanager(["http://127.0.0.1:1"])
    with patch.object(Client, "get", return_value=answer):
        alertmanager.update("f", NOW)
    assert alertmanager.answers(NOW) is isinstance(answer, list)

    with patch.object(Client, "get", return_value=put_junk([ALERT], data.draw)):
        try:
            found = alertmanager.explain("f", "r", None)
        except UnreachableError:
            found = []
    assert all(isinstance(each, str) for each in found)
