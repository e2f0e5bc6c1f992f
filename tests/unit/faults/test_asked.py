"""What the engine says when it is asked: how good all parts are, and what ended a fault."""

from functools import partial

import pytest

from ros_diagnostics_exporter.config.fleet import CauseSettings, FaultSettings
from ros_diagnostics_exporter.faults.engine import Faults
from ros_diagnostics_exporter.faults.model import (
    CapabilityState,
    Change,
    PartName,
    Row,
)
from ros_diagnostics_exporter.faults.needs import AtLeast, Other, WantedCapability
from ros_diagnostics_exporter.faults.stored import parse
from ros_diagnostics_exporter.model import Instant
from support.fault_histories import (
    ERROR,
    OK,
    WARN,
    Event,
    FleetChange,
    Player,
    back,
    level,
    levels,
    maintenance,
    play,
    player,
    silent,
    texts,
    together,
    words,
)

ROBOTS = ("r1", "r2", "r3", "r4")
UPPER, LOWER, MOTOR = (PartName(component=each) for each in ("upper", "lower", "motor"))
VIEW = WantedCapability("view", AtLeast(1, (UPPER, LOWER)))
DRIVE = WantedCapability("drive", AtLeast(None, (Other("view"), MOTOR)))
CAN = {robot: PartName(robot=robot, check="drive") for robot in (*ROBOTS, "r9")}
TWO = WantedCapability("transport", AtLeast(2, tuple(CAN.values())))
ALL = WantedCapability("production", AtLeast(None, (Other("transport"), CAN["r1"])))


def configured(*events: Event) -> Event:
    """The events of a fleet whose robots can drive, and which transports with two of them."""

    def configure(faults: Faults, now: Instant) -> list[Change]:
        for robot in ROBOTS:
            assert faults.configure_capabilities(robot, [VIEW, DRIVE], now) == []
        changes = faults.components_in_maintenance("r1", frozenset({"motor"}), now)
        return changes + faults.configure_capabilities(None, [TWO, ALL], now)

    return together(configure, *events)


def test_how_good_all_parts_are_of_what_a_robot_and_the_fleet_can_do():
    last = player(ROBOTS, FaultSettings())
    broken = together(
        level("upper", ERROR),
        level("motor", WARN),
        levels(["upper", "lower"], ERROR, "r2"),
        maintenance("r3", planned=True),
        silent("r4"),
    )
    last.go(0, configured(broken))
    last.go(5)
    needs = last.faults.needs("r1")
    lidars = {UPPER: CapabilityState.LOST, LOWER: CapabilityState.OK}
    assert {name: (each.state, each.parts, each.maintained) for name, each in needs.items()} == {
        "view": (CapabilityState.NO_RESERVE, lidars, frozenset()),
        "drive": (CapabilityState.DEGRADED, {**lidars, MOTOR: CapabilityState.DEGRADED}, {MOTOR}),
    }
    assert [each.wanted for each in needs.values()] == [VIEW, DRIVE]
    unknown = last.faults.needs("r4")["drive"]
    assert {*unknown.parts.values()} == {CapabilityState.UNKNOWN}

    fleet = last.faults.needs(None)
    expected = (
        CapabilityState.DEGRADED,
        CapabilityState.LOST,
        CapabilityState.OK,
        CapabilityState.UNKNOWN,
        CapabilityState.UNKNOWN,
    )
    for name, wanted in (("transport", TWO), ("production", ALL)):
        view = fleet[name]
        assert view.wanted is wanted
        assert view.parts == dict(zip(CAN.values(), expected, strict=True))
        assert view.maintained == {CAN["r3"]}
    assert fleet["transport"].state is last.faults.needs(None)["production"].state


def test_only_the_message_of_an_end_that_is_kept_is_fixed():
    last = play(
        (0, level("motor", ERROR)),
        (10, None, "began component/critical r1 motor"),
        (20, level("motor", OK), "recovered component/critical r1 motor"),
    )
    (end,) = last.faults.ends()
    assert end.fault is not None
    last.faults.take_rows(last.at(20))
    last.faults.describe_end(end.fault, "well")
    assert [each.message for each in last.faults.ends()] == ["well"]
    assert [row.kind for row in last.faults.take_rows(last.at(20))] == ["end"]


def test_other_settings_are_judged_at_once():
    last = player(["r1"], FaultSettings())
    last.go(0, levels(["a", "b", "c"], ERROR, total=30))
    last.go(8, FleetChange(FaultSettings(many=CauseSettings(3, 0.0))))
    assert texts(last.go(18)) == ["began robot/many r1 critical"]


def test_of_a_robot_that_is_not_configured_there_is_nothing():
    with pytest.raises(LookupError, match="no robot 'r9' is configured"):
        player(["r1"], FaultSettings()).faults.needs("r9")


FLEET_ROW = ("fleet", [], {"settled_at": 1.0, "grace_until": None})


@pytest.mark.parametrize(
    ("stored", "wrong"),
    [
        ([FLEET_ROW], []),
        ([("fleets", [], {}), FLEET_ROW], ["fleets '': there are no rows of this kind"]),
        ([FLEET_ROW, 5, 6], ["a row of the faults: it: Input should be a valid tuple"] * 2),
        (
            [FLEET_ROW, ("capability", ("r1", "view"), {"parts": [], "worst": 5})],
            ["capability 'r1 view': worst: Input should be 0, 1, 2, 3 or 4"],
        ),
    ],
)
def test_rows_that_cannot_be_restored_are_named_and_the_others_kept(stored, wrong):
    assert parse(stored) == ([Row("fleet", (), FLEET_ROW[2])], wrong)


@pytest.mark.parametrize(
    ("moment", "is_valid"), [(-1e11, True), (1e11, True), (1.1e11, False), (float("nan"), False)]
)
def test_a_time_is_within_its_limits(moment, is_valid):
    rows, text = parse([("fleet", [], {**FLEET_ROW[2], "settled_at": moment})])
    assert (bool(rows), bool(text)) == (is_valid, not is_valid)


def members_of(asked: Player) -> dict[str, list[str]]:
    """The members of each fault that has some, by its words."""
    found = {
        words(fault.identity): sorted(
            " ".join(filter(None, (robot, *component)))
            for robot, component in asked.faults.members(fault.identity)
        )
        for fault in asked.faults.faults()
    }
    return {fault: members for fault, members in found.items() if members}


def test_a_silent_site_and_a_common_fault_have_just_the_robots_that_they_count_as_members():
    """What is STALE because its robot is silent is not what the others have in common."""
    camera = partial(levels, ["camera"], group="/front")
    robots = [f"r{n}" for n in range(12)]
    last = player(robots, FaultSettings())
    last.go(0, together(*(silent(robot) for robot in robots[:6])))
    last.go(20, together(*(camera(ERROR, robot) for robot in robots[6:11])))
    last.go(40)
    site, common = "site/silent", "common/critical camera"
    assert members_of(last) == {
        site: robots[:6],
        common: sorted(f"{robot} /front camera" for robot in robots[6:11]),
    }

    last.go(50, camera(OK, "r6"), back("r0"))
    last.go(60, silent("r9"))  # it was CRITICAL when it was last received
    assert members_of(last) == {
        site: [*robots[1:6], "r9"],
        common: sorted(f"{robot} /front camera" for robot in robots[7:11]),
    }


def test_a_capability_has_the_parts_that_keep_it_from_being_ok_as_members():
    last = player(ROBOTS, FaultSettings())
    last.go(0, configured(*(levels(["upper", "lower"], ERROR, robot) for robot in ROBOTS[:3])))
    last.go(20)
    fleet, view = "capability/lost transport", "capability/lost {} view"
    assert members_of(last) == {
        view.format("r1"): ["r1 lower", "r1 upper"],
        view.format("r2"): ["r2 lower", "r2 upper"],
        view.format("r3"): ["r3 lower", "r3 upper"],
        fleet: ["r1", "r2", "r3"],
        "capability/lost production": ["r1", "r2", "r3"],
    }

    last.go(30, levels(["upper", "lower"], OK))
    last.go(50)
    assert view.format("r1") not in members_of(last)
