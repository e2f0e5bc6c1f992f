"""Components that change too often."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ros_diagnostics_exporter.config.fleet import FaultSettings
from ros_diagnostics_exporter.faults.engine import Faults
from ros_diagnostics_exporter.faults.model import RobotSettings
from ros_diagnostics_exporter.faults.records import SLOTS, FlapHistory, flap_ratio
from ros_diagnostics_exporter.model import Instant
from support.fault_histories import (
    ERROR,
    OK,
    STALE,
    WALL,
    WARN,
    back,
    forget,
    level,
    maintenance,
    moved,
    play,
    silent,
    words,
)

FLAPPING = "flapping/flapping r1 motor"
CRITICAL = "component/critical r1 motor"


def changes(first: int, count: int, period: int = 2):
    """The motor is now OK, now in ERROR, OK at last."""
    levels = ([ERROR, OK] * count)[-count:]
    return [(first + period * turn, level("motor", each)) for turn, each in enumerate(levels)]


def test_one_that_changes_often_is_flapping_once_and_nothing_else():
    play(
        *changes(2, 6),
        (14, level("motor", ERROR), f"began {FLAPPING}"),
        (16, level("motor", OK)),
        (18, level("motor", ERROR)),
        (100, None),
        (101, level("motor", OK)),
        (400, None, f"recovered {FLAPPING}"),
    )


def test_one_that_comes_to_rest_in_error_is_critical_then():
    play(
        *changes(2, 6),
        (14, level("motor", ERROR), f"began {FLAPPING}"),
        (400, None, f"began {CRITICAL}", f"recovered {FLAPPING}"),
    )


def test_a_fault_from_before_goes_on_and_ends_with_the_flapping_if_it_is_well_then():
    play(
        (-20, level("motor", ERROR)),
        (-10, None, f"began {CRITICAL}"),
        (0, level("motor", OK), f"recovered {CRITICAL}"),
        (1, level("motor", ERROR)),
        (11, None, f"began {CRITICAL}"),
        (12, level("motor", OK), f"recovered {CRITICAL}"),
        (13, level("motor", WARN)),
        (23, None, "began component/warning r1 motor"),
        (24, level("motor", ERROR), f"began {CRITICAL}"),
        (25, level("motor", WARN), f"began {FLAPPING}"),
        (30, level("motor", OK)),
        (
            400,
            None,
            f"recovered {CRITICAL}",
            "recovered component/warning r1 motor",
            f"recovered {FLAPPING}",
        ),
    )


def test_what_changed_in_maintenance_is_not_flapping_after_it():
    play(
        (0, maintenance(planned=True)),
        *changes(2, 20),
        *[(50 + 2 * turn, (silent(), back())[turn % 2]) for turn in range(20)],
        (90, maintenance(planned=False)),
        (1000, None),
    )


def test_below_the_ratio_each_fault_is_reported():
    scenes = []
    for turn in range(10):
        begin = 200 * turn
        scenes += [
            (begin, level("motor", ERROR)),
            (begin + 10, None, f"began {CRITICAL}"),
            (begin + 20, level("motor", OK), f"recovered {CRITICAL}"),
        ]
    play(*scenes)


def test_silence_is_no_rest():
    play(
        *changes(2, 6),
        (14, level("motor", ERROR), f"began {FLAPPING}"),
        (20, silent()),
        (30, None, "began robot/silent r1"),
        (3000, back("r1", level("motor", OK)), "recovered robot/silent r1"),
        (3020, None),
        (3400, None, f"recovered {FLAPPING}"),
    )


def test_a_robot_that_comes_and_goes_makes_no_component_flap():
    scenes = []
    for turn in range(12):
        scenes += [
            (100 * turn, silent()),
            (100 * turn + 5, back("r1", level("motor", STALE), level("arm", OK))),
            (100 * turn + 6, level("motor", OK)),
        ]
        if turn == 3:
            scenes[-2] += ("began robot/flapping r1",)
    play(*scenes)


def test_a_component_that_moves_to_another_group_goes_on_to_flap():
    play(
        *changes(2, 6),
        (13, moved("motor", "", "/b")),
        (14, level("motor", ERROR, group="/b"), "began flapping/flapping r1 /b motor"),
        (16, level("motor", OK, group="/b")),
        (400, None, "recovered flapping/flapping r1 /b motor"),
    )


def test_a_person_takes_a_flapping_component_out():
    play(
        *changes(2, 6),
        (14, level("motor", ERROR), f"began {FLAPPING}"),
        (20, forget("r1", "motor"), f"removed {FLAPPING}"),
        (1000, None),
    )


# -- the formula -------------------------------------------------------------------------------


def test_the_newest_change_weighs_most():
    assert flap_ratio([0] * SLOTS) == 0.0
    assert flap_ratio([0, 1] * 10 + [0]) == pytest.approx(1.0)
    assert flap_ratio([1] + [0] * 20) == pytest.approx(0.75 / 20)
    assert flap_ratio([0] * 20 + [1]) == pytest.approx(1.25 / 20)


def test_time_without_a_change_is_recorded_once_an_interval():
    history = FlapHistory([0] * SLOTS, 0.0)
    history.change(1, 10.0, 15.0)
    history.decay(54.9, 15.0)

    assert [*history.slots] == [0] * 18 + [1] * 3
    assert history.last == 40.0


@given(st.floats(0, 2e9), st.floats(0.001, 1e6))
@example(100 * 86_400 + 0.3, 0.7)
@example(400 * 86_400 + 0.3, 2.3)
def test_a_timer_after_one_interval_always_records(uptime, interval):
    history = FlapHistory([0] * SLOTS, 0.0)
    history.change(1, uptime, interval)
    for _ in range(SLOTS):
        due = history.last + interval
        history.decay(due, interval)
        assert history.last + interval > due

    assert history.ratio == 0.0


@given(st.floats(0, 2e9), st.floats(0.001, 1e5), st.booleans())
@example(100 * 86_400 + 0.3, 0.7, False)
@example(400 * 86_400 + 0.3, 2.3, True)
def test_the_engine_comes_to_rest_whatever_the_uptime_and_the_interval(uptime, interval, robot):
    def at(mono):
        return Instant(mono, WALL + mono)

    faults = Faults(FaultSettings())
    settings = RobotSettings({}, 10.0, flap_interval=interval, presence_interval=interval)
    faults.configure_robot("r1", settings, at(uptime), declared=True)
    for turn in range(6):
        now = at(uptime + turn * interval / 100)
        if robot:
            faults.robot_silent("r1", now, now)
        back("r1", level("motor", ERROR), level("motor", OK))(faults, now)
    faults.advance(at(uptime + 30 * interval))

    assert [words(each.identity) for each in faults.faults()] == []
    assert not faults.in_trouble("r1")
