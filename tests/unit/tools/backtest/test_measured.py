"""Queries of fleet.yml in a back-test: asked of that time, judged with the recorded messages."""

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest

from support.bags import BEGIN, every_second, write_bag
from support.loopback import Request, replying

FLEET = """\
fleet: f
profiles: {default: {confirm_after: 10s}}
robots:
  - {name: r, namespace: /r, labels: {uplink: ap}}
  - {name: ap, source: queries}
queries:
  - {expr: load, component: load, interval: 10s, thresholds: {high: {critical: 5}}}
  - {expr: ping, component: ping, interval: 10s, thresholds: {low: {critical: 1}}, uplink: true}
"""
Series = Mapping[str, Mapping[int, float]]  # robot -> second -> value


class Stub:
    """A Prometheus that has series; each value is found for 15 s."""

    def __init__(self) -> None:
        self.series: dict[str, Series] = {"load": {}, "ping": {}}
        self.asked: list[tuple[str, float, float, float]] = []
        self.errors: dict[str, str] = {}
        self.address = ""

    def answer(self, path: str, given: Mapping[str, list[str]]) -> tuple[int, Any]:
        expr = given["query"][0]
        begin, end, step = (float(given[name][0]) for name in ("start", "end", "step"))
        self.asked.append((expr, begin - BEGIN, end - BEGIN, step))
        if expr in self.errors:
            return 400, {"error": self.errors[expr]}
        assert path == "/api/v1/query_range"
        times = [begin + number * step for number in range(round((end - begin) / step) + 1)]
        result = [
            {"metric": {"robot": robot}, "values": list(found)}
            for robot, values in self.series[expr].items()
            if (found := list(self._values(values, times)))
        ]
        return 200, {"data": {"resultType": "matrix", "result": result}}

    def _values(self, values: Mapping[int, float], times: list[float]) -> Iterator[list[Any]]:
        for at in times:
            known = [second for second in values if 0 <= at - BEGIN - second < 15]
            if known:
                yield [at, str(values[max(known)])]


@pytest.fixture
def stub() -> Iterator[Stub]:
    found = Stub()

    def reply(request: Request) -> tuple[int, bytes]:
        url = urlsplit(request.path)
        status, body = found.answer(url.path, parse_qs(url.query))
        return status, json.dumps(body).encode()

    with replying(reply) as address:
        found.address = address
        yield found


class Backtest:
    """The command, for one recording of 300 s in which the robot is silent from 100 s to 200 s."""

    def __init__(self, folder: Path, run: Any, stub: Stub) -> None:
        self._run, self._stub = run, stub
        seconds = [*range(100), *range(200, 300)]
        rows = every_second(seconds, {"motor": range(20, 60)}, topic="/r/diagnostics")
        self._bag, self.config = write_bag(folder / "bag", rows), folder / "fleet.yml"
        self.config.write_text(FLEET)

    def run(self, *arguments: str) -> tuple[dict[tuple[str, str], list[float | None]], str]:
        """When each fault began to be notified and ended; what the command says on stderr."""
        printed = self.print(*arguments)
        return {
            (each["component"] or each["state"], each["robot"]): [
                None if each[key] is None else round(each[key] - BEGIN)
                for key in ("notified", "ended")
            ]
            for each in json.loads(printed.out)["notifications"]
        }, printed.err

    def print(self, *arguments: str) -> Any:
        """What the command prints, in JSON."""
        given = ("--config", str(self.config), "--output", "json", *arguments)
        return self._run("backtest", *given, str(self._bag))

    def asking(self, *arguments: str) -> tuple[dict[tuple[str, str], list[float | None]], str]:
        return self.run("--prometheus", f"http://{self._stub.address}", *arguments)


@pytest.fixture
def backtest(tmp_path, run, stub) -> Backtest:
    return Backtest(tmp_path, run, stub)


def test_what_was_measured_is_judged_with_what_was_recorded(backtest, stub):
    high = dict.fromkeys(range(60, 80, 5), 9)
    stub.series["load"] = {"r": {**dict.fromkeys(range(0, 300, 5), 1), **high}}
    stub.series["ping"] = {"ap": dict.fromkeys(range(0, 300, 5), 1)}
    found, said = backtest.asking()
    assert found["motor", "r"] == [30, 60]
    assert found["load", "r"] == [70, 80]
    assert ("silent", "r") in found
    assert said == ""


def test_without_a_prometheus_queries_are_not_judged(backtest, stub):
    found, said = backtest.run()
    assert set(found) == {("motor", "r"), ("silent", "r")}
    assert (said, stub.asked) == ("", [])


def test_a_robot_behind_an_uplink_that_failed_then_was_not_silent_by_itself(backtest, stub):
    failed = dict.fromkeys(range(95, 205, 5), 0)
    stub.series["ping"] = {"ap": {**dict.fromkeys(range(0, 300, 5), 1), **failed}}
    found, said = backtest.asking()
    assert set(found) == {("motor", "r"), ("ping", "ap")}
    assert said == "ros-diagnostics: query Host/load: no series\n"


def test_a_query_that_has_no_answer_is_named_and_harms_no_other(backtest, stub):
    stub.errors["ping"] = "parse error: unexpected end"
    stub.series["load"] = {"r": dict.fromkeys(range(0, 300, 5), 9)}
    found, said = backtest.asking()
    assert found["load", "r"] == [25, None]  # the robot's return had to be over first
    assert "query Host/ping: " in said
    assert "parse error: unexpected end" in said


def test_what_prometheus_had_no_series_of_is_no_fault(backtest, stub):
    found, said = backtest.asking()
    assert set(found) == {("motor", "r"), ("silent", "r")}
    assert "query Host/load: no series" in said


def test_it_is_asked_in_pieces_of_500_steps(backtest, stub, monkeypatch):
    monkeypatch.setattr("ros_diagnostics_tools.backtest.measured.STEPS", 10)
    stub.series["load"] = {"r": dict.fromkeys(range(0, 300, 5), 9)}
    found, _said = backtest.asking()
    pieces = [(begin, end) for expr, begin, end, _step in stub.asked if expr == "load"]
    assert pieces == [(0, 90), (100, 190), (200, 290)]
    assert found["load", "r"] == [25, None]


def test_two_configurations_are_each_judged_by_their_own_queries(backtest, stub, tmp_path):
    other = tmp_path / "other.yml"
    other.write_text(FLEET.replace("critical: 5", "critical: 50"))
    stub.series["load"] = {"r": dict.fromkeys(range(0, 300, 5), 9)}
    stub.series["ping"] = {"ap": dict.fromkeys(range(0, 300, 5), 1)}
    url = ("--prometheus", f"http://{stub.address}")
    found = json.loads(backtest.print("--compare", str(other), *url).out)
    assert "load" in {each["component"] for each in found["notifications"]}
    assert found["comparison"]
