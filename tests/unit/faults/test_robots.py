"""Faults of robots: silent, pending, coming and going; and restarts of the exporter."""

import pytest

from ros_diagnostics_exporter.config.fleet import FaultSettings, Flapping
from support.fault_histories import (
    ERROR,
    OK,
    STALE,
    WALL,
    back,
    check,
    forget,
    level,
    maintenance,
    play,
    player,
    restart,
    robot_settings,
    silent,
    texts,
)

CRITICAL = "component/critical r1 motor"
SILENT = "robot/silent r1"


def test_a_silent_robot_is_one_fault_dated_from_its_last_message():
    last = play((20, silent(last=10)), (29, None), (30, None, f"began {SILENT}"))

    assert [each.since - WALL for each in last.faults.faults()] == [10]
    assert [each.what for each in last.go(60, back())] == ["recovered"]


def test_a_robot_that_was_never_received_is_pending_and_not_silent():
    play(
        (0, robot_settings("new")),
        (899, None),
        (900, None, "began robot/pending new"),
        (950, back("new"), "recovered robot/pending new"),
    )


def test_a_person_takes_a_robot_out():
    play(
        (0, level("motor", ERROR)),
        (0, check(1, 2)),
        (10, None, "began check/critical r1 motors", f"began {CRITICAL}"),
        (20, silent()),
        (30, None, f"began {SILENT}"),
        (
            40,
            forget(),
            f"removed {CRITICAL}",
            "removed check/critical r1 motors",
            f"removed {SILENT}",
        ),
        (10_000, None),
    )


_OUTAGES = [
    scene
    for minute in range(1, 4)
    for scene in ((60 * minute, silent()), (60 * minute + 8, back()))
]


def test_a_robot_that_comes_and_goes_is_flapping_once():
    play(
        *_OUTAGES,
        (240, silent()),
        (248, back()),
        (250, None, "began robot/flapping r1"),
        (300, silent()),
        (320, None),
        (330, back("r1", level("motor", ERROR), level("camera", STALE))),
        (340, None, f"began {CRITICAL}"),
        (1500, None, "began component/stale r1 camera", "recovered robot/flapping r1"),
    )


@pytest.mark.parametrize("events", [[None], [restart()]], ids=["", "and the exporter restarts"])
def test_a_flapping_robot_that_stays_away_is_silent_and_goes_on_to_flap_until_it_is_back(events):
    play(
        *_OUTAGES,
        (240, silent()),
        (250, None, "began robot/flapping r1"),
        *((255, event) for event in events),
        (539, None),
        (540, None, f"began {SILENT}"),  # five intervals of a minute: 1 / stop
        (2000, None),
        (2001, back(), "recovered robot/flapping r1", f"recovered {SILENT}"),
    )


def test_a_flapping_robot_that_stays_away_is_silent_at_the_latest_when_no_change_is_left():
    settings = FaultSettings(flapping=Flapping(0.4, 0.01))
    play(
        *_OUTAGES,
        (240, silent()),
        (250, None, "began robot/flapping r1"),
        (1439, None),
        (1440, None, f"began {SILENT}"),
        settings=settings,
    )


def test_the_return_after_a_long_silence_is_a_change_too():
    last = play(
        (0, silent()),
        (10, None, f"began {SILENT}"),
        (9_990, back(), f"recovered {SILENT}"),
        *((10_000 + second, event) for second, event in _OUTAGES[:-1]),
    )
    assert texts(last.go(10_188, back())) == []
    assert texts(last.go(10_198)) == ["began robot/flapping r1"]


# -- restarts ----------------------------------------------------------------------------------


def test_a_restart_in_a_fault_ends_nothing_and_begins_nothing():
    play(
        (0, level("motor", ERROR)),
        (10, None, f"began {CRITICAL}"),
        (20, restart()),
        (25, back("r1", level("motor", STALE))),
        (30, level("motor", ERROR)),
        (70, level("motor", OK), f"recovered {CRITICAL}"),
    )


def test_a_restarted_exporter_has_restart_grace_to_receive_its_robots():
    play(
        (0, silent("off")),
        (10, None, "began robot/silent off"),
        (20, restart()),
        (45, back("late")),
        (49, None),
        (50, None, "began robot/silent gone"),
        robots=["off", "late", "gone"],
    )


def test_restarts_are_no_coming_and_going_of_robots():
    steps = ((60 * n, restart(), back()) for n in range(1, 12))
    play(
        *((second + late, event) for second, *events in steps for late, event in enumerate(events))
    )


def test_what_is_absent_after_a_return_waits_for_the_robots_time_over_a_restart_too():
    play(
        (0, silent()),
        (10, None, f"began {SILENT}"),
        (20, back("r1", level("motor", STALE, confirm_after=3)), f"recovered {SILENT}"),
        (25, check(2, 2)),
        (29, None),
        (30, None, "began component/stale r1 motor"),
    )


def test_a_wall_clock_that_was_set_back_over_a_restart_keeps_nothing_from_coming_to_rest():
    last = player(["r1"], FaultSettings())
    for second in range(14):
        last.go(second, level("motor", OK if second % 2 else ERROR))
    assert [each.identity.state for each in last.faults.faults()] == ["flapping"]
    last.reborn(15, set_back=9_000)
    assert texts(last.go(-8_000)) == ["recovered flapping/flapping r1 motor"]


def test_a_second_restart_is_settled_as_the_first_would_have_been():
    last = player(["r1"], FaultSettings())
    last.reborn(50)
    last.faults.started(last.at(50), 60.0)
    last.reborn(60)
    last.faults.started(last.at(60), 60.0)
    assert [last.faults.settled(last.at(second)) for second in (89, 90)] == [False, True]


def test_silence_is_dated_from_the_earlier_of_two_last_messages_until_it_is_confirmed():
    last = play(
        (0, silent(last=-3)),
        (1, silent(last=-5)),
        (2, silent(last=-4)),
        (10, None, f"began {SILENT}"),
        (11, silent(last=-8)),
    )
    assert [each.since - WALL for each in last.faults.faults()] == [-5]
    assert [each.since - WALL for each in last.faults.problems(last.at(11))] == [-5]


def test_a_confirmed_fault_is_dated_long_enough_before_a_wall_clock_that_was_set_back():
    last = player(["r1"], FaultSettings())
    last.go(0, level("motor", ERROR))
    last.go(15)
    last.reborn(20, set_back=30)
    (problem,) = last.faults.problems(last.at(last.second))
    assert (problem.since - WALL, problem.due - WALL) == (-20, -10)


def test_a_wall_clock_that_was_set_back_over_a_restart_confirms_nothing_earlier():
    last = player(["r1"], FaultSettings())
    last.go(20, level("camera", ERROR))
    last.go(35, level("motor", ERROR))
    last.reborn(40, set_back=30)
    assert [each.since - WALL for each in last.faults.faults()] == [20]
    assert texts(last.go(19)) == []
    assert texts(last.go(20)) == [f"began {CRITICAL}"]
    assert [each.since - WALL for each in last.faults.faults()] == [20, 10]


def test_settled_once_restart_grace_is_over():
    last = player(["r1"], FaultSettings())
    last.go(0, restart())

    assert not last.faults.settled(last.at(29))
    assert last.faults.settled(last.at(30))


def test_both_halves_of_a_pair_give_the_same_identity_and_labels():
    halves = [player(["r1"], FaultSettings()) for _ in range(2)]
    settings = robot_settings(site="hall")
    halves[0].go(0, settings, level("motor", ERROR))
    halves[1].go(3, settings, level("motor", ERROR))  # it was deaf for a moment
    halves[1].go(4, restart(), back("r1", level("motor", ERROR)))

    for half in halves:
        half.go(20)
    first, second = [[(f.identity, f.labels) for f in half.faults.faults()] for half in halves]
    assert len(first) == 1
    assert first == second


def test_a_check_that_finds_too_few_components_is_a_fault_until_it_finds_them():
    play(
        (0, check(1, 2)),
        (10, None, "began check/critical r1 motors"),
        (20, silent()),
        (30, None, f"began {SILENT}"),
        (40, back("r1", check(1, 2)), f"recovered {SILENT}"),
        (60, check(2, 2), "recovered check/critical r1 motors"),
    )


def test_what_was_well_in_a_window_and_is_silent_at_its_end_ends_when_it_is_received():
    play(
        (0, level("motor", ERROR)),
        (10, None, f"began {CRITICAL}"),
        (20, maintenance(planned=True)),
        (30, level("motor", OK)),
        (40, silent()),
        (80, maintenance(planned=False), f"began {SILENT}"),
        (90, back("r1", level("motor", OK)), f"recovered {SILENT}", f"recovered {CRITICAL}"),
    )
