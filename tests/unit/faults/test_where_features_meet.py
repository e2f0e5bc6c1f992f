"""Mistakes that were made where two features meet: each was seen once, by a person."""

import pytest

from ros_diagnostics_exporter.config.fleet import CauseSettings, FaultSettings
from ros_diagnostics_exporter.faults.model import (
    CapabilityState,
    ComponentName,
    ComponentReport,
    ComponentSettings,
    PartName,
    RobotSettings,
)
from ros_diagnostics_exporter.faults.needs import AtLeast, WantedCapability
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
    moved,
    on_robots,
    play,
    player,
    robot_settings,
    silent,
    texts,
    together,
    unreachable,
)

UPPER, LOWER = "lidar upper", "lidar lower"
VIEW = WantedCapability("view", AtLeast(1, (PartName(component=UPPER), PartName(component=LOWER))))
CRITICAL = f"began component/critical r1 {UPPER}"
SIX = [f"r{number}" for number in range(1, 7)]


def can_see_by_one(faults, now):
    seen = WantedCapability("view", AtLeast(None, (PartName(component=UPPER),)))
    return faults.configure_capabilities("r1", [seen], now)


def can(*events):
    """The events of a robot that can see by one of two lidars, as after each start."""
    return together(lambda faults, now: faults.configure_capabilities("r1", [VIEW], now), *events)


def test_a_lidar_that_is_error_is_reported_although_the_other_is_lost_too():
    """The capability is unknown then, has no fault, and suppresses nothing."""
    play(
        (0, can(level(UPPER, ERROR))),
        (2, can(level(LOWER, STALE))),
        (12, None, CRITICAL, "began component/stale r1 lidar lower"),
    )


def test_a_lidar_is_not_reported_beside_the_view_that_is_lost_while_the_other_is_replaced():
    """The other is STALE in a downtime of its own: the robot could see by this one alone."""
    replaced = frozenset({UPPER})
    play(
        (0, can(lambda faults, now: faults.components_in_maintenance("r1", replaced, now))),
        (10, can(level(UPPER, STALE), level(LOWER, ERROR))),
        (20, None, "began capability/lost r1 view"),
        (60, can(level(LOWER, OK)), "recovered capability/lost r1 view"),
    )


def test_a_capability_without_reserve_does_not_hide_that_nothing_is_left():
    play(
        (0, can(level(UPPER, ERROR))),
        (10, None, "began capability/no_reserve r1 view"),
        (60, can(level(LOWER, STALE))),
        (70, None, "began component/stale r1 lidar lower"),
        (120, None, CRITICAL),  # the 50 s for which the capability said it, and confirm_after
    )


def test_what_is_switched_off_as_planned_explains_nothing():
    on_board = {"depends_on": frozenset({("", "board")})}
    play(
        (0, level("board", ERROR, planned_stale=True)),
        (3, level("board", STALE, planned_stale=True)),
        (10, level(UPPER, ERROR, **on_board)),
        (20, None, CRITICAL),
    )


@pytest.mark.parametrize("seconds", [0, 2])
def test_what_is_switched_off_as_planned_takes_nothing_from_what_its_robot_can_do(seconds):
    """Whether it was OK until then, or ERROR while it was switched off."""
    last = player(["r1"], FaultSettings())
    last.go(0, can_see_by_one, level(UPPER, ERROR if seconds else OK, planned_stale=True))
    last.go(seconds, level(UPPER, STALE, planned_stale=True))
    assert last.go(600) == []
    assert last.faults.capabilities("r1")["view"].state is CapabilityState.OK


def test_what_is_lost_is_not_found_because_its_part_is_switched_off_as_planned():
    last = play(
        (0, together(can_see_by_one, level(UPPER, ERROR, planned_stale=True))),
        (10, None, "began capability/lost r1 view"),
        (60, together(can_see_by_one, level(UPPER, STALE, planned_stale=True))),
        (600, None),
    )
    assert last.faults.capabilities("r1")["view"].state is CapabilityState.UNKNOWN
    assert texts(last.go(601, level(UPPER, OK))) == ["recovered capability/lost r1 view"]


def can_by(*parts: PartName):
    """What another array makes of the robot's capability, once a part is gone or has moved."""
    view = WantedCapability("view", AtLeast(1, parts))
    return lambda faults, now: faults.configure_capabilities("r1", [view], now)


def test_what_is_lost_stays_lost_while_its_part_moves_to_another_group():
    again = can_by(PartName("top", UPPER), PartName(component=LOWER))
    play(
        (0, can(levels([UPPER, LOWER], ERROR))),
        (10, None, "began capability/lost r1 view"),
        (60, together(moved(UPPER, "", "top"), again)),
        (
            300,
            together(again, level(UPPER, OK, group="top")),
            "recovered capability/lost r1 view",
            "began capability/no_reserve r1 view",
        ),
        (310, together(again, level(LOWER, OK)), "recovered capability/no_reserve r1 view"),
    )


def test_what_is_lost_stays_lost_while_a_person_takes_out_one_of_its_parts():
    again = can_by(PartName(component=LOWER))
    play(
        (0, can(levels([UPPER, LOWER], ERROR))),
        (10, None, "began capability/lost r1 view"),
        (60, together(forget("r1", UPPER), again)),
        (300, together(again, level(LOWER, OK)), "recovered capability/lost r1 view"),
    )


def test_what_had_no_reserve_for_a_part_that_a_person_takes_out_is_removed():
    play(
        (0, can(level(UPPER, ERROR))),
        (10, None, "began capability/no_reserve r1 view"),
        (
            60,
            together(forget("r1", UPPER), can_by(PartName(component=LOWER))),
            "removed capability/no_reserve r1 view",
        ),
    )


def test_components_that_flash_while_they_are_switched_off_are_not_many():
    parts = [f"part {number}" for number in range(10)]
    play(
        (0, levels(parts, ERROR, planned_stale=True)),
        (2, levels(parts, STALE, planned_stale=True)),
        (1000, None),
    )


def test_many_that_are_a_fault_are_not_over_because_they_are_switched_off():
    parts = [f"part {number}" for number in range(10)]
    play(
        (0, levels(parts, ERROR, planned_stale=True)),
        (10, None, "began robot/many r1 critical"),
        (20, levels(parts, STALE, planned_stale=True)),
        (1000, levels(parts, OK), "recovered robot/many r1 critical"),
    )


def test_what_is_no_fault_in_time_explains_nothing():
    """The board takes an hour to be confirmed."""
    on_board = {"depends_on": frozenset({("", "board")})}
    play(
        (0, together(level("board", ERROR, confirm_after=3600), level(UPPER, ERROR, **on_board))),
        (10, None, CRITICAL),
        (3600, None, "began component/critical r1 board"),
    )


def test_a_value_is_not_known_while_its_component_is_stale():
    charge = WantedCapability(
        "driving", AtLeast(None, (PartName(component="battery", key="charge"),))
    )
    last = play((0, lambda faults, now: faults.configure_capabilities("r1", [charge], now)))
    last.go(1, level("battery", STALE))
    assert last.faults.capabilities("r1")["driving"].state is CapabilityState.UNKNOWN


def test_robots_of_a_switch_that_is_away_four_times_do_not_flap():
    steps = [
        step
        for number in range(5)
        for step in (
            (100 * number + 20, on_robots(SIX, silent)),
            (100 * number + 29, together(*map(back, SIX))),
        )
    ]
    play(
        (0, together(*(robot_settings(robot, site="hall") for robot in SIX))),
        *steps,
        (1000, None),
        robots=SIX,
        settings=FaultSettings(site=CauseSettings(3, 0.5)),
    )


def test_what_was_silent_while_its_domain_could_not_be_joined_does_not_flap_after_it():
    cut_off = unreachable("r1", is_so=True)  # after a restart it is reported anew
    outages = [
        step
        for minute in range(1, 5)
        for step in (
            (60 * minute, together(cut_off, silent())),
            (60 * minute + 8, together(cut_off, back())),
        )
    ]
    play(
        *outages,
        (250, unreachable("r1", is_so=False)),
        (1000, None),
    )


def test_a_robot_that_comes_back_is_not_silent_although_it_flaps():
    outages = [
        step
        for minute in range(1, 8)
        for step in ((60 * minute, silent()), (60 * minute + 30, back()))
    ]
    last = player(["r1"], FaultSettings())
    changes = []
    for second, event in outages:
        changes += last.go(second, event)
    assert "began robot/flapping r1" in texts(changes)
    assert [fault.identity.state.value for fault in last.faults.faults()] == ["flapping"]


def boots(component: str, to: int, *, is_first: bool):
    reports = [ComponentReport(ComponentName("", component), to, ComponentSettings(10.0), is_first)]
    return lambda faults, now: faults.components_changed("r1", reports, 20, now)


def booting(seconds: float):
    how = RobotSettings({}, 10.0, boot_grace=seconds)
    return lambda faults, now: faults.configure_robot("r1", how, now, declared=True)


def test_what_is_wrong_from_the_first_message_on_has_the_boot_grace():
    play(
        (0, booting(120.0)),
        (10, silent()),
        (20, None, "began robot/silent r1"),
        (
            60,
            back("r1", boots(UPPER, ERROR, is_first=True), boots("motor", OK, is_first=True)),
            "recovered robot/silent r1",
        ),
        (70, boots("motor", ERROR, is_first=False)),
        (80, None, "began component/critical r1 motor"),
        (179, None),
        (180, None, CRITICAL),
    )


def test_what_is_well_in_time_is_no_fault_after_a_boot():
    play(
        (0, booting(120.0)),
        (10, silent()),
        (20, None, "began robot/silent r1"),
        (60, back("r1", boots(UPPER, WARN, is_first=True)), "recovered robot/silent r1"),
        (170, level(UPPER, OK)),
        (1000, None),
    )


def test_components_that_depend_on_each_other_for_a_moment_are_judged():
    """While other settings are taken one by one; both of them for good are rejected before."""
    one, other = ({"depends_on": frozenset({("", name)})} for name in ("motor", UPPER))
    play(
        (0, together(level(UPPER, ERROR, **one), level("motor", ERROR, **other))),
        (5, level("motor", ERROR)),
        (10, None, "began component/critical r1 motor"),
    )


def test_what_was_critical_by_the_config_alone_is_not_after_a_restart_and_a_reload():
    play(
        (0, level(UPPER, STALE, stale_is_critical=True)),
        (5, level(UPPER, STALE)),
        (10, None, "began component/stale r1 lidar upper"),
    )


def test_many_components_do_not_explain_what_is_counted_towards_them():
    """Once each of both changed the other for ever, and the exporter stood still."""
    behind_board = {"depends_on": frozenset({("", "board")})}
    of_six = {"robot": "r1", "total": 6}
    play(
        (
            0,
            together(
                level("board", ERROR, **of_six, confirm_after=200.0),
                level("camera", ERROR, **of_six, **behind_board),
                level("motor", ERROR, **of_six),
            ),
        ),
        (1, level("motor", OK, **of_six)),
        (12, None, "began component/critical r1 camera"),  # the board is no fault in time
        (300, None, "began component/critical r1 board"),
        settings=FaultSettings(many=CauseSettings(3, 0.5)),
    )


def test_what_became_due_while_the_process_was_away_begins_when_it_is_back():
    """Once it was judged as of then, by all that became known later, and that need not end."""
    last = player(["r1"], FaultSettings())
    last.go(0, level("motor", ERROR))
    last.reborn(200)
    [begun] = last.go(201)
    assert begun.fault.confirmed - WALL == 200


@pytest.mark.parametrize("names", [("board", "motor"), ("motor", "board")])
def test_what_another_explains_is_not_common_however_the_array_is_ordered(names):
    """Once a motor that came before its board in the array made the common fault, and kept it."""
    on_board = ComponentSettings(10.0, depends_on=frozenset({("", "board")}))
    used = {"board": ComponentSettings(10.0), "motor": on_board}
    reports = [ComponentReport(ComponentName("", each), ERROR, used[each]) for each in names]
    play(
        (0, level("motor", ERROR, robot="r2")),
        (10, None, "began component/critical r2 motor"),
        (20, lambda faults, now: faults.components_changed("r1", reports, 20, now)),
        (30, None, "began component/critical r1 board"),
        (300, None),
        robots=["r1", "r2"],
        settings=FaultSettings(common=CauseSettings(2, 0.1)),
    )
