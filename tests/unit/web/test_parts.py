"""``/metrics?collect[]=`` and ``exclude[]=``: which parts the backend is asked for."""

from __future__ import annotations

import json
import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from ros_diagnostics_exporter.model import ALL_PARTS, Part
from support.web_server import ask

FAULTS, ROBOTS, EXPORTER = Part
PROMETHEUS = "application/openmetrics-text;version=1.0.0,text/plain;q=0.5"


@pytest.fixture
def asked(serve):
    """Parts that were asked for -> the server that noted them."""
    found = []

    def render(openmetrics: bool, parts: frozenset[Part]) -> list[bytes]:
        found.append((openmetrics, parts))
        return [b"samples\n"]

    return found, serve(render_metrics=render)


@pytest.mark.parametrize("method", ["GET", "HEAD"])
@pytest.mark.parametrize("openmetrics", [False, True])
@pytest.mark.parametrize(
    ("query", "parts"),
    [
        ("", ALL_PARTS),
        ("?", ALL_PARTS),
        ("?collect[]=faults", {FAULTS}),
        ("?collect%5B%5D=faults", {FAULTS}),
        ("?collect[]=faults&collect[]=exporter", {FAULTS, EXPORTER}),
        ("?collect[]=faults&collect[]=faults", {FAULTS}),
        ("?" + "&".join(["collect[]=robots"] * 200), {ROBOTS}),
        ("?exclude[]=robots", {FAULTS, EXPORTER}),
        ("?exclude[]=robots&exclude[]=robots&exclude[]=faults", {EXPORTER}),
        ("?exclude[]=robots&exclude[]=faults&exclude[]=exporter", set()),
        ("?other=1&collect=robots", ALL_PARTS),
    ],
)
def test_the_parts_that_the_query_names(asked, method, openmetrics, query, parts):
    found, server = asked
    answer = ask(server, f"/metrics{query}", method, accept=PROMETHEUS if openmetrics else "")
    assert (answer.status, found) == (200, [(openmetrics, parts)])
    assert answer.body == (b"samples\n" if method == "GET" else b"")
    assert answer.headers["content-length"] == "8"


@pytest.mark.parametrize("method", ["GET", "HEAD"])
@pytest.mark.parametrize(
    ("query", "error"),
    [
        ("collect[]=values", "collect[] is 'values', not one of faults, robots, exporter"),
        ("collect[]=", "collect[] is '', not one of faults, robots, exporter"),
        ("collect[]", "collect[] is '', not one of faults, robots, exporter"),
        ("collect[]=FAULTS", "collect[] is 'FAULTS', not one of faults, robots, exporter"),
        ("exclude[]=faults&exclude[]=x", "exclude[] is 'x', not one of faults, robots, exporter"),
        (
            "collect[]=faults&exclude[]=faults",
            (
                "collect[] and exclude[] cannot be combined: give one of them, "
                "with some of faults, robots, exporter"
            ),
        ),
        ("collect[]=%00%ff", "collect[] is '\\x00\ufffd', not one of faults, robots, exporter"),
        (
            "collect[]=" + "x" * 5_000,
            f"collect[] is '{'x' * 79}, not one of faults, robots, exporter",
        ),
        ("collect[]=%0d%0aSet-Cookie:+a", None),
        ("exclude[]=<script>", None),
    ],
)
def test_an_unknown_part_or_both_parameters_are_rejected(asked, method, query, error):
    found, server = asked
    answer = ask(server, f"/metrics?{query}", method)
    assert (answer.status, found) == (400, [])
    assert answer.headers["content-type"] == "application/json"
    assert "set-cookie" not in answer.headers
    if method == "GET" and error:
        assert json.loads(answer.body) == {"error": error}


def test_concurrent_scrapes_of_different_parts_do_not_share_a_rendering(serve):
    both = threading.Barrier(2)

    def render(_openmetrics: bool, parts: frozenset[Part]) -> list[bytes]:
        both.wait(20)
        return [part.value.encode() for part in parts]

    server = serve(render_metrics=render)
    queries = [f"/metrics?collect[]={part}" for part in ("faults", "robots")]
    with ThreadPoolExecutor(2) as clients:
        bodies = list(clients.map(lambda query: ask(server, query).body, queries))
    assert bodies == [b"faults", b"robots"]
