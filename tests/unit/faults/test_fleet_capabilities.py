"""What the fleet can do: as many robots as can it, or may not be known to."""

import pytest

from ros_diagnostics_exporter.config.fleet import FaultSettings
from ros_diagnostics_exporter.faults.engine import Faults
from ros_diagnostics_exporter.faults.model import Change, Fault, Identity, PartName, Scope, State
from ros_diagnostics_exporter.faults.needs import MISSING, AtLeast, WantedCapability
from ros_diagnostics_exporter.model import Instant
from support.fault_histories import (
    ERROR,
    OK,
    STALE,
    WALL,
    Event,
    Player,
    back,
    level,
    maintenance,
    play,
    player,
    restart,
    robot_settings,
    silent,
    texts,
    together,
    unreachable,
)

ROBOTS = ("r1", "r2", "r3")
LIFT = WantedCapability("lift", AtLeast(None, (PartName(component="lift"),)))
PARTLY = LIFT._replace(need=AtLeast(None, (PartName(component="lift"), MISSING)))
TWO = AtLeast(2, tuple(PartName(robot=robot, check="lift") for robot in ROBOTS))
BOTH = ("r1 lift", "r2 lift")
LOST, SPARE = "capability/lost lifting", "capability/no_reserve lifting"


def hall(*events: Event, lift: WantedCapability = LIFT) -> Event:
    """The events, with what robots and fleet can do, as it is configured after each start."""

    def configure(faults: Faults, now: Instant) -> list[Change]:
        for robot in ROBOTS:
            faults.configure_capabilities(robot, [lift], now)
        return faults.configure_capabilities(None, [WantedCapability("lifting", TWO)], now)

    return together(configure, *events)


def test_it_is_lost_with_more_robots_than_it_can_do_without():
    play(
        (0, hall(level("lift", ERROR, "r1"))),
        (9, None),
        (10, None, "began capability/lost r1 lift", f"began {SPARE}"),
        (20, hall(level("lift", ERROR, "r2"))),
        (30, None, f"began {LOST}", "began capability/lost r2 lift"),
        (50, hall(maintenance("r2", planned=True))),
        (60, hall(level("lift", OK, "r2"))),
        (70, hall(maintenance("r2", planned=False)), "recovered capability/lost r2 lift"),
        (75, None, f"recovered {LOST}"),
        (80, hall(level("lift", OK, "r1")), "recovered capability/lost r1 lift"),
        (85, None, f"recovered {SPARE}"),
        robots=ROBOTS,
    )


def test_a_robot_in_maintenance_is_left_out_unless_it_is_a_part_of_what_is_lost():
    play(
        (0, hall(maintenance("r1", planned=True), level("lift", ERROR, "r1"))),
        (20, hall(level("lift", ERROR, "r2"))),
        (30, None, f"began {LOST}", "began capability/lost r2 lift"),
        (40, hall(maintenance("r2", planned=True))),
        (50, hall(level("lift", OK, "r2"))),
        (55, None),
        robots=ROBOTS,
    )


def test_a_robot_that_is_not_reached_is_no_reserve_that_is_missing():
    play(
        (0, hall(unreachable("r1", is_so=True), silent("r1"))),
        (300, None),
        robots=ROBOTS,
    )


def test_silence_is_a_reserve_that_is_missing_and_no_loss_nor_recovery():
    play(
        (0, hall(silent("r1"))),
        (10, None, f"began {SPARE}", "began robot/silent r1"),
        (20, hall(silent("r2"), silent("r3"))),
        (30, None, "began robot/silent r2", "began robot/silent r3"),
        (100, hall(back("r1")), "recovered robot/silent r1"),
        (150, hall(back("r2")), "recovered robot/silent r2"),
        (200, hall(back("r3")), "recovered robot/silent r3"),
        (250, None, f"recovered {SPARE}"),
        robots=ROBOTS,
    )


@pytest.mark.parametrize(("lift", "second"), [(LIFT, 59), (PARTLY, 60)], ids=["all", "partly"])
def test_what_was_adopted_lasts_until_robots_had_time_to_be_received(lift, second):
    of_fleet = Identity(Scope.CAPABILITY, State.LOST, check="lifting")
    of_robot = Identity(Scope.CAPABILITY, State.LOST, robot="r1", check="lift")
    last = Player(FaultSettings(restart_grace=60.0))
    last.go(0, restart(), *map(robot_settings, ROBOTS), hall(lift=lift))
    for identity in (of_fleet, of_robot):
        fault = Fault(identity, WALL - 1_000, WALL - 990, {}, "")
        assert len(last.go(1, lambda faults, now, fault=fault: faults.adopt(fault, now))) == 1

    received = [back(robot, level("lift", OK, robot)) for robot in ROBOTS]
    assert last.go(5, hall(*received, lift=lift)) == []
    assert texts(last.go(second)) == ["recovered capability/lost r1 lift"]
    assert texts(last.go(70)) == [f"recovered {LOST}"]


def test_it_outlives_a_restart_while_a_robot_is_not_reached():
    """When that is a missing reserve is never, which no row had: once it was dropped."""
    last = player(ROBOTS, FaultSettings())
    last.go(0, hall(level("lift", ERROR, "r1")))
    assert f"began {SPARE}" in texts(last.go(10))
    last.go(20, hall(unreachable("r2", is_so=True), silent("r2"), level("lift", OK, "r1")))
    last.go(25)
    last.reborn(30)
    last.go(31, hall(unreachable("r2", is_so=True)))
    assert texts(last.go(300)) == []


def test_it_is_back_when_its_robots_are_but_for_a_part_that_was_never_received():
    play(
        (0, hall(level("lift", ERROR, "r1"), level("lift", ERROR, "r2"), lift=PARTLY)),
        (9, None),
        (10, None, f"began {LOST}", *(f"began capability/lost {each}" for each in BOTH)),
        (20, hall(level("lift", STALE, "r1"), level("lift", STALE, "r2"), lift=PARTLY)),
        (30, hall(level("lift", OK, "r1"), lift=PARTLY), "recovered capability/lost r1 lift"),
        (35, None),  # nothing is known of r2
        (40, hall(level("lift", OK, "r2"), lift=PARTLY), "recovered capability/lost r2 lift"),
        (45, None, f"recovered {LOST}"),
        robots=ROBOTS,
    )
