"""What is wrong with the exporter itself: its parts, their levels, the faults that come of them."""

from types import SimpleNamespace
from typing import Any

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Limits, Robot
from ros_diagnostics_exporter.config.shard import Shard
from ros_diagnostics_exporter.faults.model import OwnReport, Scope
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.fleet.unmatched import Unmatched
from ros_diagnostics_exporter.model import Endpoint, Instant, Level
from ros_diagnostics_exporter.rejected_logins import RejectedLogins
from ros_diagnostics_exporter.self_check import SelfCheck
from ros_diagnostics_exporter.storage.pruning import Early

OK, WARN, ERROR, STALE = Level
WALL = 1_700_000_000.0
HOST = "build-7"


def at(second: float) -> Instant:
    return Instant(second, WALL + second)


class Parts:
    """An exporter that is well; a test breaks one of its parts."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, robots: int = 1) -> None:
        monkeypatch.setattr("socket.gethostname", lambda: HOST)
        declared = tuple(Robot(f"r{n}", topic_agg=f"/r{n}/d", domain_id=7) for n in range(robots))
        self.state = FleetState(Fleet("f", declared, limits=Limits(series=1000)), at(0))
        self.listener = SimpleNamespace(troubles={7: ""}, oddities={7: ""})
        self.reloader = SimpleNamespace(successful=True)
        self.storage: Any = SimpleNamespace(
            successful=True,
            written_at=WALL + 1,
            is_crowded=False,
            crowded_reason="no room",
            early=Early(),
        )
        self.alertmanager: Any = SimpleNamespace(answers=lambda _now: True)
        self.exposition = SimpleNamespace(series={"a": 800, "b": 100})
        self.loop = SimpleNamespace(name="unmatched", last_turn=WALL + 1e6, interval=60.0)
        self.rejected_logins = RejectedLogins()
        self.others: Any = None
        self.found: list[Any] = []
        self.check = SelfCheck(self, at(0))  # type: ignore[arg-type]

    def loops(self) -> list[Any]:
        return [self.loop, SimpleNamespace(name="tick", last_turn=0.0, interval=0.5)]

    def outcomes(self) -> list[Any]:
        return self.found

    def report(self, part: str, second: float = 1000.0) -> OwnReport:
        (found,) = [each for each in self.check.reports(at(second)) if each.part == part]
        return found


@pytest.fixture
def parts(monkeypatch: pytest.MonkeyPatch) -> Parts:
    return Parts(monkeypatch)


@pytest.mark.parametrize(
    ("others", "expected"),
    [
        (("", [], True), (OK, "")),
        (("no", [Shard(2, 3)], True), (WARN, "what the others count is not known: no")),
        (("", [Shard(2, 3)], False), (OK, "")),
        (("", [Shard(2, 3)], True), (ERROR, "there is no exporter with --shard=2/3: its robots")),
    ],
)
def test_that_a_shard_is_missing_is_said_by_one_of_the_others(parts, others, expected):
    assert "shards" not in [each.part for each in parts.check.reports(at(1000))]
    error, missing, is_first = others
    parts.others = SimpleNamespace(error=error, missing=missing, is_first=is_first)
    report = parts.report("shards")
    level, message = expected
    assert (report.level, report.confirm_after) == (level, 300.0)
    assert report.message.startswith(message)


def test_nothing_is_wrong_with_an_exporter_that_works(parts):
    parts.found = [outcome("disk", "")]
    reports = {each.part: each.level for each in parts.check.reports(at(1000))}
    assert reports == dict.fromkeys(
        (
            *("fleet.yml", "entries of fleet.yml", "database", "history", "logins", "Alertmanager"),
            *("queries", "domain 7", "loop unmatched", "robots", "series", "rejections"),
        ),
        OK,
    )


def outcome(name: str, error: str | None) -> Any:
    return SimpleNamespace(query=SimpleNamespace(name=name), error=error)


def test_each_message_names_the_host_as_the_halves_of_a_pair_have_one_name(parts):
    parts.storage.successful = False
    report = parts.report("database")
    assert report.level is WARN
    assert report.message.startswith("it cannot be written")
    assert report.message.endswith(f";\non host {HOST}")


def test_a_database_without_room_for_events_is_a_fault(parts):
    parts.storage.is_crowded = True
    report = parts.report("database")
    assert (report.level, report.message) == (WARN, f"no room;\non host {HOST}")
    parts.storage.successful = False
    assert parts.report("database").message.startswith("it cannot be written")


def test_a_failed_reload(parts):
    parts.reloader.successful = False
    assert parts.report("fleet.yml").level is WARN


def test_a_database_is_known_to_be_written_once_it_was_since_the_start(parts):
    parts.storage.written_at = WALL - 10
    assert parts.report("database").level is STALE
    parts.storage = None
    assert "database" not in {each.part for each in parts.check.reports(at(1))}


def test_an_alertmanager_that_does_not_answer_has_five_minutes(parts):
    parts.alertmanager.answers = lambda _now: False
    report = parts.report("Alertmanager")
    assert (report.level, report.confirm_after) == (WARN, 300.0)


def test_queries_are_one_part_which_names_those_that_fail(parts):
    parts.found = [outcome("load", None), outcome("disk", "")]
    assert parts.report("queries").level is STALE
    parts.found = [outcome(f"q{n}", "parse error") for n in range(5)] + [outcome("disk", "")]
    report = parts.report("queries")
    assert report.level is WARN
    listed = "q0: parse error; q1: parse error; q2: parse error and 2 more"
    assert report.message.startswith(f"5 of 6 have no answer: {listed};")


def test_a_domain_that_is_not_received_is_critical_and_what_cannot_be_read_a_warning(parts):
    parts.listener.troubles = {7: "it is not joined: port in use"}
    report = parts.report("domain 7")
    assert (report.level, report.message[:29]) == (ERROR, "it is not joined: port in use")
    parts.listener.troubles, parts.listener.oddities = {7: ""}, {7: "1 nodes have no name"}
    report = parts.report("domain 7")
    assert (report.level, report.message[:20]) == (WARN, "1 nodes have no name")
    parts.listener.oddities = {7: ""}
    assert parts.report("domain 7").level is OK
    parts.listener.troubles = {}
    assert parts.report("domain 7").message.startswith("it is not joined yet")


def test_an_exporter_without_robots_names_the_topics_that_no_entry_takes(monkeypatch):
    parts = Parts(monkeypatch, robots=0)
    parts.state.update_graph(7, {"/diagnostics": Endpoint(1)}, at(1))
    message = parts.report("robots", 1000).message
    assert "no entry of fleet.yml matches /diagnostics in domain 7" in message
    assert "- {name: robot_7, domain_id: 7}" in message


def test_a_loop_whose_turn_is_a_minute_late_is_critical_also_one_that_never_had_one(parts):
    parts.loop.last_turn = 0.0
    assert parts.report("loop unmatched", 120).level is OK
    assert parts.report("loop unmatched", 121).level is ERROR
    parts.loop.last_turn = WALL + 121
    assert parts.report("loop unmatched", 241).level is OK


@pytest.mark.parametrize("name", ["tick", "storage", "config", "domain-7"])
def test_loops_whose_trouble_is_reported_otherwise_are_no_part(parts, name):
    parts.loop.name = name
    found = [each.part for each in parts.check.reports(at(1000))]
    assert not [each for each in found if each.startswith("loop")]


def test_what_matches_nothing_is_known_some_minutes_after_the_start(parts):
    assert parts.report("entries of fleet.yml", 360).level is STALE
    assert parts.report("entries of fleet.yml", 361).level is OK
    parts.state.unmatched.entries = (Unmatched("check", "motors: Mottor", "Motor 1"),)
    report = parts.report("entries of fleet.yml")
    assert report.level is WARN
    assert "check motors: Mottor matches nothing; the nearest is 'Motor 1'" in report.message


def test_that_no_robot_is_known_counts_once_the_fleet_has_settled(monkeypatch):
    parts = Parts(monkeypatch, robots=0)
    assert parts.report("robots", 1).level is STALE
    report = parts.report("robots", 1000)
    assert (report.level, report.confirm_after) == (WARN, 300.0)


@pytest.mark.parametrize(("served", "level"), [(100, OK), (101, WARN)])
def test_more_than_nine_tenths_of_the_limit_of_series(parts, served, level):
    parts.exposition.series = {"a": 800, "b": served}
    assert parts.report("series").level is level


def test_before_the_first_scrape_the_number_of_series_is_not_known(parts):
    parts.exposition.series = {}
    assert parts.report("series").level is STALE


def test_what_was_rejected_counts_for_ten_minutes_and_is_at_once_a_fault(parts):
    assert parts.report("rejections", 600).level is STALE
    parts.state.rejected["robot_limit"] += 3
    report = parts.report("rejections", 700)
    assert (report.level, report.confirm_after) == (WARN, 0.0)
    assert "(robot_limit)" in report.message
    assert parts.report("rejections", 1299).level is WARN
    assert parts.report("rejections", 1300).level is OK


def test_a_part_that_is_wrong_is_a_fault_with_its_message_as_evidence_until_it_is_right(parts):
    def judge(second: float) -> list[tuple[str, str]]:
        reports, now = parts.check.reports(at(second)), at(second)
        parts.state.judge(lambda of, reports=reports, now=now: of.own(reports, now))
        parts.state.tick(at(second))
        found = [each for each in parts.state.faults() if each.identity.scope is Scope.EXPORTER]
        return [(each.identity.component, each.evidence) for each in found]

    parts.storage.successful = False
    assert judge(1000) == []
    assert judge(1059) == []
    why = {each.identity.component: each.text for each in parts.state.problems(at(1059))}
    assert "it cannot be written" in why["database"]
    ((part, evidence),) = judge(1060)
    assert part == "database"
    assert "it cannot be written" in evidence
    parts.storage.successful = True
    assert judge(1061) == []
    events = [event for event in parts.state.take_events() if event.scope == "exporter"]
    assert [event.kind for event in events] == ["fault_began", "fault_ended"]
