"""The numbers of a week from the event log, recounted second by second."""

import time
from collections.abc import Callable, Iterator
from datetime import datetime
from typing import Any
from zoneinfo import ZoneInfo

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ros_diagnostics_exporter.api import week as report
from ros_diagnostics_exporter.api.occurrences import KINDS, WEEK, occurrences
from ros_diagnostics_exporter.events import Event, EventLog, Wanted
from support.web_server import occurrence

BEGIN, END = 100_000.0, 200_000.0
MOTOR = {"robot": "r", "group": "/Motor", "component": "Motor 1"}


def fault(since: float, until: float | None, **more: Any) -> dict[str, Any]:
    of = MOTOR | {"since": since, "confirmed": since + 10, "until": until}
    of |= {"reason": None if until is None else "recovered"}
    return occurrence("component", "critical", **(of | more))


def test_times_are_of_critical_faults_of_the_week_with_their_number():
    found = [
        fault(BEGIN, BEGIN + 100, acknowledged=[{"at": BEGIN + 40}, {"at": BEGIN + 30}]),
        fault(BEGIN + 500, BEGIN + 1_500, acknowledged=[{"at": BEGIN + 610}]),
        fault(BEGIN + 2_000, BEGIN + 9_000, reason="removed"),
        fault(BEGIN - 605, BEGIN, acknowledged=[{"at": BEGIN}]),  # begun before
        fault(END - 5, None),  # confirmed after
        fault(BEGIN, BEGIN + 7_000, severity="warning", acknowledged=[{"at": BEGIN + 9}]),
    ]
    assert len(report.begun(found, BEGIN, END)) == 3
    assert report.to_acknowledge(found, BEGIN, END) == (2, 60.0, 100.0)
    assert report.to_recover(found, BEGIN, END) == (3, 605.0, 1_000.0)
    assert report.to_recover([], BEGIN, END) == (0, None, None)


STEP = 10
moments = st.integers(-20, 120).map(lambda each: each * STEP)
made = st.lists(st.tuples(st.sampled_from("ab"), moments, st.integers(1, 60), st.booleans()))


@given(made)
@example([("a", -STEP, 1, False)])  # ended as the week began
def test_worst_parts_have_the_seconds_of_the_week_in_which_any_fault_lasted(given_faults):
    begin, end = 0.0, 100.0 * STEP
    found, covered = [], dict[str, set[int]]()
    for name, since, lasted, goes_on in given_faults:
        until = None if goes_on else float(since + lasted * STEP)
        found.append(fault(float(since), until, component=name))
        last = int(end) if until is None else int(min(end, until))
        covered.setdefault(name, set()).update(range(max(0, since), last))
    parts = report.worst_parts(found, begin, end)

    assert {each.part.removeprefix("/Motor/"): each.seconds for each in parts} == {
        name: len(seconds) for name, seconds in covered.items() if seconds
    }
    assert [each.seconds for each in parts] == sorted(
        (each.seconds for each in parts), reverse=True
    )
    for each in parts:
        assert 1 <= each.times <= len(given_faults)


def test_parts_of_two_robots_are_two_and_ten_are_shown():
    found = [fault(BEGIN, BEGIN + 10 + number, robot=f"r{number}") for number in range(12)]
    found += [fault(BEGIN, BEGIN + 5, robot="r3"), fault(BEGIN + 50, BEGIN + 60, robot="r11")]
    parts = report.worst_parts(found, BEGIN, END)
    assert len(parts) == 10
    assert parts[0] == ("r11", "/Motor/Motor 1", 2, 31.0)


def test_a_fault_whose_end_was_lost_counts_only_while_it_lasts():
    labels = {"scope": "component", "state": "critical", "severity": "critical", **MOTOR}
    began = {"id": 1, "time": 110.0, "kind": "fault_began", "since": 100.0, **labels}
    lasting = fault(100.0, None)
    [of_log] = occurrences([began])
    assert report.known([of_log], []) == []
    [known] = report.known([of_log], [lasting])
    assert (known["since"], known["until"]) == (100.0, None)
    [gone] = report.known([], [lasting])
    assert (gone["since"], gone["notified"]) == (100.0, [])


@pytest.fixture
def set_zone(monkeypatch) -> Iterator[Callable[[str], None]]:
    """Sets the time zone of the host."""

    def set_to(zone: str) -> None:
        monkeypatch.setenv("TZ", zone)
        time.tzset()

    yield set_to
    monkeypatch.undo()
    time.tzset()


@pytest.mark.parametrize(("zone", "offset"), [("UTC", 0), ("Asia/Tokyo", 9 * 3_600)])
def test_notifications_are_counted_in_the_night_of_their_evening(set_zone, zone, offset):
    set_zone(zone)
    midnight = 20_000 * 86_400.0 - offset  # 2024-10-04
    hours = [-45, -3, -2, 0, 5.9, 6, 12, 21.9, 22]
    sent = [
        {"at": midnight + hour * 3_600, "receiver": "a", "step": "", "after": "firing"}
        for hour in hours
    ]
    over = {**sent[2], "after": "resolved"}
    found = report.notified([fault(1, None, notified=[*sent, over])], midnight - 172_800, 2e9)
    assert found == [each["at"] for each in sent]
    nights = report.by_night(found, midnight - 172_800, midnight + 172_800)
    known = {"2024-10-01": 1, "2024-10-02": 0, "2024-10-03": 3, "2024-10-04": 1, "2024-10-05": 0}
    assert nights == known
    for hour, last in ((6, "2024-10-03"), (22, "2024-10-03"), (22.1, "2024-10-04")):
        week = report.by_night([], midnight - 172_800, midnight + hour * 3_600)
        assert [*week] == [each for each in known if "2024-10-02" <= each <= last]


def test_nights_before_a_change_of_the_clock_are_by_the_clock_of_then(set_zone):
    set_zone("Europe/Berlin")
    berlin = ZoneInfo("Europe/Berlin")  # its clock is set back on 2024-10-27
    sent = [datetime(2024, 10, day, 22, 30, tzinfo=berlin).timestamp() for day in (26, 27)]
    found = report.by_night(sent, sent[0] - 7_200, sent[1] + 7_200)
    assert found == {"2024-10-26": 1, "2024-10-27": 1}


def test_nights_are_those_of_the_hosts_time_zone(set_zone):
    midnight = 20_000 * 86_400.0
    of = LABELS | {"since": midnight - 9_000}
    log = [
        {"id": 1, "time": midnight - 9_000, "kind": "fault_began", **of},
        {"id": 2, "time": midnight - 7_000, "kind": "notified", "after": "firing", **of},
        {"id": 3, "time": midnight - 60, "kind": "fault_ended", "reason": "recovered", **of},
    ]
    for zone, nights in (("UTC", {"2024-10-03": 1}), ("Asia/Tokyo", {})):
        set_zone(zone)
        found = report.Counting(
            lambda kind, **_: [each for each in log if each["kind"] == kind]
        ).count([], midnight + 3_600)
        assert found is not None
        assert {night: n for night, n in found.nights.items() if n} == nights


LABELS = {"scope": "component", "state": "critical", "severity": "critical"}
steps = st.tuples(
    st.sampled_from(KINDS),
    st.sampled_from("ab"),
    st.integers(0, 3),  # faults of each part
    st.floats(0, 9 * 86_400.0),  # until the next count
)


@given(st.lists(steps, min_size=1))
def test_a_count_that_goes_on_with_the_one_before_is_one_from_the_beginning(given_steps):
    log, wall = EventLog(), 100.0 * 86_400
    read: list[int] = []

    def find(**wanted: Any) -> Iterator[dict[str, Any]]:
        for each in log.find(Wanted(**wanted)):
            read.append(each["id"])
            yield each

    counting, hour = report.Counting(find), None
    for kind, robot, number, passed in given_steps:
        lasting = [{**fault(number * 5e5, None), "robot": robot}]
        of = LABELS | {"since": number * 5e5, "robot": robot, "after": "firing"}
        log.record(Event(wall, kind, reason="recovered", **of))
        wall += passed if passed > 86_400 else passed / 1_000
        read.clear()
        found = counting.count(lasting, wall)
        if wall // report.READ_ANEW == hour:
            assert len(read) <= 1 + len(KINDS)  # the new one, and of each kind one that is known
        hour = wall // report.READ_ANEW
        assert found == report.Counting(find).count(lasting, wall)


def test_events_that_the_disk_kept_back_are_counted_in_the_next_hour(monkeypatch):
    began = {"id": 1, "time": 7_000.0, "kind": "fault_began", "since": 6_990.0, **LABELS}
    readable: list[dict[str, Any]] = []
    counting = report.Counting(lambda kind, **_: (e for e in readable if e["kind"] == kind))

    def faults(wall: float) -> int | None:
        found = counting.count([fault(6_990.0, None, group="", component="", robot="")], wall)
        return None if found is None else found.notifications

    notified = {**began, "id": 2, "time": 7_010.0, "kind": "notified", "after": "firing"}
    later = {**notified, "id": 3, "time": 7_020.0}
    readable[:] = [later, began]
    assert faults(7_100.0) == 1
    readable.append(notified)
    assert faults(7_150.0) == 1  # read from the newest on
    assert faults(7_200.0) == 2
    readable.insert(0, {**notified, "id": 4, "time": 7_250.0})
    monkeypatch.setattr(report, "MOST", 2)
    assert faults(7_260.0) is None
    monkeypatch.undo()
    assert faults(7_320.0) == 3


def test_the_first_event_of_a_log_counts():
    sent = {"time": 7_010.0, "kind": "notified", "after": "firing", "since": 6_990.0, **LABELS}
    counting = report.Counting(lambda kind, **_: [{**sent, "id": 1}] * (kind == "notified"))

    counted = counting.count([fault(6_990.0, None, group="", component="", robot="")], 7_100.0)

    assert counted is not None
    assert counted.notifications == 1


def test_the_week_is_counted_from_the_log_with_what_began_before_it_unless_there_is_too_much():
    labels = {"scope": "component", "state": "critical", "severity": "critical", **MOTOR}
    of = labels | {"since": END - WEEK - 60}
    began = {"id": 1, "time": END - WEEK - 50, "kind": "fault_began", **of}
    log = [began, {"id": 2, "time": END - 9, "kind": "fault_ended", "reason": "recovered", **of}]

    def find(*, kind: str, since: float, limit: int) -> list[dict[str, Any]]:
        assert since == END - 3 * WEEK
        found = [each for each in log if each["kind"] == kind and each["time"] >= since]
        return (found * times)[:limit]

    times = 1
    counted = report.Counting(find).count([], END)
    assert counted is not None
    assert counted.to_recover == (1, WEEK + 51, WEEK + 51)
    times = 20_000
    assert report.Counting(find).count([], END) is None
