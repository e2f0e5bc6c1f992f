"""Planned downtimes: which robots and when, across midnight and clock changes."""

from datetime import datetime
from zoneinfo import ZoneInfo

import pytest

from ros_diagnostics_exporter.model import Downtime
from ros_diagnostics_exporter.robots.maintenance import lasting, maintenance_until

BERLIN = ZoneInfo("Europe/Berlin")


def unix(text, zone=BERLIN, fold=0):
    return datetime.fromisoformat(text).replace(tzinfo=zone, fold=fold).timestamp()


@pytest.fixture
def during(fleet_of):
    """Whether a robot is in maintenance at a time, by one entry's times."""

    def active(times, at, **labels):
        fleet = fleet_of(f"""
            fleet: demo
            maintenance:
              - {{name: x, comment: y, selector: {{robot: "*"}}, {times}}}
        """)
        return bool(lasting(fleet, {"robot": "r", "fleet": "demo", **labels}, at))

    return active


@pytest.mark.parametrize(
    ("at", "active"),
    [
        ("2026-03-02T21:59:59", False),
        ("2026-03-02T22:00", True),
        ("2026-03-03T05:59:59", True),
        ("2026-03-03T06:00", False),
    ],
)
@pytest.mark.parametrize(
    "times",
    [
        "start: 2026-03-02T22:00, end: 2026-03-03T06:00, time_zone: Europe/Berlin",
        "start: 2026-03-02T21:00Z, end: 2026-03-03T00:00:00-05:00",
        "start: 2026-03-02 21:00, end: 2026-03-03 05:00",
        "weekly: [Mon 22:00-06:00], time_zone: Europe/Berlin",
        "weekly: [daily 22:00-06:00], start: 2026-03-02, end: 2026-03-04, time_zone: Europe/Berlin",
    ],
)
def test_downtime_is_active_from_its_start_to_just_before_its_end(during, times, at, active):
    assert during(times, unix(at)) is active


def test_downtime_may_have_no_start_or_no_end(during):
    assert during("start: 2026-01-01", unix("2036-01-02T00:00"))
    assert not during("start: 2026-01-01", unix("2025-12-31T00:00"))
    assert during("end: 2026-01-01", unix("1999-01-01T00:00"))


@pytest.mark.parametrize(
    ("weekly", "at", "active"),
    [
        ("Mon-Fri 22:00-06:00", "2026-03-07T05:00", True),  # Saturday morning, Friday's window
        ("Mon-Fri 22:00-06:00", "2026-03-07T23:00", False),
        ("Sat-Mon 08:00-09:00", "2026-03-09T08:30", True),
        ("Sat-Mon 08:00-09:00", "2026-03-10T08:30", False),
        ("Sun 22:00-02:00", "2026-03-09T01:00", True),  # from Sunday into Monday
        ("Tue,Thu-Fri 00:00-24:00", "2026-03-05T23:59:59", True),
        ("Tue,Thu-Fri 00:00-24:00", "2026-03-04T00:00", False),
        ("Mon 12:00-11:59", "2026-03-10T11:58", True),
        ("daily 12:30-13:00", "2026-03-04T12:29", False),
    ],
)
def test_weekly_times_follow_the_local_week(during, weekly, at, active):
    times = f"weekly: ['{weekly}'], time_zone: Europe/Berlin"
    assert during(times, unix(at)) is active


def test_window_over_a_change_of_the_clock_ends_by_the_local_clock(during):
    # On 29 March 2026 the clock goes from 02:00 to 03:00; on 25 October from 03:00 to 02:00.
    times = "weekly: [Sat 22:00-06:00], time_zone: Europe/Berlin"
    assert during(times, unix("2026-03-28T22:00") + 7 * 3600 - 1)
    assert not during(times, unix("2026-03-28T22:00") + 7 * 3600)
    assert during(times, unix("2026-10-24T22:00") + 9 * 3600 - 1)
    assert not during(times, unix("2026-10-24T22:00") + 9 * 3600)


def test_time_that_is_skipped_is_as_long_after_the_change_and_of_two_it_is_the_first(during):
    times = "weekly: [Sun 02:30-02:45], time_zone: Europe/Berlin"
    assert during(times, unix("2026-03-29T03:40"))
    assert not during(times, unix("2026-03-29T03:20"))
    assert during(times, unix("2026-10-25T02:40"))
    assert not during(times, unix("2026-10-25T02:40", fold=1))


@pytest.mark.parametrize(
    ("selector", "selected"),
    [
        ("{robot: amr_1}", True),
        ("{robot: amr_10}", False),
        ("{robot: 'amr_*'}", True),
        ("{robot: [arm_1, amr_1]}", True),
        ("{robot: {regex: 'amr_[0-9]'}}", True),
        ("{robot: {regex: 'amr'}}", False),
        ("{fleet: demo, site: hall}", True),
        ("{fleet: demo, site: yard}", False),
        ("{site: Hall}", False),
        ("{floor: 3}", True),
        ("{team: '*'}", True),
        ("{team: night}", False),
    ],
)
def test_selector_picks_robots_by_all_of_its_labels(fleet_of, selector, selected):
    fleet = fleet_of(f"""
        fleet: demo
        maintenance:
          - {{name: x, comment: y, start: 2026-01-01, selector: {selector}}}
    """)
    labels = {"robot": "amr_1", "fleet": "demo", "site": "hall", "floor": "3"}
    assert bool(lasting(fleet, labels, unix("2026-03-01T00:00"))) is selected


@pytest.mark.parametrize(
    ("times", "at", "end"),
    [
        ("end: 2026-03-02T12:00:00+01:00", "2026-03-01T00:00", "2026-03-02T12:00"),
        ("weekly: [Mon 22:00-06:00]", "2026-03-02T23:00", "2026-03-03T06:00"),
        ("weekly: ['Mon 22:00-24:00', 'Tue 00:00-06:00']", "2026-03-02T23:00", "2026-03-03T06:00"),
        ("weekly: [Sat 22:00-06:00]", "2026-03-29T01:00", "2026-03-29T06:00"),  # 5 h: summer time
        (
            "weekly: [Mon 22:00-06:00], end: 2026-03-03T01:00:00+01:00",
            "2026-03-02T23:00",
            "2026-03-03T01:00",
        ),
    ],
)
def test_the_end_of_a_downtime(fleet_of, times, at, end):
    zone = ", time_zone: Europe/Berlin" if "weekly" in times else ""
    fleet = fleet_of(f"""
        fleet: demo
        maintenance:
          - {{name: x, comment: y, selector: {{robot: "*"}}, {times}{zone}}}
    """)
    labels = {"robot": "r", "fleet": "demo"}
    assert maintenance_until(fleet, labels, unix(at)) == unix(end)
    assert not lasting(fleet, labels, unix(end))


def test_a_downtime_that_a_person_planned_for_a_component_is_none_of_the_robot(fleet_of):
    fleet, labels = fleet_of("fleet: demo"), {"robot": "r", "fleet": "demo"}
    robot = Downtime("r", "", 0.0, 60.0, "ann", "new gears")
    motor = robot._replace(component="Motor", end=90.0)

    assert not lasting(fleet, labels, 30.0, (motor,))
    assert maintenance_until(fleet, labels, 30.0, (motor,)) == 30.0
    assert maintenance_until(fleet, labels, 30.0, (robot, motor)) == 60.0
