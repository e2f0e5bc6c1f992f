"""Maintenance is suppressed for faults of every kind; what is still wrong after it begins then."""

import pytest

from support.fault_histories import (
    ERROR,
    OK,
    STALE,
    back,
    check,
    level,
    levels,
    maintenance,
    on_robots,
    play,
    robot_settings,
    silent,
    together,
    value,
)

SIX = tuple(f"r{number}" for number in range(1, 7))
PARTS = "abcdefghijkl"


def play_in_hall(*steps):
    """All six are of one site."""
    of_site = (0, together(*(robot_settings(robot, site="hall") for robot in SIX)))
    play(of_site, *steps, robots=SIX)


# What goes wrong, how it is well again, and the fault where it outlives the window.
KINDS = {
    "component": (level("motor", ERROR), level("motor", OK), ["component/critical r1 motor"]),
    "stale": (level("motor", STALE), level("motor", OK), ["component/stale r1 motor"]),
    "value": (value(15.0), value(50.0), ["value/warning r1 battery charge low"]),
    "check": (check(1, 2), check(2, 2), ["check/critical r1 motors"]),
    "many": (levels(PARTS, ERROR), levels(PARTS, OK), ["robot/many r1 critical"]),
    "common": (
        on_robots(SIX, lambda robot: level("motor", ERROR, robot)),
        on_robots(SIX, lambda robot: level("motor", OK, robot)),
        ["common/critical motor"],
    ),
    "outage": (on_robots(SIX, silent), on_robots(SIX, back), ["site/silent hall"]),
    "silent": (silent(), back(), ["robot/silent r1"]),
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_goes_wrong_and_is_well_again_in_the_window_is_no_fault(kind):
    wrong, well, _ = KINDS[kind]
    play_in_hall(
        (0, maintenance(*SIX, planned=True)),
        (10, wrong),
        (500, well),
        (600, maintenance(*SIX, planned=False)),
        (2000, None),
    )


@pytest.mark.parametrize("kind", KINDS)
def test_what_goes_wrong_in_the_window_and_outlives_it_is_a_fault_after_it(kind):
    wrong, well, faults = KINDS[kind]
    began = [f"began {each}" for each in faults]
    is_larger_cause = kind in ("many", "common", "outage")  # counted only from the end on
    play_in_hall(
        (0, maintenance(*SIX, planned=True)),
        (10, wrong),
        (600, maintenance(*SIX, planned=False), *([] if is_larger_cause else began)),
        (630, None, *(began if is_larger_cause else [])),
        (700, well, *[f"recovered {each}" for each in faults]),
    )


@pytest.mark.parametrize("kind", KINDS)
def test_a_window_that_begins_in_a_fault_and_ends_in_it_changes_nothing(kind):
    wrong, well, faults = KINDS[kind]
    play_in_hall(
        (0, wrong),
        (30, None, *[f"began {each}" for each in faults]),
        (100, maintenance(*SIX, planned=True)),
        (600, maintenance(*SIX, planned=False)),
        (700, well, *[f"recovered {each}" for each in faults]),
    )


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_well_within_the_window_ends_with_it(kind):
    """A larger cause ends at once, because from then on it explains nothing any more."""
    wrong, well, faults = KINDS[kind]
    ended = [f"recovered {each}" for each in faults]
    of_many_robots = kind in ("common", "outage")
    play_in_hall(
        (0, wrong),
        (30, None, *[f"began {each}" for each in faults]),
        (100, maintenance(*SIX, planned=True)),
        (300, well, *(ended if of_many_robots else [])),
        (600, maintenance(*SIX, planned=False), *([] if of_many_robots else ended)),
    )


@pytest.mark.parametrize(
    "events",
    [(level("motor", ERROR), level("motor", OK)), (silent(), back())],
    ids=["component", "robot"],
)
def test_nothing_is_flapping_because_of_what_changed_in_the_window(events):
    play(
        (0, maintenance(planned=True)),
        *[(10 + 4 * turn, events[turn % 2]) for turn in range(20)],
        (100, maintenance(planned=False)),
        (101, together(*events)),
        (2000, None),
    )
