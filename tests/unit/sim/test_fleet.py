"""What a fleet publishes, on its own clock."""

from itertools import pairwise

import pytest

from support.simulated_fleet import fleet_of, level_of, number_of, of
from virtual_robots.model import ERROR, OK, STALE
from virtual_robots.simulation.components import Fault, UnknownFaultError
from virtual_robots.simulation.outputs import Topic

COMPONENTS = [
    "Motor 1", "Motor 2", "Motor 3", "Sensor 1", "Sensor 2",
    "Laser 1", "Laser 2", "Cam 1", "Robot Battery", "Laptop Battery",
]  # fmt: skip
GROUPS = {"Camera": 1, "Laser": 2, "Motor": 3, "Power": 2, "Temp": 2}


def test_each_robot_publishes_the_ten_components_once_a_second() -> None:
    messages = list(fleet_of(robots=3).advance(10.0))
    for robot in ("robot_1", "robot_2", "robot_3"):
        raw = of(messages, Topic.RAW, robot)
        assert len(raw) in {9, 10}
        assert all([s.name for s in m.statuses] == COMPONENTS for m in raw)
        assert all(b.at - a.at == pytest.approx(1.0) for a, b in pairwise(raw))


def test_the_aggregated_tree_has_the_five_groups_and_nothing_in_other() -> None:
    last = of(list(fleet_of().advance(5.0)), Topic.AGGREGATED)[-1]
    parents = [s.name for s in last.statuses if s.name.count("/") == 1]
    assert parents == [f"/{group}" for group in GROUPS]
    for group, size in GROUPS.items():
        assert sum(s.name.startswith(f"/{group}/") for s in last.statuses) == size
    assert {s.level for s in last.statuses} == {OK}


def test_the_first_array_after_a_start_says_that_the_node_is_starting_up() -> None:
    first, second, *_ = of(list(fleet_of().advance(5.0)), Topic.RAW)
    assert {(s.level, s.message, s.hardware_id) for s in first.statuses} == {
        (OK, "Node starting up", "")
    }
    assert second.statuses[0].hardware_id == "mc-01"


def test_every_array_carries_its_number_so_that_losses_can_be_counted() -> None:
    for topic in (Topic.RAW, Topic.AGGREGATED):
        messages = of(list(fleet_of().advance(9.0)), topic)[1:]
        numbers = [number_of(message) for message in messages]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def test_an_injected_error_shows_raw_and_aggregated_until_it_is_repaired() -> None:
    fleet = fleet_of(robots=2)
    list(fleet.advance(3.0))
    fleet.inject("robot_1", "Motor 2", Fault("error", fleet.now, "Over temperature"))
    broken = list(fleet.advance(6.0))
    fleet.inject("robot_1", "Motor 2", None)
    repaired = list(fleet.advance(9.0))
    assert level_of(of(broken, Topic.RAW)[-1], "Motor 2") == ERROR
    assert level_of(of(broken, Topic.AGGREGATED)[-1], "/Motor/Motor 2") == ERROR
    assert level_of(of(broken, Topic.AGGREGATED)[-1], "/Motor") == ERROR
    assert of(broken, Topic.TOPLEVEL)[-1].statuses[0].message == "/Motor/Motor 2: Over temperature"
    assert level_of(of(broken, Topic.AGGREGATED, "robot_2")[-1], "/Motor") == OK
    assert level_of(of(repaired, Topic.AGGREGATED)[-1], "/Motor") == OK


def test_a_silent_component_becomes_stale_in_the_tree_after_the_timeout() -> None:
    fleet = fleet_of()
    list(fleet.advance(3.0))
    fleet.inject("robot_1", "Laser 2", Fault("silent", fleet.now))
    messages = list(fleet.advance(12.0))
    assert "Laser 2" not in {s.name for s in of(messages, Topic.RAW)[-1].statuses}
    levels = [level_of(m, "/Laser/Laser 2") for m in of(messages, Topic.AGGREGATED)]
    assert levels[0] == OK
    assert levels[-1] == STALE


def test_an_unknown_robot_component_or_fault_is_rejected_with_the_known_ones() -> None:
    fleet = fleet_of()
    with pytest.raises(KeyError, match=r"no robot 'r9', only robot_1"):
        fleet.inject("r9", "Motor 1", None)
    with pytest.raises(KeyError, match=r"no component 'Motor 9', only Motor 1, Motor 2"):
        fleet.inject("robot_1", "Motor 9", None)
    with pytest.raises(UnknownFaultError, match=r"no fault 'broken', only ok, warn, error"):
        fleet.inject("robot_1", "Motor 1", Fault("broken", 0.0))
