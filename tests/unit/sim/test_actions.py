"""The goals of a virtual robot's actions: when each begins, and how it ends."""

from random import Random

import pytest

from support.simulated_fleet import fleet_of
from virtual_robots.schema.actions import ActionModel
from virtual_robots.schema.documents import DocumentError
from virtual_robots.simulation.actions import Action, Step
from virtual_robots.simulation.components import Fault, UnknownFaultError
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.kinds import load_kind
from virtual_robots.simulation.outputs import GoalStep, Presence
from virtual_robots.simulation.robot_events import RobotEvent, trigger

LIDAR = "turtlebot4_diagnostics: /scan topic status"
NAVIGATE = "navigate_to_pose"


def steps(fleet: Fleet, until: float) -> list[str]:
    """What happens to the actions of the fleet."""
    return [each.step.value for each in fleet.advance(until) if isinstance(each, GoalStep)]


def ended(fleet: Fleet, until: float) -> list[str]:
    return [each for each in steps(fleet, until) if each != "begin"]


@pytest.fixture
def fleet() -> Fleet:
    fleet = fleet_of("turtlebot4")
    assert steps(fleet, 2.0) == ["start"]
    return fleet


def test_goals_begin_and_succeed_in_turns(fleet):
    found = steps(fleet, 100.0)
    assert len(found) > 15
    assert set(found[::2]) == {"begin"}
    assert set(found[1::2]) == {"succeed"}


@pytest.mark.parametrize(
    ("what", "result"), [("abort", "abort"), ("cancel", "cancel"), ("preempt", "replace")]
)
def test_a_fault_says_how_goals_end_until_it_is_over(fleet, what, result):
    fleet.inject("robot_1", NAVIGATE, Fault(what, fleet.now))
    assert set(ended(fleet, 60.0)) == {result}
    fleet.inject("robot_1", NAVIGATE, None)
    assert set(ended(fleet, 120.0)) == {"succeed"}


def test_a_goal_that_hangs_ends_when_the_fault_does(fleet):
    fleet.inject("robot_1", NAVIGATE, Fault("hang", fleet.now))
    assert steps(fleet, 300.0) == ["begin"]
    fleet.inject("robot_1", NAVIGATE, None)
    assert steps(fleet, 302.0) == ["succeed"]


def test_a_server_that_is_killed_leaves_after_its_lease_and_starts_anew(fleet):
    assert steps(fleet, 5.0) == ["begin"]
    fleet.inject("robot_1", NAVIGATE, Fault("killed", 5.0))
    assert steps(fleet, 23.0) == []
    assert steps(fleet, 60.0) == ["gone"]
    fleet.inject("robot_1", NAVIGATE, None)
    assert steps(fleet, 68.0)[:2] == ["start", "begin"]


def test_without_what_it_needs_it_aborts_and_gives_up_until_that_is_well(fleet):
    steps(fleet, 30.0)
    fleet.inject("robot_1", LIDAR, Fault("silent", fleet.now))
    assert ended(fleet, 300.0) == ["abort", "abort"]
    fleet.inject("robot_1", LIDAR, None)
    assert set(ended(fleet, 400.0)) == {"succeed"}


@pytest.mark.parametrize(("what", "starts"), [("network_loss", 0), ("hang", 0), ("crash", 1)])
def test_goals_go_on_after_a_short_absence_unless_the_server_is_another(fleet, what, starts):
    list(trigger(fleet, "robot_1", RobotEvent(what, length=10.0)))
    assert steps(fleet, fleet.now + 9) == []
    assert steps(fleet, fleet.now + 60).count("start") == starts


def test_a_robot_that_left_the_graph_has_new_servers_when_it_is_back(fleet):
    list(trigger(fleet, "robot_1", RobotEvent("network_loss", length=60.0)))
    found = [each for each in fleet.advance(90.0) if isinstance(each, GoalStep | Presence)]
    assert [each.present for each in found if isinstance(each, Presence)] == [False, True]
    assert next(each.step for each in found if isinstance(each, GoalStep)) is Step.START


def test_a_fault_that_an_action_cannot_have_is_an_error_that_lists_those_it_can(fleet):
    with pytest.raises(UnknownFaultError, match="has no fault 'error', only abort, c"):
        fleet.inject("robot_1", NAVIGATE, Fault("error", 0.0))
    with pytest.raises(KeyError, match="/imu topic status, navigate_to_pose"):
        fleet.inject("robot_1", "dock", None)


def test_two_robots_have_goals_of_their_own():
    first, second = (
        [Action(ActionModel(name="a"), Random(seed))._new_goal(0.0) for _ in range(3)]
        for seed in (1, 2)
    )
    assert first != second


@pytest.mark.parametrize(
    ("action", "what"),
    [
        ("{name: Go}", "actions.0.name: String should match pattern"),
        ("{name: go, takes: [9, 4]}", "takes: 9 to 4 seconds; write [4, 8], 1 or more"),
        ("{name: go, types: [Fibonacci]}", "actions.0.types.0: String should match pattern"),
        ("{name: go, needs: Lidar}", "go: needs: 'Lidar' is no component of C"),
        ("{name: c}", "c is a component and an action"),
    ],
)
def test_a_wrong_action_names_file_key_and_remedy(tmp_path, action, what):
    path = tmp_path / "wrong.yaml"
    components = "[{name: C}, {name: c}]" if "name: c}" in action else "[{name: C}]"
    path.write_text(f"components: {components}\nactions: [{action}]\nanalyzers: a\n")
    with pytest.raises(DocumentError) as caught:
        load_kind(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert what in str(caught.value)
