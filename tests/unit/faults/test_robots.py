"""Faults of robots: silent, pending, coming and going; and restarts of the exporter."""

from ros_diagnostics_exporter.config.fleet import FaultSettings
from support.fault_histories import (
    ERROR,
    OK,
    STALE,
    WALL,
    back,
    check,
    forget,
    instant,
    level,
    maintenance,
    never,
    play,
    player,
    restart,
    robot_settings,
    silent,
    together,
)


def test_a_silent_robot_is_one_fault_dated_from_its_last_message():
    last = play((20, silent(last=10)), (29, None), (30, None, "began robot/silent r1"))

    assert [each.since - WALL for each in last.faults.faults()] == [10]
    assert [each.what for each in last.go(60, back())] == ["recovered"]


def test_a_robot_that_was_never_received_is_pending_and_not_silent():
    play(
        (0, robot_settings("new")),
        (899, None),
        (900, None, "began robot/pending new"),
        (950, back("new"), "recovered robot/pending new"),
    )


def test_a_pending_robot_whose_publisher_is_mute_is_silent_until_the_publisher_goes():
    play(
        (0, robot_settings("new")),
        (100, silent("new")),
        (105, never("new")),
        (110, None),
        (200, silent("new")),
        (210, None, "began robot/silent new"),
        (220, never("new")),
        (900, None, "began robot/pending new"),
        (910, back("new"), "recovered robot/pending new", "recovered robot/silent new"),
    )


def test_a_robot_that_is_not_declared_is_never_pending():
    play(
        (0, robot_settings("found", declared=False)),
        (0, robot_settings("known")),
        (900, None, "began robot/pending known"),
        (1000, robot_settings("known", declared=False), "removed robot/pending known"),
    )


def test_a_person_takes_a_robot_out():
    play(
        (0, level("motor", ERROR)),
        (0, check(1, 2)),
        (10, None, "began check/critical r1 motors", "began component/critical r1 motor"),
        (20, silent()),
        (30, None, "began robot/silent r1"),
        (
            40,
            forget(),
            "removed component/critical r1 motor",
            "removed check/critical r1 motors",
            "removed robot/silent r1",
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
        (240, silent(), "began robot/flapping r1"),
        (248, back()),
        (300, silent()),
        (320, None),
        (330, back("r1", level("motor", ERROR), level("camera", STALE))),
        (340, None, "began component/critical r1 motor"),
        (1500, None, "began component/stale r1 camera", "recovered robot/flapping r1"),
    )


def test_a_robot_that_stays_away_after_coming_and_going_is_silent():
    play(
        *_OUTAGES,
        (240, silent(), "began robot/flapping r1"),
        (248, back()),
        (300, silent()),
        (1500, None, "recovered robot/flapping r1", "began robot/silent r1"),
    )


# -- restarts ----------------------------------------------------------------------------------


def test_a_restart_in_a_fault_ends_nothing_and_begins_nothing():
    play(
        (0, level("motor", ERROR)),
        (10, None, "began component/critical r1 motor"),
        (20, restart()),
        (25, back("r1", level("motor", STALE))),
        (30, level("motor", ERROR)),
        (70, level("motor", OK), "recovered component/critical r1 motor"),
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


def test_nothing_that_rests_on_absence_begins_within_restart_grace():
    play(
        (0, level("camera", STALE)),
        (5, restart()),
        (6, back("r1", level("camera", STALE), level("motor", ERROR), check(1, 2))),
        (16, None, "began component/critical r1 motor"),
        (34, None),
        (35, None, "began check/critical r1 motors", "began component/stale r1 camera"),
    )


def test_a_soft_problem_keeps_its_clock_over_a_restart_that_takes_long():
    first = player(["r1"], FaultSettings())
    first.go(0, level("motor", ERROR))
    first.reborn(300)

    assert first.faults.started(instant(300)) == []
    assert [each.what for each in first.go(305, back("r1", level("motor", ERROR)))] == ["began"]
    assert next(iter(first.faults.faults())).since == WALL


def test_without_its_rows_an_exporter_judges_anew_and_tells_no_recovery():
    lost = player(["r1"], FaultSettings())

    assert lost.go(0, restart(), back("r1", level("motor", ERROR))) == []
    assert [each.what for each in lost.go(10)] == ["began"]


def test_settled_once_restart_grace_is_over():
    last = player(["r1"], FaultSettings())
    last.go(0, restart())

    assert not last.faults.settled(instant(29))
    assert last.faults.settled(instant(30))


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


# -- checks ------------------------------------------------------------------------------------


def test_a_check_that_finds_too_few_components_is_a_fault_until_it_finds_them():
    play(
        (0, check(1, 2)),
        (10, None, "began check/critical r1 motors"),
        (20, silent()),
        (30, None, "began robot/silent r1"),
        (40, back("r1", check(1, 2)), "recovered robot/silent r1"),
        (60, check(2, 2), "recovered check/critical r1 motors"),
    )


def test_a_check_that_expects_nothing_any_more_was_taken_out():
    play(
        (0, check(1, 2)),
        (10, None, "began check/critical r1 motors"),
        (20, check(1, None), "removed check/critical r1 motors"),
    )


# -- maintenance -------------------------------------------------------------------------------


def test_what_began_before_a_window_and_is_well_at_its_end_ends_then_whatever_was_between():
    play(
        (0, level("motor", ERROR)),
        (10, None, "began component/critical r1 motor"),
        (20, maintenance(planned=True)),
        (30, level("motor", OK)),
        (40, level("motor", ERROR)),
        (50, level("motor", OK)),
        (80, maintenance(planned=False), "recovered component/critical r1 motor"),
    )


def test_what_was_well_in_a_window_and_is_silent_at_its_end_ends_when_it_is_received():
    play(
        (0, level("motor", ERROR)),
        (10, None, "began component/critical r1 motor"),
        (20, maintenance(planned=True)),
        (30, level("motor", OK)),
        (40, silent()),
        (80, maintenance(planned=False), "began robot/silent r1"),
        (
            90,
            back("r1", level("motor", OK)),
            "recovered robot/silent r1",
            "recovered component/critical r1 motor",
        ),
    )


def test_in_maintenance_nothing_of_any_kind_begins():
    flaps = [(20 + second, level("arm", (ERROR, OK)[second % 2])) for second in range(30)]
    comes_and_goes = [(100 + 20 * n, (silent(), back())[n % 2]) for n in range(20)]
    play(
        (0, maintenance(planned=True)),
        (0, together(level("motor", ERROR), level("camera", STALE), check(1, 2))),
        *flaps,
        (60, together(level("motor", OK), level("camera", OK), check(2, 2))),
        *comes_and_goes,
        (990, maintenance(planned=False)),
        (5000, None),
    )


def test_a_fault_that_outlives_the_window_begins_with_its_end():
    play(
        (0, maintenance(planned=True)),
        (5, level("motor", ERROR)),
        (55, level("arm", ERROR)),
        (60, maintenance(planned=False), "began component/critical r1 motor"),
        (65, None, "began component/critical r1 arm"),
    )
