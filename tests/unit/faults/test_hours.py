"""Faults of severity warning begin in the hours that the config says; others at any time."""

from dataclasses import replace

import pytest

from ros_diagnostics_exporter.config.fleet import FaultSettings, WarningHours
from ros_diagnostics_exporter.faults.model import Reason
from support.fault_histories import (
    ERROR,
    OK,
    STALE,
    WALL,
    WARN,
    level,
    levels,
    play,
    robot_settings,
    silent,
    value,
)

# Second 0 is Monday 13:46:40: they begin at 14:00, second 800, and end at 15:00, second 4400.
HOURS = WarningHours(((0, 14 * 60, 15 * 60),), "UTC")
SETTINGS = FaultSettings(warning_hours=HOURS)
BEGIN, END = 800, 4400


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
        (robot_settings("r2"), "robot/pending r2"),
    ],
)
def test_stale_values_many_and_pending_robots_wait_for_the_hours(event, expected):
    settings = replace(SETTINGS, pending_after=60.0)
    play((0, event), (BEGIN - 1, None), (BEGIN, None, f"began {expected}"), settings=settings)


def test_outside_of_the_hours_flapping_hides_nothing_critical():
    """It is one fault, until the component comes to rest."""
    short = [(20 * n + 5 * (to is OK), level("motor", to)) for n in range(8) for to in (ERROR, OK)]
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


def test_a_wall_clock_that_is_set_moves_the_hours():
    last = play((0, level("motor", WARN)), settings=SETTINGS)
    night = last.faults.advance(last.at(100))
    assert night == []
    (began,) = last.faults.advance(last.at(101)._replace(wall=WALL + BEGIN + 101))
    assert (began.what, began.at) == ("began", WALL + BEGIN + 101)


def test_why_it_is_suppressed():
    last = play((0, level("motor", WARN)), settings=SETTINGS)
    (problem,) = last.faults.problems(last.at(20))
    assert problem.suppressed is Reason.HOURS
    assert problem.fault is None
