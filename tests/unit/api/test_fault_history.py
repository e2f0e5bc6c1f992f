"""The history: which faults it is of, and what of the events belongs to it."""

from typing import Any

import pytest

from ros_diagnostics_exporter.api.fault_history import (
    LATE,
    Window,
    entries,
    fault_history,
    standings,
    window,
)
from support.web_server import broken, downtime, problem, robot

MOTOR = {"scope": "component", "state": "critical", "severity": "critical", "group": "/M"}


def event(number: int, time: float, kind: str, component: str = "Motor 1", **more: Any):
    of = {"robot": "r", "component": component} if component else {}
    return {"id": number, "time": time, "kind": kind, **of, **more}


def fault(kind: str, since: float, time: float, **more: Any) -> dict[str, Any]:
    return event(int(time), time, kind, since=since, **MOTOR, **more)


OLD, OLD_END = fault("fault_began", 100, 110), fault("fault_ended", 100, 150, reason="recovered")
NEW = fault("fault_began", 2_000, 2_010)
LONG, LONG_END = fault("fault_began", 50, 60), fault("fault_ended", 50, 1_000, reason="recovered")


@pytest.mark.parametrize(
    ("at", "found"),
    [
        (120, Window(99, 150 + LATE)),  # lasts
        (200, Window(99, 150 + LATE)),  # the last one before
        (2_100, Window(1_999, float("inf"))),
    ],
)
def test_the_time_is_that_of_the_faults_that_lasted_then(at, found):
    began = [each for each in (NEW, OLD) if each["time"] < at]
    assert window(began, [OLD_END], at) == found


def test_a_fault_that_has_just_ended_counts_beside_one_that_goes_on():
    assert window([NEW, LONG], [LONG_END], 2_020) == Window(1_999, float("inf"))
    later = fault("fault_began", 990, 995)
    assert window([later, LONG], [LONG_END], 1_000 + LATE) == Window(49, float("inf"))


def test_of_those_before_it_is_the_one_that_ended_last():
    assert window([OLD, LONG], [OLD_END, LONG_END], 5_000) == Window(49, 1_000 + LATE)


def test_without_a_fault_it_is_the_hour_before():
    assert window([], [], 10_000) == Window(6_400, 10_000 + LATE)


def test_everything_that_happened_is_in_order_and_of_others_nothing():
    notified = fault("notified", 300, 312, receiver="email", after="firing")
    acknowledged = fault("acknowledged", 300, 330, author="ann", message="on it")
    level = event(1, 300, "level", before="OK", after="ERROR", message="hot", group="/M")
    silent = {"id": 2, "time": 320, "kind": "robot", "robot": "r", "after": "silent"}
    other = event(3, 320, "level", "Motor 2", before="OK", after="WARN")
    site = {**MOTOR, "scope": "site", "state": "silent", "site": "hall"}
    of_many = [
        {"id": 4, "time": 325, "kind": "fault_began", **site},
        {"id": 5, "time": 325, "kind": "fault_began", **site, "site": "yard"},
        {"id": 6, "time": 326, "kind": "config", "after": "read"},
    ]
    began = fault("fault_began", 300, 310)
    own = [acknowledged, silent, notified, other, began, level]
    assert [each["text"] for each in entries(own, of_many, "Motor 1", "hall")] == [
        "/M/Motor 1 OK → ERROR: hot",
        "fault began: CRITICAL /M/Motor 1",
        "notification sent to email: CRITICAL /M/Motor 1",
        "robot is silent",
        "fault began: SILENT many robots of site hall are silent",
        "acknowledged by ann: CRITICAL /M/Motor 1: on it",
    ]
    assert len(entries(own, of_many, None, "hall")) == 7
    many = {"id": 7, "time": 327, "kind": "fault_began", **MOTOR, "scope": "common"}
    common = [{**many, "component": name} for name in ("Motor 1", "Lidar")]
    assert len(entries([level], common, "Motor 1", "")) == 2
    assert len(entries([level], common, None, "")) == 2
    well = {**level, "before": "ERROR", "after": "OK"}
    assert (
        len(entries([well], common, "Motor 1", "")) == len(entries([well], common, None, "")) == 1
    )


def test_the_account_of_a_component_has_its_problems_and_the_events_around_its_fault():
    log = [NEW, OLD_END, OLD]
    asked = []

    def find(**wanted: Any) -> list[dict[str, Any]]:
        asked.append(wanted)
        return [each for each in log if wanted.get("kind") in (None, each["kind"])]

    recording = "/api/v1/faults/1/recording.mcap"
    known = robot(
        "r",
        labels={"site": "hall"},
        problems=[broken(since=2_000.0, recording=recording), broken("Motor 2")],
    )
    found = fault_history(find, known, "Motor 1", 2_500.0, 2_600.0)

    assert (found["component"], found["at"], found["time"]) == ("Motor 1", 2_500.0, 2_600.0)
    assert found["now"] == [
        "critical /Motor/Motor 1: confirmed",
        f"recorded around its begin: {recording}",
    ]
    of, times = {"component": "Motor 1"}, {"since": 1_999, "until": float("inf")}
    assert asked == [
        {"kind": "fault_began", "robot": "r", **of, "until": 2_500.0, "limit": 100},
        {"kind": "fault_ended", "robot": "r", **of, "limit": 1_000},
        {"robot": "r", **times, "limit": 1_000},
        {"robot": "", **times, "limit": 100},
    ]
    assert len(fault_history(find, known, None, 2_500.0, 2_600.0)["now"]) == 3


def test_a_robots_texts_stay_on_their_line():
    level = event(1, 300, "level", before="OK", after="ERROR", message="a\n\x1b[31mb")
    [only] = entries([level], [], None, "")
    assert only["text"].isprintable()


def test_what_is_now_says_why_nobody_is_notified():
    suppressed = problem(
        "component", "critical", suppressed="maintenance", group="/M", component="Motor 1"
    )
    problems = [suppressed, broken(notified={"email": 1_000.0})]
    until = "maintenance until 14:00 UTC"
    stand = [
        f"critical /M/Motor 1: suppressed: {until}; nobody is notified",
        "critical /Motor/Motor 1: confirmed; notified 1 min ago: email",
    ]
    planned = robot("r", maintenance=True, maintenance_until=50_400.0)
    assert standings(problems, 1_060.0, planned) == [until, *stand]


def test_who_planned_the_downtime_of_a_component_is_the_reason_of_suppression():
    suppressed = problem(
        "component", "critical", suppressed="maintenance", group="/M", component="Motor 1"
    )
    planned = "maintenance until 20:00 UTC (ann: new gears)"
    other = downtime("Motor 2", comment="other")
    assert standings([suppressed], 1_060.0, robot("r", downtimes=[downtime("Motor 1"), other])) == [
        f"Motor 1: {planned}",
        "Motor 2: maintenance until 20:00 UTC (ann: other)",
        f"critical /M/Motor 1: suppressed: {planned}; nobody is notified",
    ]
    assert standings([], 1_060.0, robot("r")) == []
