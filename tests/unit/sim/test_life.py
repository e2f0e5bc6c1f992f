"""What can happen to a whole robot, as it shows in its messages and in the ROS graph."""

from __future__ import annotations

import itertools

import pytest

from support.simulated_fleet import fleet_of, number_of, of
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.kinds import kind_path
from virtual_robots.simulation.life import LEASE, Order, order
from virtual_robots.simulation.members import Happening, Presence, RobotSpec, Topic


def told(fleet: Fleet, before: float, wanted: Order, after: float) -> list[Happening]:
    """The story from the order on."""
    list(fleet.advance(before))
    now = list(order(fleet, "robot_1", wanted))
    return now + list(fleet.advance(before + after))


def presences(story: list[Happening]) -> list[tuple[float, bool]]:
    return [(round(p.at, 3), p.present) for p in story if isinstance(p, Presence)]


def silence(story: list[Happening], start: float, end: float) -> float:
    """The longest time without a raw message."""
    times = [start, *(m.at for m in of(story, Topic.RAW)), end]
    return max(b - a for a, b in itertools.pairwise(times))


def test_a_robot_that_leaves_says_goodbye_and_is_silent() -> None:
    story = told(fleet_of(), 10.0, Order("leave"), 60.0)
    assert presences(story) == [(10.0, False)]
    assert of(story, Topic.RAW) == of(story, Topic.AGGREGATED) == []


def test_a_robot_that_is_absent_is_there_when_it_joins() -> None:
    fleet = Fleet([RobotSpec("robot_1", kind_path("thesis"), absent=True)])
    assert list(fleet.advance(10.0)) == []
    list(order(fleet, "robot_1", Order("join")))
    story = list(fleet.advance(20.0))
    assert presences(story) == [(10.0, True)]
    assert of(story, Topic.RAW)[0].statuses[0].message == "Node starting up"


def test_a_crash_says_no_goodbye_until_the_lease_is_over() -> None:
    story = told(fleet_of(), 10.0, Order("crash"), 60.0)
    assert of(story, Topic.RAW) == of(story, Topic.AGGREGATED) == []
    assert presences(story) == [(10.0 + LEASE, False)]


def test_a_crashed_robot_that_is_back_within_the_lease_never_leaves_the_graph() -> None:
    story = told(fleet_of(), 10.0, Order("crash", length=5.0), 60.0)
    assert presences(story) == []
    assert number_of(of(story, Topic.RAW)[0]) == 1


def test_a_robot_that_hangs_stays_in_the_graph_and_goes_on_where_it_was() -> None:
    fleet = fleet_of()
    last = number_of(of(fleet.advance(10.0), Topic.RAW)[-1])
    story = told(fleet, 10.0, Order("hang", length=30.0), 60.0)
    assert presences(story) == []
    assert silence(story, 10.0, 70.0) == pytest.approx(30.0, abs=1.5)
    assert number_of(of(story, Topic.RAW)[0]) == last + 1


def test_a_reboot_begins_with_a_node_that_starts_up_and_a_tree_without_components() -> None:
    story = told(fleet_of(), 10.0, Order("reboot", length=8.0), 30.0)
    assert presences(story) == [(10.0, False), (18.0, True)]
    first = of(story, Topic.RAW)[0]
    assert {(s.message, s.hardware_id) for s in first.statuses} == {("Node starting up", "")}
    assert number_of(first) == 1
    assert all(s.message == "Stale" for s in of(story, Topic.AGGREGATED)[0].statuses)


def test_messages_that_a_lost_network_swallows_are_missing_in_the_numbers() -> None:
    fleet = fleet_of()
    last = number_of(of(fleet.advance(10.0), Topic.RAW)[-1])
    story = told(fleet, 10.0, Order("network_loss", length=7.0), 20.0)
    assert number_of(of(story, Topic.RAW)[0]) == last + 8
    assert presences(story) == []


def test_a_network_that_is_lost_for_longer_than_the_lease_takes_the_robot_out_of_the_graph() -> (
    None
):
    story = told(fleet_of(), 10.0, Order("network_loss", length=50.0), 80.0)
    assert presences(story) == [(10.0 + LEASE, False), (60.0, True)]


def test_a_flapping_network_comes_and_goes_and_is_there_at_the_end() -> None:
    fleet = fleet_of()
    story = told(fleet, 10.0, Order("flap", length=40.0, period=5.0), 60.0)
    seconds = {int(m.at) for m in of(story, Topic.RAW)}
    assert seconds & set(range(11, 15)) == set()
    assert seconds & set(range(16, 20)) != set()
    assert seconds & set(range(21, 25)) == set()
    assert set(range(52, 69)) <= seconds


def test_a_clock_jump_moves_the_stamps_only() -> None:
    story = told(fleet_of(), 10.0, Order("clock_jump", by=-3600.0, length=10.0), 30.0)
    for topic in (Topic.RAW, Topic.AGGREGATED):
        offsets = {(m.at < 20.0, round(m.stamp - m.at)) for m in of(story, topic)}
        assert offsets == {(True, -3600), (False, 0)}


def test_a_flood_is_many_messages_and_ends() -> None:
    story = told(fleet_of(), 10.0, Order("flood", rate=50.0, length=5.0), 20.0)
    raw = of(story, Topic.RAW)
    flooded = [m for m in raw if m.at < 15.0]
    assert 190 <= len(flooded) <= 250
    assert 13 <= len(raw) - len(flooded) <= 16


def test_a_robot_that_already_runs_cannot_be_doubled() -> None:
    story = told(fleet_of(), 10.0, Order("join"), 10.0)
    assert len(of(story, Topic.RAW)) == 10
    story = told(fleet_of(), 10.0, Order("resume"), 10.0)
    assert len(of(story, Topic.RAW)) == 10


def test_a_robot_that_is_stopped_before_it_is_back_stays_away() -> None:
    fleet = fleet_of()
    told(fleet, 10.0, Order("crash", length=20.0), 5.0)
    story = told(fleet, 15.0, Order("leave"), 60.0)
    assert of(story, Topic.RAW) == []


def test_the_other_robots_go_on() -> None:
    story = told(fleet_of(robots=2), 10.0, Order("crash"), 20.0)
    assert len(of(story, Topic.RAW, "robot_2")) == 20


@pytest.mark.parametrize(
    ("first", "second", "silent"),
    [
        (Order("network_loss", length=10.0), Order("network_loss"), True),
        (Order("flap", length=10.0, period=2.0), Order("network_loss"), True),
        (Order("flap", length=10.0, period=2.0), Order("network_back"), False),
        (Order("hang", length=10.0), Order("hang"), True),
        (Order("leave", length=10.0), Order("leave"), True),
        (Order("network_loss", length=10.0), Order("network_loss", length=4.0), False),
    ],
)
def test_the_end_of_an_order_does_not_end_a_later_one(
    first: Order, second: Order, silent: bool
) -> None:
    fleet = fleet_of()
    told(fleet, 5.0, first, 3.0)
    told(fleet, 8.0, second, 4.5)
    heard = of(fleet.advance(60.0), Topic.RAW)
    assert (not heard) is silent
    assert silent or number_of(heard[-1]) - number_of(heard[0]) == len(heard) - 1


def test_the_end_of_a_flood_does_not_end_a_later_one() -> None:
    fleet = fleet_of()
    told(fleet, 5.0, Order("flood", rate=50.0, length=10.0), 3.0)
    told(fleet, 8.0, Order("flood", rate=20.0), 10.0)
    assert 190 <= len(of(fleet.advance(28.0), Topic.RAW)) <= 210


def test_a_network_flaps_no_longer_than_it_was_ordered_to() -> None:
    """Less than a period is left: it does not last for a whole one."""
    story = told(fleet_of(), 10.0, Order("flap", length=3.0, period=30.0), 10.0)
    assert silence(story, 10.0, 20.0) == pytest.approx(3.0, abs=1.1)
