"""What the engine says when it is asked: how good all parts are, and what ended a fault."""

from __future__ import annotations

import pytest

from ros_diagnostics_exporter.config.fleet import CauseSettings, FaultSettings
from ros_diagnostics_exporter.faults.engine import Faults
from ros_diagnostics_exporter.faults.model import Ability, Change, ComponentName, PartName, Row
from ros_diagnostics_exporter.faults.needs import AtLeast, Other, WantedCapability
from ros_diagnostics_exporter.faults.stored import parse
from ros_diagnostics_exporter.model import Instant
from support.fault_histories import (
    ERROR,
    OK,
    WARN,
    Event,
    FleetChange,
    level,
    levels,
    maintenance,
    play,
    player,
    silent,
    texts,
    together,
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
        return changes + faults.configure_fleet([TWO, ALL], now)

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
    lidars = {UPPER: Ability.LOST, LOWER: Ability.OK}
    assert {name: (each.ability, each.parts, each.maintained) for name, each in needs.items()} == {
        "view": (Ability.NO_RESERVE, lidars, frozenset()),
        "drive": (Ability.DEGRADED, {**lidars, MOTOR: Ability.DEGRADED}, {MOTOR}),
    }
    assert [each.wanted for each in needs.values()] == [VIEW, DRIVE]
    unknown = last.faults.needs("r4")["drive"]
    assert {*unknown.parts.values()} == {Ability.UNKNOWN}

    fleet = last.faults.fleet_needs()
    expected = (Ability.DEGRADED, Ability.LOST, Ability.OK, Ability.UNKNOWN, Ability.UNKNOWN)
    for name, wanted in (("transport", TWO), ("production", ALL)):
        view = fleet[name]
        assert view.wanted is wanted
        assert view.parts == dict(zip(CAN.values(), expected, strict=True))
        assert view.maintained == {CAN["r3"]}
    assert fleet["transport"].ability is last.faults.fleet_needs()["production"].ability


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
    assert player(["r1"], FaultSettings()).faults.component_names("r1") == list[ComponentName]()


OF_CAPABILITY = ("capability", ("r1", "view"))
WELL: dict[str, object] = {"active": None, "covers_until": None, "parts": []}
FLEET_ROW = ("fleet", [], {"settled_at": 1.0, "grace_until": None})


@pytest.mark.parametrize(
    ("stored", "wrong"),
    [
        ([FLEET_ROW], []),
        ([("fleets", [], {}), FLEET_ROW], ["fleets '': there are no rows of this kind"]),
        ([FLEET_ROW, ("fleet", [], {"settled_at": 1.0})], ["fleet '': grace_until: "]),
        ([5, FLEET_ROW, 6], ["a row of the faults: ", "a row of the faults: "]),
        ([FLEET_ROW, (*OF_CAPABILITY, {**WELL, "worst": 5})], ["capability 'r1 view': worst: "]),
    ],
)
def test_rows_that_are_not_valid_are_named_and_the_others_kept(stored, wrong):
    rows, texts = parse(stored)
    assert rows == [Row("fleet", (), FLEET_ROW[2])]
    assert [text[: len(start)] for text, start in zip(texts, wrong, strict=True)] == wrong


@pytest.mark.parametrize(
    ("moment", "is_valid"), [(-1e11, True), (1e11, True), (1.1e11, False), (float("nan"), False)]
)
def test_a_time_is_within_its_limits(moment, is_valid):
    rows, texts = parse([("fleet", [], {**FLEET_ROW[2], "settled_at": moment})])
    assert (bool(rows), bool(texts)) == (is_valid, not is_valid)
