"""What a robot can do: one fault for what is lost, under which its parts are suppressed."""

import pytest

from ros_diagnostics_exporter.config.fleet import CauseSettings, FaultSettings, WarningHours
from ros_diagnostics_exporter.faults.engine import Faults
from ros_diagnostics_exporter.faults.model import CapabilityState, Change, PartName
from ros_diagnostics_exporter.faults.needs import MISSING, AtLeast, Other, WantedCapability
from ros_diagnostics_exporter.model import Instant
from support.fault_histories import (
    ERROR,
    OK,
    READY,
    STALE,
    WARN,
    Event,
    back,
    check,
    level,
    levels,
    maintenance,
    play,
    player,
    restart,
    silent,
    texts,
    together,
    value,
)

UPPER, LOWER, LEFT, MOTOR = "lidar upper", "lidar lower", "lidar left", "motor"
LOST = "capability/lost r1"
SPARE = "capability/no_reserve r1"
WORSE = "capability/degraded r1"


def part(name: str, **more: str) -> PartName:
    return PartName(component=name, **more)


VIEW = WantedCapability("view", AtLeast(1, (part(UPPER), part(LOWER))))
DRIVE = WantedCapability("drive", AtLeast(None, (Other("view"), part(MOTOR))))
DOCK = WantedCapability("dock", AtLeast(None, (part(LOWER), part("dock"))))
CHARGE = WantedCapability("charge", AtLeast(None, (part("battery"), PartName(check="motors"))))


class Can:
    """Has a robot's capabilities configured before each event, as after each start."""

    def __init__(self, *wanted: WantedCapability, robot: str = "r1") -> None:
        self._wanted, self._robot = wanted, robot

    def __call__(self, *events: Event) -> Event:
        return together(self._configure, *events)

    def _configure(self, faults: Faults, now: Instant) -> list[Change]:
        return faults.configure_capabilities(self._robot, self._wanted, now)


can = Can(VIEW, DRIVE)


def history(with_: Can, *steps: tuple[object, ...], **more: object) -> None:
    """As `play`, with the capabilities at each event."""
    made = [
        (second, None if event is None else with_(event), *expected)
        for second, event, *expected in steps
    ]
    play(*made, **more)


def test_two_redundant_parts_that_fail_are_one_fault_with_one_recovery():
    history(
        can,
        (0, level(UPPER, ERROR)),
        (0.5, level(LOWER, ERROR)),
        (10.4, None),
        (10.5, None, f"began {LOST} view"),
        (60, level(UPPER, OK), f"recovered {LOST} view", f"began {SPARE} view"),
        (90, level(LOWER, OK), f"recovered {SPARE} view"),
        (300, None),
    )


def test_an_error_that_leaves_no_reserve_waits_for_the_hours_of_warnings():
    hours = WarningHours(((0, 14 * 60, 15 * 60),), "UTC")  # second 0 is Monday 13:46:40
    history(
        Can(VIEW),
        (0, level(UPPER, ERROR)),
        (799, None),
        (800, None, f"began {SPARE} view"),
        (810, level(LOWER, ERROR)),
        (820, None, f"began {LOST} view"),
        settings=FaultSettings(warning_hours=hours),
    )


def test_as_many_as_are_needed_are_no_reserve_and_more_are_faults_of_their_own():
    six = tuple(part(f"lidar {each}") for each in range(8))
    names = [each.component for each in six]
    first = "component/critical r1 lidar 0"
    history(
        Can(WantedCapability("view", AtLeast(6, six))),
        (0, level(names[0], ERROR)),
        (10, None, f"began {first}"),
        (20, level(names[1], ERROR)),
        (30, None, f"began {SPARE} view"),
        (40, levels(names[2:4], ERROR)),
        (50, None, f"began {LOST} view"),
        (60, levels(names[1:], OK), f"recovered {LOST} view", f"recovered {SPARE} view"),
        (90, level(names[0], OK), f"recovered {first}"),
    )


def test_what_fails_further_delays_no_fault():
    three = tuple(map(part, (UPPER, LOWER, LEFT)))
    history(
        Can(WantedCapability("view", AtLeast(2, three))),
        (0, level(UPPER, ERROR)),
        (1, level(LOWER, ERROR)),
        (5, level(LEFT, ERROR)),
        (10.9, None),
        (11, None, f"began {LOST} view"),
    )


def test_what_is_left_over_is_reported_after_that():
    three = tuple(part(f"lidar {each}") for each in range(3))
    history(
        Can(WantedCapability("view", AtLeast(1, three))),
        (0, levels([each.component for each in three], ERROR)),
        (10, None, f"began {LOST} view"),
        (60, levels(["lidar 0", "lidar 1"], OK), f"recovered {LOST} view"),
        (119, None),  # the 50 s for which it was lost, and the lidar's confirm_after
        (120, None, "began component/critical r1 lidar 2"),
    )


def test_a_warning_degrades_what_needs_the_part():
    history(
        can,
        (0, level(MOTOR, WARN)),
        (10, None, f"began {WORSE} drive"),
        (20, level(MOTOR, ERROR), f"began {LOST} drive"),
        (30, level(MOTOR, OK), f"recovered {WORSE} drive", f"recovered {LOST} drive"),
    )


def test_the_first_of_those_that_need_the_same_has_the_fault():
    history(
        Can(VIEW, DRIVE, WantedCapability("park", AtLeast(None, (Other("view"),)))),
        (0, levels([UPPER, LOWER], ERROR)),
        (10, None, f"began {LOST} view"),
        (300, None),
    )


def test_what_is_worse_has_it_although_it_comes_later():
    history(
        Can(VIEW, DRIVE, DOCK),
        (0, level(LOWER, ERROR)),
        (10, None, f"began {LOST} dock"),
        (20, level(UPPER, ERROR)),
        (30, None, f"began {LOST} view"),
        (40, levels([UPPER, LOWER], OK), f"recovered {LOST} dock", f"recovered {LOST} view"),
    )


def test_a_further_part_is_a_further_fault_of_what_needs_both():
    history(
        can,
        (0, levels([UPPER, LOWER], ERROR)),
        (10, None, f"began {LOST} view"),
        (100, level(MOTOR, ERROR)),
        (110, None, f"began {LOST} drive"),
        (200, levels([UPPER, LOWER], OK), f"recovered {LOST} view"),
        (220, level(MOTOR, OK), f"recovered {LOST} drive"),
    )


def test_a_redundant_part_that_fails_for_a_moment_loses_nothing_at_once():
    history(
        can,
        (0, level(UPPER, ERROR)),
        (10, None, f"began {SPARE} view"),
        (600, level(LOWER, ERROR)),
        (605, level(LOWER, OK)),
        (700, level(UPPER, OK), f"recovered {SPARE} view"),
    )


def test_what_is_lost_again_soon_explains_its_parts_again():
    history(
        can,
        (0, level(MOTOR, ERROR)),
        (10, None, f"began {LOST} drive"),
        (20, level(MOTOR, OK), f"recovered {LOST} drive"),
        (25, level(MOTOR, ERROR)),
        (35, None, f"began {LOST} drive"),
        (300, None),
    )


def test_what_is_not_needed_any_more_explains_no_other():
    park = WantedCapability("park", AtLeast(None, (part(MOTOR),)))
    play(
        (0, Can(VIEW, park, DRIVE)(level(MOTOR, ERROR))),
        (10, None, f"began {LOST} park"),
        (20, Can(VIEW, park._replace(applies=False), DRIVE)(), f"recovered {LOST} park"),
        (30, None, f"began {LOST} drive"),
        (300, None),
    )


def test_the_parts_own_confirm_after_holds():
    history(
        can,
        (0, level(MOTOR, ERROR, confirm_after=60)),
        (59, None),
        (60, None, f"began {LOST} drive"),
    )


def test_a_stale_part_is_no_reserve_and_alone_a_fault_of_its_own():
    history(
        can,
        (0, level(LOWER, STALE)),
        (10, None, f"began {SPARE} view"),
        (20, level(MOTOR, STALE)),
        (30, None, "began component/stale r1 motor"),
        (40, level(LOWER, OK), f"recovered {SPARE} view"),
    )


def test_silence_neither_ends_nor_begins_anything():
    history(
        can,
        (0, levels([UPPER, LOWER], ERROR)),
        (10, None, f"began {LOST} view"),
        (20, silent()),
        (30, None, "began robot/silent r1"),
        (60, back("r1", level(UPPER, ERROR)), "recovered robot/silent r1"),
        (65, level(LOWER, ERROR)),
        (300, None),
        (400, levels([UPPER, LOWER], OK), f"recovered {LOST} view"),
    )


def test_a_restart_changes_nothing():
    history(
        can,
        (0, levels([UPPER, LOWER], ERROR)),
        (10, None, f"began {LOST} view"),
        (20, restart()),
        (22, back("r1", level(UPPER, ERROR))),
        (25, level(LOWER, ERROR)),
        (300, None),
        (400, level(UPPER, OK), f"recovered {LOST} view", f"began {SPARE} view"),
    )


def test_maintenance_of_the_robot_is_suppressed_both_ways():
    history(
        can,
        (0, maintenance(planned=True)),
        (1, levels([UPPER, LOWER], ERROR)),
        (100, maintenance(planned=False), f"began {LOST} view"),
        (200, maintenance(planned=True)),
        (210, levels([UPPER, LOWER], OK)),
        (300, maintenance(planned=False), f"recovered {LOST} view"),
    )


def on(maintained: str | None = None, *events: Event) -> Event:
    """The events while a component is in maintenance, as the exporter has it after each start."""
    names = frozenset(filter(None, [maintained]))

    def begin(faults: Faults, now: Instant) -> list[Change]:
        return faults.components_in_maintenance("r1", names, now)

    return together(can(), begin, can(*events))


def test_a_part_in_maintenance_is_left_out():
    play(
        (0, on(UPPER, level(UPPER, ERROR))),
        (100, on(UPPER, level(LOWER, ERROR))),
        (110, None, f"began {LOST} view"),
        (120, on(UPPER, level(LOWER, OK)), f"recovered {LOST} view"),
        (200, on(), f"began {SPARE} view"),
    )


def test_that_nothing_is_known_yet_of_the_other_parts_ends_nothing():
    """Once it was found by the part in maintenance, which is OK and cannot be used."""
    play(
        (0, on(UPPER, level(LOWER, ERROR))),
        (10, None, f"began {LOST} view"),
        (20, on(UPPER, silent())),
        (22, on(UPPER, back("r1", level(UPPER, OK)))),
        (25, on(UPPER, level(LOWER, ERROR))),
        (100, on(UPPER, level(LOWER, OK)), f"recovered {LOST} view"),
    )


def test_without_a_part_in_maintenance_the_others_are_judged():
    play(
        (0, on(MOTOR, level(MOTOR, ERROR))),
        (10, None),
        (20, on(MOTOR, level(UPPER, ERROR))),
        (30, None, f"began {SPARE} view"),
        (40, on(MOTOR, level(UPPER, OK)), f"recovered {SPARE} view"),
    )


def test_a_part_that_is_well_in_its_maintenance_ends_nothing_before_the_end_of_it():
    play(
        (0, on(None, level(MOTOR, ERROR))),
        (10, None, f"began {LOST} drive"),
        (20, on(MOTOR)),
        (30, on(MOTOR, level(MOTOR, OK))),
        (100, on(), f"recovered {LOST} drive"),
    )


def test_a_part_that_was_worse_in_its_maintenance_counts_as_before_it_once_it_is_well():
    last = play(
        (0, on(None, level(MOTOR, WARN))),
        (10, None, f"began {WORSE} drive"),
        (20, on(MOTOR)),
        (30, on(MOTOR, level(MOTOR, ERROR))),
        (100, on(MOTOR, level(MOTOR, OK))),
    )
    assert last.faults.capabilities("r1")["drive"].state is CapabilityState.DEGRADED


def test_a_part_that_flaps_is_as_good_as_at_its_worst():
    changes = [(2 * each, level(UPPER, OK if each % 2 else ERROR)) for each in range(7)]
    last = play(
        *((second, can(event)) for second, event in changes[:-1]),
        (12, can(changes[-1][1]), f"began {SPARE} view"),
        (14, can(level(UPPER, OK))),
        (20, can(level(LOWER, ERROR))),
        (30, None, f"began {LOST} view"),
        (40, can(level(LOWER, OK)), f"recovered {LOST} view"),
        (400, None, f"recovered {SPARE} view"),
    )
    assert last.faults.capabilities("r1")["view"].state is CapabilityState.OK


def test_what_is_lost_explains_no_changes_of_what_is_no_part_of_it():
    history(
        can,
        (0, level(MOTOR, ERROR)),
        (10, None, f"began {LOST} drive"),
        *((second, level("fan", to)) for second, to in ((20, ERROR), (22, OK), (400, ERROR))),
        (402, level("fan", OK)),
        (412, None, "began flapping/intermittent r1 fan"),
    )


def test_a_value_and_a_check_are_parts():
    history(
        Can(CHARGE),
        (0, value(15.0)),
        (10, None, f"began {WORSE} charge"),
        (20, value(5.0)),
        (30, None, f"began {LOST} charge"),
        (40, value(50.0), f"recovered {WORSE} charge", f"recovered {LOST} charge"),
        (100, check(1, 2)),
        (110, None, f"began {LOST} charge"),
        (120, check(2, 2), f"recovered {LOST} charge"),
    )


def test_one_value_of_a_component_is_a_part():
    history(
        Can(WantedCapability("charge", AtLeast(None, (part("battery", key="charge"),)))),
        (0, level("battery", ERROR)),
        (10, None, "began component/critical r1 battery"),
        (20, value(5.0)),
        (30, None, f"began {LOST} charge"),
    )


def test_what_is_common_to_many_robots_is_no_fault_of_each():
    robots = [f"r{number}" for number in range(1, 6)]
    each = together(
        *(Can(VIEW, DRIVE, robot=robot)(level(MOTOR, ERROR, robot)) for robot in robots)
    )
    settings = FaultSettings(common=CauseSettings(5, 0.5))
    play(
        (0, each),
        (10, None, "began common/critical motor"),
        (300, None),
        robots=robots,
        settings=settings,
    )


def test_many_components_are_one_fault():
    parts = [f"part {number}" for number in range(12)]
    history(
        Can(*(WantedCapability(f"can {each}", AtLeast(None, (part(each),))) for each in parts)),
        (0, levels(parts, ERROR, total=12)),
        (10, None, "began robot/many r1 critical"),
        (300, None),
    )


def test_a_capability_that_is_no_longer_wanted_is_removed_and_its_parts_are_faults():
    play(
        (0, can(level(MOTOR, ERROR))),
        (10, None, f"began {LOST} drive"),
        (20, Can(VIEW)(), f"removed {LOST} drive", "began component/critical r1 motor"),
    )


def test_what_was_lost_for_parts_that_it_no_longer_needs_is_removed():
    found = player(["r1"], FaultSettings())
    found.go(READY, Can(VIEW)(levels([UPPER, LOWER], ERROR)))
    assert texts(found.go(READY + 10)) == [f"began {LOST} view"]
    other = VIEW._replace(need=AtLeast(1, (part(LEFT),)))
    parts = [f"began component/critical r1 {each}" for each in (LOWER, UPPER)]
    assert texts(found.go(READY + 20, Can(other)())) == [f"removed {LOST} view", *parts]


def test_what_was_lost_lasts_where_a_new_process_knows_no_part_yet():
    found = player(["r1"], FaultSettings())
    found.go(READY, Can(VIEW)(levels([UPPER, LOWER], ERROR)))
    assert texts(found.go(READY + 10)) == [f"began {LOST} view"]
    found.reborn(READY + 20)
    unknown = VIEW._replace(need=AtLeast(1, (MISSING,)))
    assert texts(found.go(READY + 20, Can(unknown)())) == []


def test_a_condition_that_is_not_known_holds_and_one_that_does_not_hold_ends():
    lift = WantedCapability("lift", AtLeast(None, (part("lift"),)))
    play(
        (0, Can(lift)(level("lift", ERROR))),
        (10, None, f"began {LOST} lift"),
        (20, Can(lift._replace(applies=None))()),
        (30, Can(lift._replace(applies=False))(), f"recovered {LOST} lift"),
        (60, None, "began component/critical r1 lift"),
    )
    last = play(
        (0, Can(lift._replace(applies=None))(level("lift", ERROR))),
        (10, None, "began component/critical r1 lift"),
    )
    assert last.faults.capabilities("r1")["lift"].state is CapabilityState.UNKNOWN


@pytest.mark.parametrize(
    ("need", "expected"),
    [
        (AtLeast(None, (MISSING,)), CapabilityState.UNKNOWN),
        (AtLeast(None, (MISSING, part("lost"))), CapabilityState.LOST),
        (AtLeast(1, (MISSING, part("fine"))), CapabilityState.OK),
        (AtLeast(1, (MISSING, part("lost"))), CapabilityState.LOST),
        (AtLeast(2, (MISSING, part("fine"))), CapabilityState.UNKNOWN),
        (AtLeast(2, (part("fine"), part("bad"), part("lost"))), CapabilityState.DEGRADED),
        (AtLeast(2, (part("fine"), part("other"), part("lost"))), CapabilityState.NO_RESERVE),
        (AtLeast(1, (part("fine"), part("other"), part("lost"))), CapabilityState.OK),
        (AtLeast(1, (part("fine"), AtLeast(None, (MISSING,)))), CapabilityState.OK),
        (AtLeast(None, (part("fine"), AtLeast(1, (part("other"), part("lost"))))),
         CapabilityState.NO_RESERVE),
        (AtLeast(None, (part("bad"),), CapabilityState.OK), CapabilityState.OK),
        (AtLeast(None, (part("bad"),), CapabilityState.LOST), CapabilityState.LOST),
        (AtLeast(None, (part("bad"), AtLeast(1, (part("other"), part("lost")))),
                 CapabilityState.OK),
         CapabilityState.NO_RESERVE),
        (AtLeast(None, (part("fine"), MISSING), CapabilityState.LOST), CapabilityState.UNKNOWN),
        (AtLeast(1, (AtLeast(None, (part("bad"),), CapabilityState.LOST), part("fine"))),
         CapabilityState.NO_RESERVE),
    ],
)  # fmt: skip
def test_an_expression_is_as_good_as_the_kth_best(need, expected):
    last = play(
        (
            0,
            Can(WantedCapability("it", need))(
                level("lost", ERROR, confirm_after=99), level("bad", WARN)
            ),
        )
    )
    assert last.faults.capabilities("r1")["it"].state is expected
