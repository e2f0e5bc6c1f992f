"""Behaviour of the real aggregator that the recordings in tests/data/golden do not show."""

from pathlib import Path

import pytest

from virtual_robots.aggregator import Aggregator, load_parameters
from virtual_robots.model import ERROR, OK, STALE, WARN, Status

GENERIC = "type: diagnostic_aggregator/GenericAnalyzer"
ROW = dict[str, tuple[int, str]]


class Bench:
    """An aggregator with analyzers given as text; time is what the test says."""

    def __init__(self, folder: Path, body: str) -> None:
        path = folder / "diagnostics.yaml"
        path.write_text(f"/**:\n  ros__parameters:\n    {body}\n")
        self.aggregator = Aggregator(load_parameters(path), 0.0)

    def receive(self, now: float, *names: str, level: int = OK, message: str = "fine"):
        self.aggregator.receive([Status(level, name, message) for name in names], now)
        return self

    def rows(self, now: float) -> ROW:
        return {s.name: (s.level, s.message) for s in self.aggregator.publish(now).statuses}


def test_num_items_counts_what_was_ever_heard(tmp_path: Path) -> None:
    bench = Bench(tmp_path, f"m: {{{GENERIC}, path: M, contains: [Motor], num_items: 3}}")
    assert bench.rows(0.5) == {"/M": (STALE, "No items found, expected 3")}
    bench.receive(1.0, "Motor 1", "Motor 2")
    assert bench.rows(1.5)["/M"] == (ERROR, "Expected 3, found 2")
    assert bench.receive(2.0, "Motor 3").rows(2.5)["/M"] == (OK, "OK")


def test_num_items_zero_tolerates_none_and_any(tmp_path: Path) -> None:
    bench = Bench(tmp_path, f"m: {{{GENERIC}, path: M, contains: [Motor], num_items: 0}}")
    assert bench.rows(0.5) == {"/M": (OK, "OK")}
    assert bench.receive(1.0, "Motor 1", level=WARN).rows(1.5)["/M"] == (WARN, "Warning")


@pytest.mark.parametrize(("timeout", "stale"), [("2.0", True), ("0.0", False), ("-1.0", False)])
def test_a_timeout_of_zero_or_less_is_none(tmp_path: Path, timeout: str, stale: bool) -> None:
    bench = Bench(tmp_path, f"m: {{{GENERIC}, path: M, contains: [Motor], timeout: {timeout}}}")
    assert bench.receive(0.0, "Motor 1").rows(2.0)["/M/Motor 1"][0] == OK
    assert bench.rows(900.0)["/M/Motor 1"] == ((STALE if stale else OK), "fine")


def test_a_discarded_item_is_counted_as_missing_by_num_items(tmp_path: Path) -> None:
    bench = Bench(
        tmp_path, f"m: {{{GENERIC}, path: M, contains: [Motor], num_items: 1, discard_stale: true}}"
    )
    assert bench.receive(0.0, "Motor 1").rows(6.0) == {"/M": (ERROR, "No items found, expected 1")}


def test_a_component_is_listed_by_every_analyzer_that_takes_it(tmp_path: Path) -> None:
    bench = Bench(
        tmp_path,
        f"a: {{{GENERIC}, path: A, contains: [left]}}\n"
        f"    b: {{{GENERIC}, path: B, startswith: [Motor]}}",
    )
    bench.receive(0.0, "Motor left")
    assert set(bench.rows(0.5)) == {"/A", "/A/Motor left", "/B", "/B/Motor left"}


@pytest.mark.parametrize(
    ("name", "shown"),
    [("/arms/left/motor", " arms left motor"), ("//Motor//x", "  Motor  x"), ("", "")],
)
def test_slashes_in_names_become_blanks(tmp_path: Path, name: str, shown: str) -> None:
    bench = Bench(tmp_path, "path: R")
    assert f"/R/Other/{shown}" in bench.receive(0.0, name).rows(0.5)


@pytest.mark.parametrize("level", [4, 127, 255])
def test_a_level_that_there_is_not_is_an_error(tmp_path: Path, level: int) -> None:
    bench = Bench(tmp_path, f"m: {{{GENERIC}, path: M, contains: [Motor]}}")
    bench.receive(0.0, "Motor 1", level=level)
    assert bench.rows(0.5) == {"/M": (ERROR, "Error"), "/M/Motor 1": (ERROR, "fine")}


def test_the_last_of_two_statuses_of_one_name_counts(tmp_path: Path) -> None:
    bench = Bench(tmp_path, f"m: {{{GENERIC}, path: M, contains: [Motor]}}")
    bench.aggregator.receive([Status(ERROR, "Motor", "1st"), Status(OK, "Motor", "2nd")], 0.0)
    assert bench.rows(0.5)["/M/Motor"] == (OK, "2nd")


def test_other_forgets_what_falls_silent_and_then_itself(tmp_path: Path) -> None:
    bench = Bench(tmp_path, f"m: {{{GENERIC}, path: M, contains: [Motor]}}")
    assert bench.receive(0.0, "Motor", "Stranger").rows(1.0)["/Other/Stranger"] == (OK, "fine")
    assert set(bench.rows(6.0)) == {"/M", "/M/Motor"}


def test_a_base_path_is_not_tidied(tmp_path: Path) -> None:
    bench = Bench(tmp_path, f"path: /robot/7/\n    m: {{{GENERIC}, path: /M, contains: [Motor]}}")
    bench.receive(0.0, "Motor")
    assert set(bench.rows(0.5)) == {"//robot/7///M", "//robot/7///M/Motor", "//robot/7/"}


def test_groups_can_be_nested(tmp_path: Path) -> None:
    group = "type: diagnostic_aggregator/AnalyzerGroup"
    leaf = f"{{{GENERIC}, path: Joints, contains: [joint]}}"
    inner = f"{{{group}, path: Arm, analyzers: {{joints: {leaf}}}}}"
    bench = Bench(tmp_path, f"path: R\n    g: {{{group}, path: G, analyzers: {{arm: {inner}}}}}")
    rows = bench.receive(0.0, "joint a", level=WARN, message="hot").rows(0.5)
    assert list(rows) == ["/R/G/Arm/Joints", "/R/G/Arm/Joints/joint a", "/R/G/Arm", "/R/G", "/R"]
    assert rows["/R"] == (WARN, "Warning")


def test_without_any_row_the_top_level_is_stale(tmp_path: Path) -> None:
    body = "d: {type: diagnostic_aggregator/DiscardAnalyzer, path: D, contains: [x]}"
    report = Bench(tmp_path, body).aggregator.publish(0.5)
    assert report.statuses == ()
    assert report.toplevel == Status(STALE, "toplevel_state")
