"""What a fleet publishes, on its own clock."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import pytest

from support.simulated_fleet import fleet_of, level_of, number_of, of
from virtual_robots.model import ERROR, OK, STALE
from virtual_robots.simulation.components import Fault, UnknownFaultError
from virtual_robots.simulation.outputs import Message, Output, Topic

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


def test_the_batteries_carry_their_level() -> None:
    last = of(list(fleet_of().advance(3.0)), Topic.RAW)[-1]
    batteries = [s for s in last.statuses if "Battery" in s.name]
    assert [[key for key, _ in s.values] for s in batteries] == [["Level"], ["Level"]]
    assert all(0 <= float(value) <= 100 for s in batteries for _, value in s.values)


def test_the_aggregated_tree_has_the_five_groups_and_nothing_in_other() -> None:
    last = of(list(fleet_of().advance(5.0)), Topic.AGGREGATED)[-1]
    parents = [s.name for s in last.statuses if s.name.count("/") == 1]
    assert parents == [f"/{group}" for group in GROUPS]
    for group, size in GROUPS.items():
        assert sum(s.name.startswith(f"/{group}/") for s in last.statuses) == size
    assert {s.level for s in last.statuses} == {OK}


def test_the_first_aggregated_array_is_from_before_any_input() -> None:
    first = of(list(fleet_of().advance(5.0)), Topic.AGGREGATED)[0]
    assert [(s.name, s.level) for s in first.statuses] == [(f"/{g}", STALE) for g in GROUPS]


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


def test_the_seed_determines_the_outputs() -> None:
    def outputs(seed: int) -> list[Output]:
        return list(fleet_of(robots=3, seed=seed).advance(20.0))

    assert outputs(1) == outputs(1)
    assert outputs(1) != outputs(2)


def test_an_unknown_robot_component_or_fault_is_rejected_with_the_known_ones() -> None:
    fleet = fleet_of()
    with pytest.raises(KeyError, match=r"no robot 'r9', only robot_1"):
        fleet.inject("r9", "Motor 1", None)
    with pytest.raises(KeyError, match=r"no component 'Motor 9', only Motor 1, Motor 2"):
        fleet.inject("robot_1", "Motor 9", None)
    with pytest.raises(UnknownFaultError, match=r"no fault 'broken', only ok, warn, error"):
        fleet.inject("robot_1", "Motor 1", Fault("broken", 0.0))


def test_a_thousand_robots_each_publish_once_a_second() -> None:
    fleet = fleet_of(robots=1000)
    list(fleet.advance(2.0))
    messages = [m for m in fleet.advance(5.0) if isinstance(m, Message)]
    counts = Counter((m.robot, m.topic) for m in messages)
    assert len(counts) == 3000
    assert set(counts.values()) == {3}
