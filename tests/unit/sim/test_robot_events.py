"""What can happen to a whole robot, as it shows in its messages and in the ROS graph."""

import itertools

import pytest

from support.simulated_fleet import fleet_of, number_of, of
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.outputs import Output, Presence, Topic
from virtual_robots.simulation.robot_events import LEASE, RobotEvent, trigger


def outputs_of(fleet: Fleet, before: float, wanted: RobotEvent, after: float) -> list[Output]:
    """The outputs from the event on."""
    list(fleet.advance(before))
    now = list(trigger(fleet, "robot_1", wanted))
    return now + list(fleet.advance(before + after))


def presences(outputs: list[Output]) -> list[tuple[float, bool]]:
    return [(round(p.at, 3), p.present) for p in outputs if isinstance(p, Presence)]


def silence(outputs: list[Output], start: float, end: float) -> float:
    """The longest time without a raw message."""
    times = [start, *(m.at for m in of(outputs, Topic.RAW)), end]
    return max(b - a for a, b in itertools.pairwise(times))


def test_a_robot_that_leaves_says_goodbye_and_is_silent() -> None:
    outputs = outputs_of(fleet_of(), 10.0, RobotEvent("leave"), 60.0)
    assert presences(outputs) == [(10.0, False)]
    assert of(outputs, Topic.RAW) == of(outputs, Topic.AGGREGATED) == []


def test_a_crash_says_no_goodbye_until_the_lease_is_over() -> None:
    outputs = outputs_of(fleet_of(), 10.0, RobotEvent("crash"), 60.0)
    assert of(outputs, Topic.RAW) == of(outputs, Topic.AGGREGATED) == []
    assert presences(outputs) == [(10.0 + LEASE, False)]


def test_a_crashed_robot_that_is_back_within_the_lease_never_leaves_the_graph() -> None:
    outputs = outputs_of(fleet_of(), 10.0, RobotEvent("crash", length=5.0), 60.0)
    assert presences(outputs) == []
    assert number_of(of(outputs, Topic.RAW)[0]) == 1


def test_a_robot_that_hangs_stays_in_the_graph_and_goes_on_where_it_was() -> None:
    fleet = fleet_of()
    last = number_of(of(fleet.advance(10.0), Topic.RAW)[-1])
    outputs = outputs_of(fleet, 10.0, RobotEvent("hang", length=30.0), 60.0)
    assert presences(outputs) == []
    assert silence(outputs, 10.0, 70.0) == pytest.approx(30.0, abs=1.5)
    assert number_of(of(outputs, Topic.RAW)[0]) == last + 1


def test_a_reboot_begins_with_a_node_that_starts_up_and_a_tree_without_components() -> None:
    outputs = outputs_of(fleet_of(), 10.0, RobotEvent("reboot", length=8.0), 30.0)
    assert presences(outputs) == [(10.0, False), (18.0, True)]
    first = of(outputs, Topic.RAW)[0]
    assert {(s.message, s.hardware_id) for s in first.statuses} == {("Node starting up", "")}
    assert number_of(first) == 1
    assert all(s.message == "Stale" for s in of(outputs, Topic.AGGREGATED)[0].statuses)


def test_messages_that_a_lost_network_swallows_are_missing_in_the_numbers() -> None:
    fleet = fleet_of()
    last = number_of(of(fleet.advance(10.0), Topic.RAW)[-1])
    outputs = outputs_of(fleet, 10.0, RobotEvent("network_loss", length=7.0), 20.0)
    assert number_of(of(outputs, Topic.RAW)[0]) == last + 8
    assert presences(outputs) == []


def test_a_network_that_is_lost_for_longer_than_the_lease_takes_the_robot_out_of_the_graph():
    outputs = outputs_of(fleet_of(), 10.0, RobotEvent("network_loss", length=50.0), 80.0)
    assert presences(outputs) == [(10.0 + LEASE, False), (60.0, True)]


def test_a_flapping_network_comes_and_goes_and_is_there_at_the_end() -> None:
    fleet = fleet_of()
    outputs = outputs_of(fleet, 10.0, RobotEvent("flap", length=40.0, period=5.0), 60.0)
    seconds = {int(m.at) for m in of(outputs, Topic.RAW)}
    assert seconds & set(range(11, 15)) == set()
    assert seconds & set(range(16, 20)) != set()
    assert seconds & set(range(21, 25)) == set()
    assert set(range(52, 69)) <= seconds


def test_a_clock_jump_moves_the_stamps_only() -> None:
    outputs = outputs_of(fleet_of(), 10.0, RobotEvent("clock_jump", by=-3600.0, length=10.0), 30.0)
    for topic in (Topic.RAW, Topic.AGGREGATED):
        offsets = {(m.at < 20.0, round(m.stamp - m.at)) for m in of(outputs, topic)}
        assert offsets == {(True, -3600), (False, 0)}


def test_a_flood_is_many_messages_and_ends() -> None:
    outputs = outputs_of(fleet_of(), 10.0, RobotEvent("flood", rate=50.0, length=5.0), 20.0)
    raw = of(outputs, Topic.RAW)
    flooded = [m for m in raw if m.at < 15.0]
    assert 190 <= len(flooded) <= 250
    assert 13 <= len(raw) - len(flooded) <= 16


def test_a_robot_that_already_runs_cannot_be_doubled() -> None:
    outputs = outputs_of(fleet_of(), 10.0, RobotEvent("join"), 10.0)
    assert len(of(outputs, Topic.RAW)) == 10
    outputs = outputs_of(fleet_of(), 10.0, RobotEvent("resume"), 10.0)
    assert len(of(outputs, Topic.RAW)) == 10


@pytest.mark.parametrize(
    ("first", "second", "silent"),
    [
        (RobotEvent("network_loss", length=10.0), RobotEvent("network_loss"), True),
        (RobotEvent("flap", length=10.0, period=2.0), RobotEvent("network_loss"), True),
        (RobotEvent("flap", length=10.0, period=2.0), RobotEvent("network_back"), False),
        (RobotEvent("hang", length=10.0), RobotEvent("hang"), True),
        (RobotEvent("leave", length=10.0), RobotEvent("leave"), True),
        (RobotEvent("crash", length=20.0), RobotEvent("leave"), True),
        (RobotEvent("network_loss", length=10.0), RobotEvent("network_loss", length=4.0), False),
    ],
)
def test_the_end_of_an_order_does_not_end_a_later_one(first, second, silent):
    fleet = fleet_of()
    outputs_of(fleet, 5.0, first, 3.0)
    outputs_of(fleet, 8.0, second, 4.5)
    received = of(fleet.advance(60.0), Topic.RAW)
    assert (not received) is silent
    assert silent or number_of(received[-1]) - number_of(received[0]) == len(received) - 1


def test_the_end_of_a_flood_does_not_end_a_later_one() -> None:
    fleet = fleet_of()
    outputs_of(fleet, 5.0, RobotEvent("flood", rate=50.0, length=10.0), 3.0)
    outputs_of(fleet, 8.0, RobotEvent("flood", rate=20.0), 10.0)
    assert 190 <= len(of(fleet.advance(28.0), Topic.RAW)) <= 210


def test_a_network_flaps_no_longer_than_it_was_ordered_to() -> None:
    """Less than a period is left: it does not last for a whole one."""
    outputs = outputs_of(fleet_of(), 10.0, RobotEvent("flap", length=3.0, period=30.0), 10.0)
    assert silence(outputs, 10.0, 20.0) == pytest.approx(3.0, abs=1.1)
