"""Components behind one that fails: its fault alone, and what still exists after it."""

from ros_diagnostics_exporter.config.fleet import CauseSettings, FaultSettings
from ros_diagnostics_exporter.faults.model import Reason
from support.fault_histories import (
    ERROR,
    OK,
    STALE,
    WARN,
    Event,
    back,
    forget,
    level,
    levels,
    maintenance,
    on_robots,
    play,
    silent,
    together,
    value,
)

PARTS = [f"part {number}" for number in range(12)]
POWER = "began component/critical r1 power"
WELL = "recovered component/critical r1 power"
BOTH = ("critical", "warning")
LASER = "began component/critical r1 laser"


def behind(component: str, to: int, *of: str, robot: str = "r1", **more: object) -> Event:
    """A component that is behind these (power)."""
    names = frozenset(("", each) for each in of or ("power",))
    return level(component, to, robot, depends_on=names, **more)


def test_what_fails_with_it_and_recovers_with_it_is_one_fault_and_one_recovery():
    play(
        (0, together(behind("laser", ERROR), behind("camera", STALE))),
        (5, level("power", ERROR)),
        (14, None),
        (15, None, POWER),
        (300, level("power", OK), WELL),
        (350, together(behind("laser", OK), behind("camera", OK))),
        (1000, None),
    )


def test_what_is_still_wrong_counts_from_when_the_others_had_time_to_return():
    play(
        (0, together(level("power", ERROR), behind("laser", ERROR))),
        (10, None, POWER),
        (40, level("power", OK), WELL),
        (89, None),  # 40 s for which it had failed, and the laser's confirm_after
        (90, None, LASER),
    )
    play(
        (0, together(level("power", ERROR), behind("laser", ERROR))),
        (10, None, POWER),
        (5000, level("power", OK), WELL),
        (5069, None),  # a minute at most
        (5070, None, LASER),
    )


def test_the_value_of_a_component_that_is_ok_counts_from_then_too():
    """It was never a fault: only a level was noted as one that depends on another."""
    settings = {"depends_on": frozenset({("", "power")})}
    play(
        (0, together(level("power", ERROR), value(5.0, **settings))),
        (10, None, POWER),
        (40, level("power", OK), WELL),
        (89, None),
        (90, None, *[f"began value/{each} r1 battery charge low" for each in BOTH]),
    )


def test_what_is_stale_explains_that_others_are_and_no_error():
    play(
        (0, together(level("power", STALE), behind("camera", STALE), behind("laser", ERROR))),
        (10, None, LASER, "began component/stale r1 power"),
        (300, None),
    )


def test_what_is_in_warning_explains_nothing():
    play(
        (0, together(level("power", WARN), behind("laser", ERROR))),
        (10, None, LASER, "began component/warning r1 power"),
    )


def test_a_fault_of_before_goes_on_and_ends_by_what_is_received():
    play(
        (0, behind("laser", ERROR)),
        (10, None, LASER),
        (20, level("power", ERROR)),
        (30, None, POWER),
        (40, behind("laser", OK), "recovered component/critical r1 laser"),
    )


def test_while_the_robot_is_silent_and_after_it_still_explains():
    play(
        (0, together(level("power", ERROR), behind("laser", ERROR))),
        (10, None, POWER),
        (20, silent()),
        (30, None, "began robot/silent r1"),
        (
            60,
            back("r1", behind("laser", ERROR), level("power", ERROR)),
            "recovered robot/silent r1",
        ),
        (300, None),
    )


def test_what_a_person_took_out_explains_nothing_any_more():
    play(
        (0, together(level("power", ERROR), behind("laser", ERROR))),
        (10, None, POWER),
        (30, forget(component="power"), "removed component/critical r1 power", LASER),
    )


def test_a_component_behind_several_is_explained_by_each():
    of = ("hub", "power")
    play(
        (0, together(level("power", ERROR), behind("laser", ERROR, *of))),
        (10, None, POWER),
        (20, level("hub", ERROR)),
        (30, None, "began component/critical r1 hub"),
        (100, level("power", OK), WELL),
        (300, None),
    )


def test_many_behind_one_are_not_many_components_at_once():
    names = frozenset({("", "power")})
    all_of_them = levels(PARTS, STALE, depends_on=names)
    play((0, together(level("power", ERROR), all_of_them)), (10, None, POWER), (300, None))
    # Those that are known to fail before it wait for as long as a query takes to notice.
    play((0, all_of_them), (9, level("power", ERROR)), (19, None, POWER), (300, None))


def test_the_same_component_behind_others_of_many_robots_is_no_common_cause():
    robots = ["r1", "r2", "r3", "r4"]
    settings = FaultSettings(common=CauseSettings(3, 0.5))
    for_each = [f"began component/critical {each} power" for each in robots]
    last = play(
        (0, on_robots(robots[:2], level, "power", ERROR)),
        (1, on_robots(robots[:2], behind, "laser", ERROR)),
        (2, together(*(behind("laser", ERROR, robot=each) for each in robots[2:3]))),
        (10, None, *for_each[:2]),
        (12, None, "began component/critical r3 laser"),
        (300, None),
        robots=robots,
        settings=settings,
    )
    suppressed = {
        each.suppressed for each in last.faults.problems(last.at(300)) if each.fault is None
    }
    assert suppressed == {Reason.DEPENDS_ON}


def test_what_flaps_with_it_is_one_fault():
    steps: list[tuple[object, ...]] = [
        (5.0 * number, together(level("power", to), behind("laser", to)))
        for number, to in enumerate([ERROR, OK] * 6)
    ]
    steps[6] = (*steps[6], "began flapping/flapping r1 power")
    play(*steps)


def test_many_of_them_have_time_to_return_before_they_are_many():
    """Once that was a fault at the moment at which the power was back."""
    parts = [behind(each, ERROR) for each in PARTS]
    steps = (
        (0, together(*parts)),
        (5, level("power", ERROR)),
        (20, None, POWER),  # for five seconds it was one of many
        (105, level("power", OK), WELL),
    )
    well = together(*(behind(each, OK) for each in PARTS))
    play(*steps, (145, well), (1000, None))
    # A minute, their confirm_after, and the 15 s in which it may turn out that something else is.
    play(*steps, (189, None), (190, None, "began robot/many r1 critical"))


def test_nor_are_they_common_to_many_robots_before():
    robots = ["r1", "r2", "r3", "r4"]
    of_all = {"robots": robots, "settings": FaultSettings(common=CauseSettings(3, 0.5))}
    steps = (
        (0, on_robots(robots, level, "power", ERROR)),
        (1, together(*(behind("laser", ERROR, robot=each) for each in robots))),
        (10, None, "began common/critical power"),
        (100, on_robots(robots, level, "power", OK), "recovered common/critical power"),
    )
    well = together(*(behind("laser", OK, robot=each) for each in robots))
    play(*steps, (140, well), (1000, None), **of_all)
    play(*steps, (169, None), (170, None, "began common/critical laser"), **of_all)


def test_what_is_over_without_data_gives_time_only_once():
    """Each change of the robot's downtime gave the laser another half a minute."""
    play(
        (0, together(level("power", ERROR, planned_stale=True), behind("laser", ERROR))),
        (10, None, POWER),
        (30, level("power", STALE, planned_stale=True)),
        *(
            step
            for second in range(31, 68, 2)
            for step in (
                (second, maintenance(planned=True)),
                (second + 1, maintenance(planned=False)),
            )
        ),
        (70, None, LASER),
    )
