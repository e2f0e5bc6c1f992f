"""Faults of severity warning begin in the hours that the config says; others at any time."""

from dataclasses import replace

import pytest

from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    FaultSettings,
    Flapping,
    WarningHours,
)
from ros_diagnostics_exporter.faults.model import Reason
from ros_diagnostics_exporter.model import Instant
from support.fault_histories import (
    ERROR,
    OK,
    STALE,
    WALL,
    WARN,
    FleetChange,
    back,
    instant,
    level,
    levels,
    maintenance,
    play,
    restart,
    robot_settings,
    silent,
    value,
)

# Second 0 is Monday 13:46:40: they begin at 14:00, second 800, and end at 15:00, second 4400.
HOURS = WarningHours(((0, 14 * 60, 15 * 60),), "UTC")
SETTINGS = FaultSettings(warning_hours=HOURS)
BEGIN, END = 800, 4400
WEEK = 7 * 86_400


def test_a_warning_begins_when_the_hours_do_if_it_still_exists():
    last = play(
        (0, level("motor", WARN)),
        (0, level("arm", WARN)),
        (500, level("arm", OK)),
        (BEGIN - 1, None),
        (BEGIN, None, "began component/warning r1 motor"),
        settings=SETTINGS,
    )
    (fault,) = last.faults.faults()
    assert (fault.since, fault.confirmed) == (WALL, WALL + BEGIN)


def test_in_the_hours_a_warning_begins_after_confirm_after():
    play(
        (BEGIN - 5, level("motor", WARN)),
        (BEGIN, None),
        (BEGIN + 5, None, "began component/warning r1 motor"),
        (END - 5, level("arm", WARN)),
        (END + 10, None),
        settings=SETTINGS,
    )


def test_a_fault_lasts_and_ends_at_any_time():
    play(
        (BEGIN, level("motor", WARN)),
        (BEGIN + 10, None, "began component/warning r1 motor"),
        (END + 100, None),
        (END + 200, level("motor", OK), "recovered component/warning r1 motor"),
        settings=SETTINGS,
    )


def test_a_warning_that_gets_worse_is_critical_at_once_and_one_that_gets_better_waits():
    play(
        (0, level("motor", WARN)),
        (100, level("motor", ERROR), "began component/critical r1 motor"),
        (200, level("motor", WARN), "recovered component/critical r1 motor"),
        (BEGIN, None, "began component/warning r1 motor"),
        settings=SETTINGS,
    )


def test_what_is_critical_or_silent_begins_at_once():
    play(
        (0, level("motor", ERROR)),
        (0, value(5.0)),
        (
            10,
            None,
            "began component/critical r1 motor",
            "began value/critical r1 battery charge low",
        ),
        (20, silent()),
        (30, None, "began robot/silent r1"),
        (BEGIN, None),  # the battery's warning waits for its robot
        settings=SETTINGS,
    )


@pytest.mark.parametrize(
    ("event", "expected"),
    [
        (level("motor", STALE), "component/stale r1 motor"),
        (value(15.0), "value/warning r1 battery charge low"),
        (levels("abcdefghijkl", WARN), "robot/many r1 warning"),
    ],
)
def test_stale_values_and_many_wait_for_the_hours(event, expected):
    play((0, event), (BEGIN - 1, None), (BEGIN, None, f"began {expected}"), settings=SETTINGS)


def test_a_pending_robot_waits_for_the_hours():
    settings = replace(SETTINGS, pending_after=60.0)
    play(
        (0, robot_settings("r2")),
        (60, None),
        (BEGIN, None, "began robot/pending r2"),
        settings=settings,
    )


def test_many_that_are_critical_begin_at_once_and_are_milder_in_the_hours():
    play(
        (0, levels("abcdefghijkl", WARN)),
        (50, level("a", ERROR), "began robot/many r1 critical"),
        (100, level("a", WARN), "recovered robot/many r1 critical"),
        (BEGIN, None, "began robot/many r1 warning"),
        settings=replace(SETTINGS, many=CauseSettings(5, 0.3)),
    )


def test_outside_of_the_hours_flapping_hides_nothing_critical():
    """It is one fault, until the component comes to rest; in the hours it would be flapping."""
    short = [
        step
        for each in range(8)
        for step in ((20 * each, level("motor", ERROR)), (20 * each + 5, level("motor", OK)))
    ]
    play(
        *short,
        (200, level("motor", ERROR)),
        (210, None, "began component/critical r1 motor"),
        (220, level("motor", OK)),
        (240, level("motor", ERROR)),
        (260, level("motor", OK)),
        (440, None, "recovered component/critical r1 motor"),
        (BEGIN, None),
        settings=SETTINGS,
    )
    play(
        *[(BEGIN + second, *event) for second, *event in short[:7]],
        (BEGIN + 65, short[7][1], "began flapping/flapping r1 motor"),
        (BEGIN + 200, level("motor", ERROR)),
        (BEGIN + 220, None),
        settings=SETTINGS,
    )


def test_a_robot_that_comes_and_goes_at_night_and_stays_away_is_silent():
    coming = [
        step for each in range(8) for step in ((20 * each, silent()), (20 * each + 5, back()))
    ]
    play(
        *coming,
        (200, silent()),
        (210, None, "began robot/silent r1"),
        (300, back()),
        (BEGIN, None, "began robot/flapping r1"),
        settings=replace(SETTINGS, flapping=Flapping(stop=0.01)),
    )


def test_maintenance_that_ends_outside_of_the_hours_leaves_warnings_to_them():
    play(
        (0, maintenance(planned=True)),
        (10, level("motor", WARN)),
        (10, level("arm", ERROR)),
        (100, maintenance(planned=False), "began component/critical r1 arm"),
        (BEGIN, None, "began component/warning r1 motor"),
        settings=SETTINGS,
    )


def test_a_restart_at_night_and_one_in_the_hours():
    play(
        (0, level("motor", WARN)),
        (100, restart()),
        (101, back("r1", level("motor", WARN))),
        (BEGIN, None, "began component/warning r1 motor"),
        (BEGIN + WEEK - 900, restart()),
        (BEGIN + WEEK - 890, back("r1", level("motor", WARN), level("arm", WARN))),
        (BEGIN + WEEK - 1, None),
        (BEGIN + WEEK, None, "began component/warning r1 arm"),
        settings=SETTINGS,
    )


def test_other_hours_hold_at_once():
    play(
        (0, level("motor", WARN)),
        (100, FleetChange(FaultSettings()), "began component/warning r1 motor"),
        (200, FleetChange(SETTINGS)),
        (200, level("arm", WARN)),
        (BEGIN, None, "began component/warning r1 arm"),
        settings=SETTINGS,
    )


def test_a_wall_clock_that_is_set_moves_the_hours():
    last = play((0, level("motor", WARN)), settings=SETTINGS)
    night = last.faults.advance(Instant(100.0, WALL + 100))
    assert night == []
    (began,) = last.faults.advance(Instant(101.0, WALL + BEGIN + 101))
    assert (began.what, began.at) == ("began", WALL + BEGIN + 101)


def test_why_it_is_quiet():
    last = play((0, level("motor", WARN)), settings=SETTINGS)
    (problem,) = last.faults.problems(instant(20))
    assert problem.quiet is Reason.HOURS
    assert problem.fault is None
