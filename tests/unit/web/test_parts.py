"""``/metrics?collect[]=`` and ``exclude[]=``: which parts the backend is asked for."""

import threading
from concurrent.futures import ThreadPoolExecutor

import pytest

from ros_diagnostics_exporter.model import ALL_PARTS, Part
from support.web_server import ask

FAULTS, _, EXPORTER = Part


@pytest.fixture
def asked(serve):
    """Parts that were asked for -> the server that noted them."""
    found = []

    def render(openmetrics: bool, parts: frozenset[Part]) -> list[bytes]:
        found.append((openmetrics, parts))
        return [b"samples\n"]

    return found, serve(render_metrics=render)


@pytest.mark.parametrize(("method", "body"), [("GET", b"samples\n"), ("HEAD", b"")])
@pytest.mark.parametrize(
    ("query", "parts"),
    [
        ("", ALL_PARTS),
        ("?collect%5B%5D=faults", {FAULTS}),
        ("?collect[]=faults&collect[]=exporter&collect[]=faults", {FAULTS, EXPORTER}),
        ("?exclude[]=robots&exclude[]=robots&exclude[]=faults", {EXPORTER}),
        ("?exclude[]=robots&exclude[]=faults&exclude[]=exporter", set()),
        ("?other=1&collect=robots", ALL_PARTS),
    ],
)
def test_the_parts_that_the_query_names(asked, method, body, query, parts):
    found, server = asked
    answer = ask(server, f"/metrics{query}", method)
    assert (answer.status, answer.body, found) == (200, body, [(False, parts)])
    assert answer.headers["content-length"] == "8"
    ask(server, "/metrics")  # is of then, however soon
    assert len(found) == 2


@pytest.mark.parametrize(
    ("query", "error"),
    [
        ("collect[]=", "collect[] is '', not"),
        ("collect[]=FAULTS", "collect[] is 'FAULTS', not"),
        ("exclude[]=faults&exclude[]=y&exclude[]=x", "exclude[] is 'x', not"),
        ("collect[]=faults&exclude[]=faults", "collect[] and exclude[] cannot be combined: give"),
        ("collect[]=%00%ff", "collect[] is '\\x00\ufffd', not"),
        ("collect[]=" + "x" * 5_000, f"collect[] is '{'x' * 79}, not"),
        ("collect[]=%0d%0aSet-Cookie:+a", "collect[] is '\\r\\nSet-Cookie: a', not"),
    ],
)
def test_an_unknown_part_or_both_parameters_are_rejected(asked, query, error):
    found, server = asked
    answer = ask(server, f"/metrics?{query}")
    assert (answer.status, found) == (400, [])
    assert "set-cookie" not in answer.headers
    assert answer.json["error"].startswith(f"{error} one of ")


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
