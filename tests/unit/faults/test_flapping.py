"""Components that change too often."""

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ros_diagnostics_exporter.faults.records import SLOTS, FlapHistory, flap_ratio
from support.fault_histories import ERROR, OK, level, moved, play

FLAPPING = "flapping/flapping r1 motor"


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


def test_the_end_of_trouble_that_lasted_long_counts_as_a_change():
    play(
        (0, level("motor", ERROR)),
        (10, None, "began component/critical r1 motor"),
        (5000, level("motor", OK), "recovered component/critical r1 motor"),
        *((5000 + 2 * turn, level("motor", ERROR if turn % 2 else OK)) for turn in range(1, 6)),
        (5012, level("motor", OK), f"began {FLAPPING}"),
    )


def test_a_component_that_moves_to_another_group_goes_on_to_flap():
    play(
        *changes(2, 6),
        (13, moved("motor", "", "/b")),
        (14, level("motor", ERROR, group="/b"), "began flapping/flapping r1 /b motor"),
        (16, level("motor", OK, group="/b")),
        (400, None, "recovered flapping/flapping r1 /b motor"),
    )


def test_the_newest_change_weighs_most():
    assert flap_ratio(bytes(SLOTS)) == 0.0
    assert flap_ratio(bytes([0, 1] * 10 + [0])) == pytest.approx(1.0)
    assert flap_ratio(bytes([1] + [0] * 20)) == pytest.approx(0.75 / 20)
    assert flap_ratio(bytes([0] * 20 + [1])) == pytest.approx(1.25 / 20)


@given(st.floats(0, 2e9), st.floats(0.001, 1e6))
@example(100 * 86_400 + 0.3, 0.7)
@example(400 * 86_400 + 0.3, 2.3)
def test_a_timer_after_one_interval_always_records(uptime, interval):
    history = FlapHistory([0] * SLOTS, 0.0)
    history.change(1, uptime, interval)
    for recorded in range(2, SLOTS + 1):
        due = history.last + interval
        history.decay(due, interval)
        assert history.last + interval > due
        assert history.slots.count(1) == recorded

    assert history.ratio == 0.0


def test_the_times_of_as_many_changes_are_kept_as_there_are_between_the_states():
    history = FlapHistory([0] * SLOTS, 0.0)
    for second in range(1, 31):
        history.change(second % 2, float(second), 60.0)
    assert history.changed == tuple(map(float, range(11, 31)))
