"""Queries of Prometheus: what is asked, which robots and components the answer is, what fails."""

import base64
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import count
from pathlib import Path
from threading import Event
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Query, Threshold
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.http_client import Client
from ros_diagnostics_exporter.model import Feed, Instant, Level, Status
from ros_diagnostics_exporter.sources import prometheus
from ros_diagnostics_exporter.sources.prometheus import NO_URL, Outcome, Prometheus
from support.loopback import Request, replying
from testbed.polling import until

HIGH = (Threshold("high", "warning", 80.0), Threshold("high", "critical", 90.0))
DOCS = Path(__file__).parents[3] / "docs"
NOW = Instant(1.0, 1_700_000_000.0)
Answer = tuple[int, Any] | Event


class Stub:
    """A Prometheus whose answer to each expression the test sets: (status, body), or it hangs."""

    def __init__(self) -> None:
        self.answers: dict[str, Answer] = {}
        self.asked: list[tuple[str, Mapping[str, str]]] = []
        self.timeouts: set[str] = set()
        self.address = ""

    def result(self, expr: str, *rows: tuple[dict[str, str], object], kind: str = "vector") -> None:
        result = [{"metric": labels, "value": [0, str(value)]} for labels, value in rows]
        self.answers[expr] = 200, {"data": {"resultType": kind, "result": result}}

    def times(self, expr: str) -> int:
        return sum(each == expr for each, _headers in self.asked)


@pytest.fixture
def stub() -> Iterator[Stub]:
    found = Stub()

    def reply(request: Request) -> tuple[int, bytes]:
        parameters = parse_qs(urlsplit(request.path).query)
        expr = parameters["query"][0]
        found.timeouts.update(parameters["timeout"])
        found.asked.append((expr, request.headers))
        answer = found.answers.get(expr, (500, b""))
        if isinstance(answer, Event):
            answer.wait(30)
            answer = 200, {"data": {"resultType": "vector", "result": []}}
        status, body = answer
        return status, body if isinstance(body, bytes) else json.dumps(body).encode()

    with replying(reply) as address:
        found.address = address
        yield found
        for answer in found.answers.values():
            if isinstance(answer, Event):
                answer.set()


class Received:
    """What the source reports."""

    def __init__(self) -> None:
        self.answers: list[tuple[Feed, Mapping[str, Sequence[Status]], Instant]] = []
        self.known = {"r1": "10.0.0.1", "r2": "fd00::2", "r3": ""}

    def receive_answer(
        self, feed: Feed, statuses: Mapping[str, Sequence[Status]], now: Instant
    ) -> None:
        self.answers.append((feed, statuses, now))

    def addresses(self) -> Mapping[str, str]:
        return self.known


class Asking:
    """The source, and what it reports."""

    def __init__(self, stub: Stub, **login: Path | str) -> None:
        self.stub = stub
        self.received = Received()
        client = Client(f"http://{stub.address}", timeout=1.0, **login)  # type: ignore[arg-type]
        self.source = Prometheus(self.received, client, lambda: NOW)

    def follow(self, *queries: Query) -> None:
        self.source.configure(Fleet("f", queries=queries), NOW)

    def outcome(self, name: str) -> Outcome:
        (found,) = (each for each in self.source.outcomes() if each.query.name == name)
        return found

    def wait(self, name: str) -> Outcome:
        """How a query is answered, once it is."""
        until(lambda: self.outcome(name).error is not None, f"{name} is answered")
        return self.outcome(name)

    def once(self, query: Query) -> dict[str, list[tuple[int, str, str]]]:
        """Level, name and message of each robot's statuses in the next answer of a query."""
        before = len(self.received.answers)
        if query.name in [each.query.name for each in self.source.outcomes()]:
            for loop in self.source.loops:
                loop.wake()
        else:
            self.follow(query)
        until(lambda: len(self.received.answers) > before, "an answer")
        statuses = self.received.answers[-1][1]
        return {
            robot: [(each.level, each.name, each.message) for each in of_robot]
            for robot, of_robot in statuses.items()
        }


@pytest.fixture
def asking(stub: Stub) -> Iterator[Asking]:
    found = Asking(stub)
    yield found
    found.source.stop()


def query(expr: str = "x", component: str = "disk {mountpoint}", **more: Any) -> Query:
    return Query(expr, component, **{"robot": "robot", **more})


def test_each_element_is_a_component_of_the_robot_that_its_label_names(asking, stub):
    stub.result(
        "x",
        ({"robot": "r1", "mountpoint": "/"}, 91.25),
        ({"robot": "r1", "mountpoint": "/data"}, 80),
        ({"robot": "r2", "mountpoint": "/"}, 80.5),
    )
    found = asking.once(query(thresholds=HIGH, unit="%", stale_after=45.0))

    assert found == {
        "r1": [
            (Level.ERROR, "disk /", "91.25 %, above the critical threshold of 90 %"),
            (Level.OK, "disk /data", "80 %"),
        ],
        "r2": [(Level.WARN, "disk /", "80.5 %, above the warning threshold of 80 %")],
    }
    feed, statuses, now = asking.received.answers[0]
    assert (feed, now) == (Feed("Host/disk {mountpoint}", "Host", 45.0), NOW)
    assert {type(each.level) for each in statuses["r1"]} == {int}  # written as a number
    assert statuses["r1"][0].values == (("value (%)", "91.25"),)
    assert asking.outcome("Host/disk {mountpoint}").rows == 3


def test_elements_of_no_robot_of_this_fleet_are_skipped_and_counted(asking, stub):
    stub.result(
        "x",
        ({"robot": "r1", "fleet": "f"}, 1),
        ({"robot": "r1", "fleet": "another"}, 2),
        ({"robot": "unknown"}, 3),
        ({}, 4),
        ({"robot": "r2", "__name__": "ros_diagnostics_robot_up"}, 5),
    )
    assert asking.once(query()) == {"r1": [(Level.OK, "disk", "1")]}
    until(lambda: asking.outcome("Host/disk {mountpoint}").rows == 1, "counted")
    assert asking.outcome("Host/disk {mountpoint}").skipped == 4


@pytest.mark.parametrize("instance", ["10.0.0.1", "10.0.0.1:9100", "[fd00::2]:9100", "fd00::2"])
def test_a_robot_is_found_by_its_address_whatever_the_port(asking, stub, instance):
    stub.result("x", ({"instance": instance}, 1), ({"instance": ""}, 1), ({}, 1))
    wanted = "r1" if "10." in instance else "r2"
    assert list(asking.once(query(robot=None, address="instance"))) == [wanted]


def test_of_several_elements_of_one_component_the_worst_counts(asking, stub):
    rows = [({"robot": "r1", "cpu": str(cpu)}, number) for cpu, number in enumerate((5, 95, 50))]
    stub.result("x", *rows)
    assert asking.once(query(component="cpu", thresholds=HIGH))["r1"][0][0] == Level.ERROR
    stub.result("low", *rows)
    low = (Threshold("low", "critical", 10.0),)
    found = asking.once(query("low", "free", thresholds=low))
    assert found["r1"] == [(Level.ERROR, "free", "5, below the critical threshold of 10")]


def test_a_level_ends_beyond_the_hysteresis_as_that_of_a_value(asking, stub):
    disk = query(component="disk", thresholds=HIGH)

    def level(number: float) -> int:
        stub.result("x", ({"robot": "r1"}, number))
        return asking.once(disk)["r1"][0][0]

    numbers = [90, 91, 89, 88.2, 88, 79, 78.4, 78.3, 79]
    assert [level(each) for each in numbers] == [
        *(Level.WARN, Level.ERROR, Level.ERROR, Level.WARN, Level.WARN, Level.WARN),
        *(Level.OK, Level.OK, Level.OK),
    ]


def test_hostile_content_is_text_and_what_is_no_number_is_no_component(asking, stub):
    body = (
        rb'{"data": {"resultType": "vector", "result": ['
        rb'{"metric": {"robot": "r1", "mountpoint": "\ud800\u0000\n {robot}"}, "value": [0, "1"]},'
        rb'{"metric": {"robot": "r2"}, "value": [0, "NaN"]},'
        rb'{"metric": {"robot": "r2"}, "histogram": [0, {}]},'
        rb'{"metric": {"robot": "r3"}, "value": [0, "+Inf"]}]}}'
    )
    stub.answers["x"] = 200, body
    found = asking.once(query(thresholds=HIGH))
    assert found == {
        "r1": [(Level.OK, "disk ?\x00 {robot}", "1")],
        "r3": [(Level.ERROR, "disk", "inf, above the critical threshold of 90")],
    }
    assert math.isinf(float(asking.received.answers[0][1]["r3"][0].values[0][1]))


@pytest.mark.parametrize(
    ("answer", "words"),
    [
        (
            (400, {"status": "error", "error": "1:3: parse error: ups"}),
            "400: 1:3: parse error: ups",
        ),
        ((503, b"<html>"), "answered 503"),
        ((422, {"error": "query timed out in expression evaluation"}), "422: query timed out"),
        ((200, b"<html>"), "no answer of http://"),
        ((200, b'{"data": []}'), "is no Prometheus"),
        ((200, b"[" * 100_000), "no answer of http://"),
        ((200, {"data": {"resultType": "scalar", "result": [0, "1"]}}), "the result is a scalar"),
        ((200, b" " * (prometheus.MAX_BYTES + 1)), "answered more than 8388608 bytes"),
        (
            (200, {"data": {"resultType": "vector", "result": [{}] * (prometheus.MAX_ROWS + 1)}}),
            "10001 elements, above the limit of 10000: aggregate it by robot",
        ),
    ],
)
def test_a_bad_query_says_why_and_harms_no_other(asking, stub, caplog, answer, words):
    stub.answers["bad"] = answer
    stub.result("good", ({"robot": "r1"}, 1))
    asking.follow(query("bad", "bad"), query("good", "good"))

    assert words in (asking.wait("Host/bad").error or "")
    assert asking.wait("Host/good").error == ""
    assert [feed.name for feed, *_ in asking.received.answers] == ["Host/good"]
    assert [each.args[1] for each in caplog.records] == [asking.outcome("Host/bad").error]


def test_prometheus_is_told_how_long_it_may_take(asking, stub):
    stub.result("good", ({"robot": "r1"}, 1))
    asking.once(query("good", "good"))
    assert stub.timeouts == {"5s"}


def test_what_is_measured_is_as_old_as_the_question(stub):
    stub.result("good", ({"robot": "r1"}, 1))
    received, seconds = Received(), count()
    clocks = lambda: Instant(float(next(seconds)), 0.0)  # noqa: E731
    source = Prometheus(received, Client(f"http://{stub.address}"), clocks)
    source.configure(Fleet("f", queries=(query("good", "good"),)), NOW)
    until(lambda: received.answers, "an answer")
    source.stop()
    assert received.answers[0][2].mono == 0.0


def test_of_why_a_query_has_no_answer_a_line_is_kept(asking, stub):
    stub.answers["bad"] = 400, {"error": "1:3: parse error: " + 9_000 * "x"}
    asking.follow(query("bad", "bad"))
    assert len(asking.wait("Host/bad").error or "") == prometheus.MAX_ERROR


def test_a_query_that_hangs_harms_no_other_and_its_answer_after_the_end_does_not_count(
    asking, stub
):
    stub.answers["hangs"] = Event()
    stub.result("good", ({"robot": "r1"}, 1))
    asking.follow(query("hangs", "hangs"), query("good", "good"))
    assert asking.wait("Host/good").error == ""
    until(lambda: stub.times("hangs"), "it is asked")
    assert asking.outcome("Host/hangs").error is None

    loops = asking.source.loops
    asking.source.stop()
    stub.answers["hangs"].set()
    until(lambda: not any(loop.alive for loop in loops), "all loops end")
    assert {feed.name for feed, *_ in asking.received.answers} == {"Host/good"}


def test_without_prometheus_nothing_is_received_until_it_is_back(asking, stub, caplog):
    stub.answers["x"] = 503, b""
    asking.follow(query())
    assert "answered 503" in (asking.wait("Host/disk {mountpoint}").error or "")
    assert not asking.received.answers
    for number in range(2):
        asking.source.loops[0].wake()
        until(lambda wanted=number + 2: stub.times("x") >= wanted, "it is asked again")
    stub.result("x", ({"robot": "r1"}, 1))
    with caplog.at_level("INFO"):
        assert asking.once(query())
        until(lambda: asking.outcome("Host/disk {mountpoint}").error == "", "answered")
    assert [each.levelname for each in caplog.records] == ["WARNING", "INFO"]


def test_without_a_url_each_query_says_so():
    source = Prometheus(Received(), None, lambda: NOW)
    source.configure(Fleet("f", queries=(query(),)), NOW)
    until(lambda: source.outcomes()[0].error == NO_URL, "it is said")
    source.stop()


def test_a_reload_changes_what_it_changes(asking, stub):
    for expr in "abc":
        stub.result(expr, ({"robot": "r1"}, 1))
    asking.follow(query("a", "same"), query("b", "changed"), query("c", "gone"))
    for name in ("same", "changed", "gone"):
        asking.wait(f"Host/{name}")
    same, changed, gone = asking.source.loops
    asking.follow(query("a", "same"), query("c", "changed"))

    assert asking.source.loops[0] is same
    until(lambda: not changed.alive and not gone.alive, "the others end")
    assert [each.query.expr for each in asking.source.outcomes()] == ["a", "c"]
    asking.wait("Host/changed")
    assert stub.times("c") == 2


EXAMPLES = {
    "Power/battery": ({"instance": "10.0.0.40"}, 49, "dock_1", "battery"),
    "Server/disk {mountpoint}": (
        {"instance": "10.0.0.2:9100", "mountpoint": "/srv"},
        15,
        "map_server",
        "disk /srv",
    ),
}


@pytest.mark.parametrize("name", EXAMPLES)
def test_the_worked_examples_make_components_of_their_robots(stub, name):
    labels, number, robot, component = EXAMPLES[name]
    fleet = load(DOCS / "examples" / "queries" / "fleet.yml")
    (example,) = (each for each in fleet.queries if each.name == name)
    assert f"- expr: {example.expr}\n" in (DOCS / "queries.md").read_text(encoding="utf-8")
    state = FleetState(fleet, NOW)
    stub.result(example.expr, (labels, number))
    source = Prometheus(state, Client(f"http://{stub.address}"), lambda: NOW)
    source.configure(fleet, NOW)
    try:
        until(lambda: len(state.robots[robot].components), "it is measured")
    finally:
        source.stop()
    (found,) = state.robots[robot].components
    assert (found.group, found.name, found.level) == (example.group, component, Level.WARN)


@pytest.mark.parametrize("kind", ["user", "token"])
def test_the_login_is_read_anew_for_each_question(stub, tmp_path, kind):
    secret = tmp_path / "secret"
    login: dict[str, Any] = {"bearer_token_file": secret}
    if kind == "user":
        login = {"user": "ann", "password_file": secret}
    asking = Asking(stub, **login)
    stub.result("x", ({"robot": "r1"}, 1))
    expected = []
    for word in ("one", "two"):
        secret.write_text(f"{word}\n")
        asking.once(query())
        basic = base64.b64encode(f"ann:{word}".encode()).decode()
        expected.append(f"Basic {basic}" if kind == "user" else f"Bearer {word}")
    asking.source.stop()
    assert [headers["Authorization"] for _expr, headers in stub.asked] == expected
