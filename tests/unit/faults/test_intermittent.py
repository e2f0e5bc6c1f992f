"""Components whose faults are too short to be confirmed, and too many to be chance."""

from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    FaultSettings,
    Intermittent,
    WarningHours,
)
from support.fault_histories import (
    ERROR,
    OK,
    WARN,
    back,
    level,
    levels,
    maintenance,
    on_robots,
    play,
    silent,
)

INTERMITTENT = "flapping/intermittent r1 motor"
CRITICAL = "component/critical r1 motor"


def flick(second: float):
    """A fault of two seconds."""
    return (second, level("motor", ERROR)), (second + 2, level("motor", OK))


def test_two_short_faults_within_ten_minutes_are_an_intermittent_one():
    play(
        *flick(0),
        *flick(400),
        (412, None, f"began {INTERMITTENT}"),
        *flick(500),
        # The last change but one is of second 500.
        (1099, None),
        (1100, None, f"recovered {INTERMITTENT}"),
    )


def test_it_is_over_once_fewer_than_half_of_the_changes_are_left():
    play(
        *flick(0),
        *flick(200),
        *flick(400),
        (440, None, f"began {INTERMITTENT}"),
        (801, None),
        (802, None, f"recovered {INTERMITTENT}"),
        settings=FaultSettings(intermittent=Intermittent(changes=6)),
    )


def test_two_short_faults_in_more_than_ten_minutes_are_chance():
    play(*flick(0), *flick(602), (2000, None))


def test_quick_changes_wait_until_they_are_not_flapping():
    # The ratio of four changes in a row is 0.24; it is below `stop` after nine intervals of 15 s.
    play(
        *flick(0),
        *flick(4),
        (140, None),
        (141, None, f"began {INTERMITTENT}"),
        (606, None, f"recovered {INTERMITTENT}"),
    )


def test_changes_of_a_confirmed_fault_are_none():
    play(
        *flick(0),
        (100, level("motor", ERROR)),
        (110, None, f"began {CRITICAL}"),
        (200, level("motor", OK), f"recovered {CRITICAL}"),
        *flick(300),
        (620, None),
        *flick(700),
        (712, None, f"began {INTERMITTENT}"),
        (1300, None, f"recovered {INTERMITTENT}"),
    )


def test_the_fourth_change_may_be_a_fault_that_is_confirmed():
    play(
        *flick(0),
        (200, level("motor", ERROR)),
        (202, level("motor", OK)),
        (204, level("motor", ERROR)),
        (214, None, f"began {CRITICAL}"),
        (300, level("motor", OK), f"recovered {CRITICAL}"),
        (2000, None),
    )


def test_it_goes_on_beside_a_fault_and_until_the_component_is_ok():
    play(
        *flick(0),
        *flick(310),
        (322, None, f"began {INTERMITTENT}"),
        (600, level("motor", ERROR)),
        (610, None, f"began {CRITICAL}"),
        (3000, None),
        (3001, level("motor", OK), f"recovered {CRITICAL}", f"recovered {INTERMITTENT}"),
    )


def test_silence_is_no_rest():
    play(
        *flick(0),
        *flick(310),
        (322, None, f"began {INTERMITTENT}"),
        (300, silent()),
        (340, None, "began robot/silent r1"),
        (5000, back("r1", level("motor", OK)), "recovered robot/silent r1"),
        (5599, None),
        (5600, None, f"recovered {INTERMITTENT}"),
    )


def test_changes_of_before_the_robots_silence_are_as_old_as_they_are():
    play(
        *flick(0),
        (20, silent()),
        (30, None, "began robot/silent r1"),
        (500, back("r1", level("motor", OK)), "recovered robot/silent r1"),
        *flick(605),
        (1000, None),
    )


def test_maintenance_is_suppressed_both_ways():
    play(
        (-1, maintenance("r1", planned=True)),
        *flick(0),
        *flick(310),
        (500, maintenance("r1", planned=False)),
        *flick(700),
        *flick(1010),
        (1022, None, f"began {INTERMITTENT}"),
        (1030, maintenance("r1", planned=True)),
        (3000, maintenance("r1", planned=False), f"recovered {INTERMITTENT}"),
    )


def test_the_fourth_change_is_a_fault_that_says_the_others_also_where_they_were_long_before():
    play(
        (0, level("motor", ERROR)),
        (2, level("motor", WARN)),
        (4, level("motor", OK)),
        (500, level("motor", ERROR)),
        (510, None, f"began {CRITICAL}"),
        (520, level("motor", OK), f"recovered {CRITICAL}"),
        (2000, None),
    )


def test_what_flapped_before_the_hours_of_warnings_is_not_intermittent_after_it():
    hours = WarningHours(((0, 14 * 60, 15 * 60),), "UTC")  # from second 800 on
    play(
        *(step for number in range(9) for step in flick(700 + 6 * number)),
        (800, None, "began flapping/flapping r1 motor"),
        (990, None, "recovered flapping/flapping r1 motor"),
        (1500, None),
        settings=FaultSettings(warning_hours=hours),
    )


def test_what_larger_faults_said_of_a_component_is_not_intermittent():
    """Twelve of twenty fail for a minute, and again: once that was twelve faults beside the two."""
    parts = [f"part {number}" for number in range(12)]
    steps = [
        step
        for start in (0, 180)
        for step in (
            (start, levels(parts, ERROR)),
            (start + 10, None, "began robot/many r1 critical"),
            (start + 60, levels(parts[:7], OK)),
            (start + 61, levels(parts[7:8], OK), "recovered robot/many r1 critical"),
            (start + 62, levels(parts[8:], OK)),
        )
    ]
    play(*steps, (1000, None))


def test_nor_is_what_is_common_to_many_robots():
    robots = ["r1", "r2", "r3", "r4"]
    steps = [
        step
        for start in (0, 180)
        for step in (
            (start, on_robots(robots, level, "motor", ERROR)),
            (start + 10, None, "began common/critical motor"),
            (start + 60, on_robots(robots, level, "motor", OK), "recovered common/critical motor"),
        )
    ]
    play(
        *steps,
        (1000, None),
        robots=robots,
        settings=FaultSettings(common=CauseSettings(3, 0.5)),
    )


def test_nor_is_what_changes_while_that_is_a_fault():
    robots = ["r1", "r2", "r3", "r4"]
    play(
        (0, on_robots(robots[1:], level, "motor", ERROR)),
        (10, None, "began common/critical motor"),
        *flick(20),
        (100, on_robots(robots[1:], level, "motor", OK), "recovered common/critical motor"),
        *flick(300),
        (1000, None),
        robots=robots,
        settings=FaultSettings(common=CauseSettings(3, 0.5)),
    )
