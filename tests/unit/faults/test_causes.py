"""Many problems that are one: of a robot, of a component on many robots, of a site."""

from ros_diagnostics_exporter.config.fleet import CauseSettings, FaultSettings
from support.fault_histories import (
    ERROR,
    OK,
    STALE,
    WALL,
    WARN,
    back,
    forget,
    level,
    levels,
    maintenance,
    on_robots,
    play,
    restart,
    robot_settings,
    silent,
    together,
    value,
)

MANY = "robot/many r1 critical"
MILD = "robot/many r1 warning"
SIX = [f"r{number}" for number in range(1, 7)]
TEN = [f"r{number}" for number in range(1, 11)]
PARTS = [f"part {number}" for number in range(1, 9)]


# -- many components of one robot --------------------------------------------------------------


def test_many_components_of_a_robot_are_one_and_those_left_over_are_reported_after():
    one, two = "component/critical r1 part 1", "component/critical r1 part 2"
    play(
        (30, level("part 1", ERROR, total=10)),
        (40, None, f"began {one}"),
        (60, levels(PARTS[1:], ERROR, total=10)),
        (70, None, f"began {MANY}"),
        (120, levels(PARTS[2:], OK, total=10), f"recovered {MANY}"),
        (189, None),  # the minute for which it lasted, and the part's confirm_after
        (190, None, f"began {two}"),
        (200, levels(PARTS[:2], OK, total=10), f"recovered {one}", f"recovered {two}"),
    )


def restless(*, times: int, seconds: int = 4):
    """All parts are ERROR and OK in turn, from 100 s on."""
    steps = [(100 + seconds * step, (ERROR, OK)[step % 2]) for step in range(2 * times)]
    return [(second, levels(PARTS, to, total=10)) for second, to in steps]


def test_many_components_that_flap_together_are_one_fault():
    play(
        *restless(times=4),
        (132, levels(PARTS, ERROR, total=10)),
        (136, levels(PARTS, OK, total=10), f"began {MILD}"),
        (145, level("other", ERROR, total=10)),
        (154, None),
        (155, None, f"began {MANY}"),  # as severe as the worst of them
        (200, level("other", OK, total=10)),
        (1000, None, f"recovered {MANY}", f"recovered {MILD}"),
    )


def test_an_error_of_a_moment_makes_many_warnings_not_critical():
    play(
        (30, levels(PARTS, WARN, total=10)),
        (40, None, f"began {MILD}"),
        (60, level("other", ERROR, total=10)),
        (63, level("other", OK, total=10)),
        (70, level("part 1", ERROR, total=10), f"began {MANY}"),  # not OK for long
    )


def test_many_components_that_are_one_critical_fault_go_on_in_it_while_they_flap():
    play(
        *restless(times=3, seconds=8),
        (148, levels(PARTS, ERROR, total=10)),
        (158, None, f"began {MANY}"),
        (160, levels(PARTS, OK, total=10)),
        (164, levels(PARTS, ERROR, total=10)),
        (168, levels(PARTS, OK, total=10)),
        (1000, None, f"recovered {MANY}"),
    )


def test_half_of_many_are_enough_to_confirm_it_and_fewer_are_not():
    six, few = PARTS[:6], FaultSettings(many=CauseSettings(6, 0.0))
    for left, *began in ((3, f"began {MANY}"), (2,)):
        own = [] if began else [f"began component/critical r1 {each}" for each in six[:2]]
        play(
            (0, levels(six, ERROR)),
            (5, levels(six[left:], OK)),
            (10, None, *began),
            (20, None, *own),
            settings=few,
        )


def test_many_are_as_severe_as_the_worst_and_the_milder_goes_on_under_it():
    play(
        (0, levels(PARTS, WARN, total=10)),
        (10, None, f"began {MILD}"),
        (20, level("part 1", ERROR, total=10), f"began {MANY}"),
        (30, level("part 1", WARN, total=10), f"recovered {MANY}"),
        (40, levels(PARTS, OK, total=10), f"recovered {MILD}"),
    )


def test_that_many_are_critical_again_is_another_fault_than_before():
    """Whose acknowledgement is for when it began: it escalates."""
    last = play(
        (0, levels(PARTS, WARN, total=10)),
        (10, None, f"began {MILD}"),
        (20, level("part 1", ERROR, total=10), f"began {MANY}"),
        (30, level("part 1", WARN, total=10), f"recovered {MANY}"),
        (40, level("part 1", ERROR, total=10), f"began {MANY}"),
    )
    assert [fault.since - WALL for fault in last.faults.faults()] == [0, 40]


def test_planned_stale_ones_do_not_count_and_neither_does_a_robot_that_boots():
    play(
        (0, levels(PARTS[:4], STALE, total=10, planned_stale=True)),
        (0, levels(PARTS[4:], STALE, total=10)),
        (10, None, *[f"began component/stale r1 {part}" for part in PARTS[4:]]),
        (
            20,
            levels(PARTS, OK, total=10),
            *[f"recovered component/stale r1 {part}" for part in PARTS[4:]],
        ),
        (30, silent()),
        (40, None, "began robot/silent r1"),
        (50, back("r1", levels(PARTS, STALE, total=10)), "recovered robot/silent r1"),
        (55, levels(PARTS, OK, total=10)),
        (100, None),
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


def test_one_name_in_five_groups_of_one_robot_is_no_common_cause():
    groups = [f"/group_{number}" for number in range(5)]
    play(
        (0, together(*(level("camera", ERROR, group=group) for group in groups))),
        (10, None, *[f"began component/critical r1 {group} camera" for group in groups]),
        robots=TEN,
    )


def test_what_all_robots_have_in_common_is_not_many_components_of_each():
    ended = [f"recovered common/critical {part}" for part in PARTS]
    play(
        (30, together(*(levels(PARTS, ERROR, robot, total=10) for robot in TEN))),
        (40, None, *[f"began common/critical {part}" for part in PARTS]),
        (50, together(*(levels(PARTS, OK, robot, total=10) for robot in TEN)), *ended),
        (100, None),
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
        (159, None),  # the minute for which the site was silent, and the robot's confirm_after
        (160, None, "began robot/silent r6"),
    )
    assert [fault.since - WALL for fault in last.faults.faults()] == [30]
    assert [fault.labels["site"] for fault in last.faults.faults()] == ["hall"]
    last.write(160)
    assert "cause" not in {kind for kind, _key in last.rows}  # it explains nothing any more


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


def test_robots_in_maintenance_are_no_part_of_what_a_share_is_of():
    play(
        (0, sites(*TEN, site="hall")),
        (10, maintenance(*TEN[4:], planned=True)),
        (20, on_robots(TEN[:2], silent)),
        (30, None, "began site/silent hall"),
        robots=TEN,
        settings=FaultSettings(site=CauseSettings(2, 0.5)),
    )


def test_a_restart_is_no_outage_of_a_site():
    play((0, sites(*SIX, site="hall")), (10, restart()), (35, on_robots(SIX, back)), (500, None))


def test_after_a_restart_a_site_recovers_with_the_last_robot_that_is_received():
    """Once only when restart_grace was over, if it had been received before the restart."""
    play(
        (0, sites("r1", "r2", site="hall")),
        (10, on_robots(["r1", "r2"], silent)),
        (20, None, "began site/silent hall"),
        (40, back("r1")),
        (50, restart()),
        (55, back("r2")),
        (60, back("r1"), "recovered site/silent hall"),
        (500, None),
        robots=["r1", "r2"],
        settings=FaultSettings(site=CauseSettings(2, 0.5)),
    )


def test_a_robot_in_maintenance_that_moves_to_another_site_is_no_part_of_that_ones_silence():
    hall, yard = SIX[:3], SIX[3:]
    play(
        (0, together(sites(*hall, site="hall"), sites(*yard, site="yard"))),
        (10, on_robots(hall, silent)),
        (20, None, "began site/silent hall"),
        (30, maintenance("r1", planned=True)),
        (40, sites("r1", site="yard")),
        (50, on_robots(yard, silent)),
        (60, None, "began site/silent yard"),
        (70, together(back("r4"), back("r5")), "recovered site/silent yard"),
        (75, back("r6")),
        settings=FaultSettings(site=CauseSettings(3, 0.5)),
        robots=SIX,
    )


def test_robots_that_a_person_takes_out_are_no_part_of_it():
    play(
        (0, sites(*SIX, site="hall")),
        (20, on_robots(SIX[:3], silent)),
        (30, None, "began site/silent hall"),
        (40, together(*map(forget, SIX[:2])), "removed site/silent hall"),
        (70, None, "began robot/silent r3"),
        settings=FaultSettings(site=CauseSettings(3, 0.5)),
    )


def test_components_that_a_person_takes_out_are_no_part_of_it():
    play(
        (0, on_robots(SIX[:3], level, "camera", ERROR)),
        (10, None, "began common/critical camera"),
        (
            20,
            together(*(forget(robot, "camera") for robot in SIX[:2])),
            "removed common/critical camera",
        ),
        (50, None, "began component/critical r3 camera"),
        robots=SIX,
        settings=FaultSettings(common=CauseSettings(3, 0.5)),
    )


def test_a_common_cause_lasts_until_fewer_than_half_of_its_threshold_are_left():
    play(
        (0, on_robots(SIX, level, "camera", ERROR)),
        (10, None, "began common/critical camera"),
        (20, on_robots(SIX[3:], level, "camera", OK)),
        (30, level("camera", OK), "recovered common/critical camera"),
        (35, together()),
        (70, None, *(f"began component/critical {robot} camera" for robot in SIX[1:3])),
        robots=TEN,
    )


def test_a_site_is_silent_with_robots_whose_maintenance_began_after_their_silence():
    play(
        (0, sites(*SIX, site="hall")),
        (30, on_robots(SIX, silent)),
        (35, together(*(maintenance(each, planned=True) for each in SIX[:3]))),
        (40, None, "began site/silent hall"),
        (300, None),
        settings=FaultSettings(site=CauseSettings(6, 0.0)),
        robots=SIX,
    )
