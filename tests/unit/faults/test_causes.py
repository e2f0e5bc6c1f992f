"""Many problems that are one: of a robot, of a component on many robots, of a site."""

from ros_diagnostics_exporter.config.fleet import CauseSettings, FaultSettings
from support.fault_histories import (
    ERROR,
    OK,
    STALE,
    WALL,
    WARN,
    FleetChange,
    back,
    check,
    forget,
    level,
    levels,
    maintenance,
    on_robots,
    play,
    player,
    restart,
    robot_settings,
    silent,
    texts,
    together,
    value,
)

MANY = "robot/many r1 critical"
MILD = "robot/many r1 warning"
SIX = [f"r{number}" for number in range(1, 7)]
TEN = [f"r{number}" for number in range(1, 11)]
PARTS = [f"part {number}" for number in range(1, 9)]


def each(robots, state="component/critical", what="began", part=" camera"):
    return [f"{what} {state} {robot}{part}" for robot in sorted(robots)]


# -- many components of one robot --------------------------------------------------------------


def test_many_components_of_a_robot_are_one_and_those_left_over_are_reported_after():
    one, two = "component/critical r1 part 1", "component/critical r1 part 2"
    play(
        (30, level("part 1", ERROR, total=10)),
        (40, None, f"began {one}"),
        (60, levels(PARTS[1:], ERROR, total=10)),
        (70, None, f"began {MANY}"),
        (120, levels(PARTS[2:], OK, total=10), f"recovered {MANY}"),
        (129, None),
        (130, None, f"began {two}"),
        (150, levels(PARTS[:2], OK, total=10), f"recovered {one}", f"recovered {two}"),
    )


def test_the_last_to_recover_are_not_reported_one_by_one():
    play(
        (0, levels(PARTS, ERROR, total=10)),
        (10, None, f"began {MANY}"),
        (60, levels(PARTS[:7], OK, total=10), f"recovered {MANY}"),
        (69, levels(PARTS[7:], OK, total=10)),
        (200, None),
    )


def test_many_are_as_severe_as_the_worst_and_the_milder_goes_on_under_it():
    play(
        (0, levels(PARTS, WARN, total=10)),
        (10, None, f"began {MILD}"),
        (20, level("part 1", ERROR, total=10), f"began {MANY}"),
        (30, level("part 1", WARN, total=10), f"recovered {MANY}"),
        (40, levels(PARTS, OK, total=10), f"recovered {MILD}"),
    )


def test_many_stay_one_fault_over_silence_restart_and_maintenance():
    play(
        (0, levels(PARTS, ERROR, total=10)),
        (10, None, f"began {MANY}"),
        (20, silent()),
        (30, None, "began robot/silent r1"),
        (40, back("r1", levels(PARTS, ERROR, total=10)), "recovered robot/silent r1"),
        (50, restart()),
        (55, back("r1", levels(PARTS, STALE, total=10))),
        (60, levels(PARTS, ERROR, total=10)),
        (70, maintenance(planned=True)),
        (80, levels(PARTS, OK, total=10)),
        (90, maintenance(planned=False), f"recovered {MANY}"),
    )


def test_planned_stale_ones_do_not_count_and_neither_does_a_robot_that_boots():
    play(
        (0, levels(PARTS[:4], STALE, total=10, planned_stale=True)),
        (0, levels(PARTS[4:], STALE, total=10)),
        (10, None, *[f"began component/stale r1 {part}" for part in PARTS[4:]]),
        (20, levels(PARTS, OK, total=10), *_recovered_stale()),
        (30, silent()),
        (40, None, "began robot/silent r1"),
        (50, back("r1", levels(PARTS, STALE, total=10)), "recovered robot/silent r1"),
        (55, levels(PARTS, OK, total=10)),
        (100, None),
    )


def test_a_fleet_that_charges_with_planned_stale_components_has_no_fault():
    thirty = [f"r{number}" for number in range(1, 31)]
    play(
        (0, together(*[level("camera", STALE, robot, planned_stale=True) for robot in thirty])),
        (3600, None),
        (3600, together(*[level("camera", OK, robot, planned_stale=True) for robot in thirty])),
        (3700, None),
        robots=thirty,
    )


def _recovered_stale():
    return [f"recovered component/stale r1 {part}" for part in PARTS[4:]]


def test_values_and_checks_of_a_robot_with_many_components_in_trouble_are_reported():
    play(
        (0, levels(PARTS, ERROR, total=10)),
        (10, None, f"began {MANY}"),
        (20, together(value(15.0), check(1, 2))),
        (30, None, "began check/critical r1 motors", "began value/warning r1 battery charge low"),
    )


# -- one component on many robots --------------------------------------------------------------


def test_the_same_component_on_many_robots_is_one_after_the_first():
    play(
        (0, level("camera", ERROR)),
        (10, None, "began component/critical r1 camera"),
        (30, on_robots(SIX[1:], level, "camera", ERROR)),
        (40, None, "began common/critical camera"),
        (90, on_robots(SIX[1:], level, "camera", OK), "recovered common/critical camera"),
        (100, level("camera", OK), "recovered component/critical r1 camera"),
        robots=TEN,
    )


def test_the_last_robots_to_recover_are_not_reported_one_by_one():
    play(
        (30, on_robots(SIX, level, "camera", ERROR)),
        (40, None, "began common/critical camera"),
        (90, on_robots(SIX[:5], level, "camera", OK), "recovered common/critical camera"),
        (95, level("camera", OK, "r6")),
        (200, None),
        robots=TEN,
    )


def test_a_common_cause_lasts_until_fewer_than_half_of_its_threshold_are_left():
    play(
        (0, on_robots(SIX, level, "camera", ERROR)),
        (10, None, "began common/critical camera"),
        (20, on_robots(SIX[3:], level, "camera", OK)),
        (30, level("camera", OK), "recovered common/critical camera"),
        (35, together()),
        (40, None, *each(SIX[1:3])),
        robots=TEN,
    )


def test_one_name_in_five_groups_of_one_robot_is_no_common_cause():
    groups = [f"/group_{number}" for number in range(5)]
    play(
        (0, together(*(level("camera", ERROR, group=group) for group in groups))),
        (10, None, *[f"began component/critical r1 {group} camera" for group in groups]),
        robots=TEN,
    )


def test_twenty_robots_of_a_thousand_with_the_same_part_are_one():
    thousand = [f"r{number}" for number in range(1000)]
    play(
        (0, on_robots(thousand[:19], level, "camera", ERROR)),
        (5, level("camera", ERROR, thousand[19])),
        (15, None, "began common/critical camera"),
        (20, on_robots(thousand[:20], level, "camera", OK), "recovered common/critical camera"),
        (100, None),
        robots=thousand,
    )


def test_nineteen_of_a_thousand_are_nineteen():
    thousand = [f"r{number}" for number in range(1000)]
    play(
        (0, on_robots(thousand[:19], level, "camera", ERROR)),
        (10, None, *each(thousand[:19])),
        robots=thousand,
    )


ELEVEN, FORTY = ([f"r{number}" for number in range(1, last + 1)] for last in (11, 40))


def test_eleven_of_forty_robots_that_fail_within_confirm_after_are_one():
    play(
        *((float(n), level("camera", ERROR, robot)) for n, robot in enumerate(ELEVEN[:9])),
        (9, on_robots(ELEVEN[9:], level, "camera", ERROR)),
        (18, None),
        (19, None, "began common/critical camera"),
        (3600, on_robots(ELEVEN, level, "camera", OK), "recovered common/critical camera"),
        (3700, None),
        robots=FORTY,
    )


def test_eleven_of_forty_robots_one_by_one_are_those_before_the_tenth_and_one():
    """With the default confirm_after of 10 s; a longer one than it takes them makes it one."""
    steps = [(6.0 * n, level("camera", ERROR, robot)) for n, robot in enumerate(ELEVEN)]
    found = player(FORTY, FaultSettings())
    changes = [text for at, event in steps for text in texts(found.go(at, event))]
    changes += texts(found.go(200))
    assert changes == [
        *(f"began component/critical {robot} camera" for robot in ELEVEN[:8]),
        "began common/critical camera",
    ]


def test_silence_stale_and_a_restart_are_no_recovery_of_a_common_cause():
    play(
        (0, on_robots(SIX, level, "camera", ERROR)),
        (10, None, "began common/critical camera"),
        (20, on_robots(SIX[:3], level, "camera", STALE)),
        (30, restart()),
        (40, together(*(back(robot, level("camera", STALE, robot)) for robot in SIX))),
        (50, on_robots(SIX, level, "camera", ERROR)),
        (
            60,
            on_robots(SIX, level, "camera", OK),
            *each(TEN[6:], "robot/silent", part=""),
            "recovered common/critical camera",
        ),
        (100, None),
        robots=TEN,
    )


def test_robots_in_maintenance_do_not_count_towards_a_common_cause():
    play(
        (0, maintenance(*SIX[:3], planned=True)),
        (0, on_robots(SIX, level, "camera", ERROR)),
        (10, None, *each(SIX[3:])),
        (20, maintenance(*SIX[:3], planned=False)),
        (30, None, "began common/critical camera"),
        (40, on_robots(SIX[:3], level, "camera", STALE)),
        (45, on_robots(SIX[3:], level, "camera", OK), *each(SIX[3:], what="recovered")),
        (50, level("camera", OK), "recovered common/critical camera"),
        (60, None, *each(SIX[1:3]), *each(SIX[1:3], "component/stale")),
        robots=TEN,
    )


def test_silent_robots_make_no_common_cause():
    play(
        (0, on_robots(SIX[:3], level, "camera", ERROR)),
        (10, None, *each(SIX[:3])),
        (20, on_robots(SIX[:3], silent)),
        (30, None, *each(SIX[:3], "robot/silent", part="")),
        (40, on_robots(SIX[3:5], level, "camera", ERROR)),
        (50, None, *each(SIX[3:5])),
        robots=TEN,
    )


def test_what_all_robots_have_in_common_is_not_many_components_of_each():
    play(
        (30, together(*(levels(PARTS, ERROR, robot, total=10) for robot in TEN))),
        (40, None, *[f"began common/critical {part}" for part in PARTS]),
        (50, together(*(levels(PARTS, OK, robot, total=10) for robot in TEN)), *_common_ends()),
        (100, None),
        robots=TEN,
    )


def _common_ends():
    return [f"recovered common/critical {part}" for part in PARTS]


def test_other_settings_of_the_fleet_hold_at_once():
    play(
        (0, on_robots(SIX[:2], level, "camera", ERROR)),
        (5, FleetChange(FaultSettings(common=CauseSettings(2, 0.1)))),
        (15, None, "began common/critical camera"),
        robots=TEN,
    )


# -- a site ------------------------------------------------------------------------------------


def sites(*robots, site):
    return together(*(robot_settings(robot, site=site) for robot in robots))


def test_a_site_that_is_cut_off_is_one_and_robots_that_stay_silent_are_reported_after():
    last = play(
        (0, sites(*SIX, site="hall")),
        (30, on_robots(SIX, silent)),
        (39, None),
        (40, None, "began site/silent hall"),
        (90, together(*map(back, SIX[:5])), "recovered site/silent hall"),
        (99, None),
        (100, None, "began robot/silent r6"),
    )
    assert [fault.since - WALL for fault in last.faults.faults()] == [30]
    assert [fault.labels["site"] for fault in last.faults.faults()] == ["hall"]


THOUSAND = [f"r{number}" for number in range(1000)]


def test_twenty_silent_robots_of_a_large_site_are_one_and_their_return_is_one():
    some = THOUSAND[:20]
    play(
        (0, sites(*THOUSAND, site="hall")),
        (30, on_robots(some, silent)),
        (40, None, "began site/silent hall"),
        (90, together(*map(back, some)), "recovered site/silent hall"),
        (200, None),
        robots=THOUSAND,
    )


def test_twenty_of_a_hundred_components_are_one_and_nineteen_are_nineteen():
    parts = [f"part {number}" for number in range(100, 120)]
    play(
        (0, levels(parts, ERROR, total=100)),
        (10, None, f"began {MANY}"),
        (90, levels(parts, OK, total=100), f"recovered {MANY}"),
        (200, levels(parts[1:], ERROR, total=100)),
        (210, None, *(f"began component/critical r1 {part}" for part in parts[1:])),
    )


def test_many_components_and_a_common_fault_cover_levels_and_no_thresholds():
    many = levels(PARTS, ERROR, total=10)
    common = together(*(level("battery", ERROR, robot) for robot in SIX))
    low = "value/critical r1 battery charge low", "value/warning r1 battery charge low"
    for cause, began, robots in (
        (many, MANY, ["r1"]),
        (common, "common/critical battery", SIX),
    ):
        play(
            (0, cause),
            (10, None, f"began {began}"),
            (20, together(level("motor", ERROR), value(1.0)) if cause is many else value(1.0)),
            (30, None, *(f"began {each}" for each in low)),
            robots=robots,
        )


def test_robots_of_another_site_are_reported_one_by_one():
    play(
        (0, together(sites(*SIX, site="hall"), sites("far", site="yard"))),
        (30, on_robots([*SIX, "far"], silent)),
        (40, None, "began robot/silent far", "began site/silent hall"),
        robots=[*SIX, "far"],
    )


def test_one_after_the_other_until_they_are_a_site():
    play(
        (0, sites(*SIX, site="hall")),
        (10, on_robots(SIX[:2], silent)),
        (20, None, *each(SIX[:2], "robot/silent", part="")),
        (30, on_robots(SIX[2:], silent)),
        (40, None, "began site/silent hall"),
        (
            50,
            together(*map(back, SIX)),
            *each(SIX[:2], "robot/silent", "recovered", part=""),
            "recovered site/silent hall",
        ),
    )


def test_a_site_in_maintenance_is_no_outage_and_a_window_is_no_recovery():
    play(
        (0, sites(*SIX, site="hall")),
        (10, maintenance(*SIX, planned=True)),
        (20, on_robots(SIX, silent)),
        (100, on_robots(SIX, back_of)),
        (200, maintenance(*SIX, planned=False)),
        (300, on_robots(SIX, silent)),
        (310, None, "began site/silent hall"),
        (320, maintenance(*SIX, planned=True)),
        (400, maintenance(*SIX, planned=False)),
        (410, on_robots(SIX, back_of), "recovered site/silent hall"),
        (500, None),
    )


def back_of(robot):
    return back(robot)


def test_robots_in_maintenance_are_no_part_of_what_a_share_is_of():
    play(
        (0, sites(*TEN, site="hall")),
        (10, maintenance(*TEN[4:], planned=True)),
        (20, on_robots(TEN[:2], silent)),
        (30, None, "began site/silent hall"),
        robots=TEN,
        settings=FaultSettings(site=CauseSettings(2, 0.5)),
    )


def test_a_site_that_was_switched_off_in_its_window_is_one_if_it_outlives_it():
    play(
        (0, sites(*SIX, site="hall")),
        (10, maintenance(*SIX, planned=True)),
        (20, on_robots(SIX, silent)),
        (100, maintenance(*SIX, planned=False)),
        (110, None, "began site/silent hall"),
        (500, on_robots(SIX, back_of), "recovered site/silent hall"),
    )


def test_a_restart_is_no_outage_of_a_site():
    play((0, sites(*SIX, site="hall")), (10, restart()), (35, on_robots(SIX, back_of)), (500, None))


def test_a_robot_that_is_taken_out_leaves_its_site():
    play(
        (0, sites(*SIX, site="hall")),
        (10, on_robots(SIX, silent)),
        (20, None, "began site/silent hall"),
        (30, together(*map(forget, SIX)), "recovered site/silent hall"),
        (100, None),
    )
