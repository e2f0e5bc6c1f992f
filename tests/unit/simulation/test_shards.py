"""Exporters that share a fleet: no fault is lost and none comes twice as they start and die."""

import pytest

from ros_diagnostics_exporter.faults.model import Identity, Scope, State
from simulation.shards import SharedFleet, play

SETTLED = 60


@pytest.fixture(params=[False])
def fleet(tmp_path, request):
    """Sixty robots of six sites, and two exporters that have found them, or know them by name."""
    made = SharedFleet.of(tmp_path, 6, 60, declared=request.param)
    for robot in list(made.robots.values())[::3]:
        robot.component = "Camera"
    for number in (1, 2):
        made.start(number, 2)
    made.pass_to(SETTLED)
    yield made
    for number in list(made.running):
        made.stop(number)


def break_some(fleet: SharedFleet, *numbers: int) -> None:
    robots = list(fleet.robots.values())
    for number in numbers:
        robots[number].broken = True


def test_each_robot_is_served_once_and_its_fault_comes_once(fleet):
    served = [set(process.state.robots) for process in fleet.running.values()]
    assert served[0] | served[1] == fleet.robots.keys()
    assert not served[0] & served[1]
    break_some(fleet, *range(0, 60, 7))
    fleet.pass_to(SETTLED + 30)
    assert fleet.held.keys() == fleet.expected()
    assert max(fleet.begun().values()) == 1


def test_a_site_whose_robots_are_of_several_exporters_is_one_fault(fleet):
    """Eight of its ten robots are silent; no exporter has the five that a fault of a site needs."""
    for process in fleet.running.values():
        own = [fleet.robots[name] for name in process.state.robots if name.startswith("s4_")]
        assert len(own) == 5
        for robot in own[1:]:
            robot.speaks = False
    fleet.pass_to(SETTLED + 60)
    assert fleet.held.keys() == {Identity(Scope.SITE, State.SILENT, site="s4")}
    [fault] = fleet.held.values()
    assert fault.evidence.startswith("8 robots: ")
    for robot in fleet.robots.values():
        robot.speaks = True
    fleet.pass_to(SETTLED + 120)
    assert [what for what, _identity, _at in fleet.sent] == ["PROBLEM", "RECOVERY"]


def test_a_component_that_fails_on_robots_of_several_exporters_is_one_fault(fleet):
    break_some(fleet, *range(0, 60, 3))
    fleet.pass_to(SETTLED + 40)
    assert fleet.held.keys() == {Identity(Scope.COMMON, State.CRITICAL, component="Camera")}
    assert {robot for robot, _part in members(fleet)} == {
        name for name, robot in fleet.robots.items() if robot.broken
    }
    for robot in fleet.robots.values():
        robot.broken = False
    fleet.pass_to(SETTLED + 100)
    assert [what for what, _identity, _at in fleet.sent] == ["PROBLEM", "RECOVERY"]


def members(fleet: SharedFleet) -> list[tuple[str, object]]:
    found = fleet.held.values()
    return [
        each
        for process in fleet.running.values()
        for fault in found
        for each in process.state.members(fault)
    ]


def test_of_an_exporter_that_is_dead_its_silent_robots_count_until_it_is_back(fleet):
    """Of s2 it has two, too few for a fault; of s4 it has five."""
    silence(fleet, "s1", "s2", "s4")
    fleet.pass_to(120)
    fleet.check(fleet.expected({"s1", "s2", "s4"}))
    fleet.stop(1, kill=True)
    silence(fleet, "s1")
    fleet.pass_to(240)
    fleet.check(fleet.expected({"s1", "s4"}))
    fleet.start(1, 2)
    fleet.pass_to(400)
    fleet.check(fleet.expected({"s1"}))


@pytest.mark.parametrize("fleet", [False, True], indirect=True)
def test_a_silent_site_does_not_end_as_one_exporter_starts_again_while_the_other_is_dead(fleet):
    """Of s4 the robots of the first are back, and it does not know what the second has."""
    silence(fleet, "s4")
    fleet.pass_to(120)
    for robot in fleet.running[1].state.robots:
        fleet.robots[robot].speaks = True
    fleet.pass_to(150)
    expected = {Identity(Scope.SITE, State.SILENT, site="s4")}
    fleet.check(expected)
    fleet.stop(2, kill=True)
    fleet.start(1, 2)
    fleet.pass_to(350)
    fleet.check(expected)
    fleet.start(2, 2)
    fleet.pass_to(450)
    fleet.check(expected)
    silence(fleet)
    fleet.pass_to(550)
    fleet.check(set())


def silence(fleet: SharedFleet, *sites: str) -> None:
    """Let all robots of these sites be silent, and no others."""
    for robot in fleet.robots.values():
        robot.speaks = robot.site not in sites


@pytest.mark.parametrize("new_first", [True, False])
def test_with_one_exporter_more_robots_move_and_no_fault_ends_or_comes_twice(fleet, new_first):
    break_some(fleet, *range(0, 60, 4))
    for robot in fleet.robots.values():
        robot.speaks = robot.site != "s5"
    fleet.pass_to(120)
    expected = fleet.expected({"s5"})
    assert fleet.held.keys() == expected
    order = (3, 1, 2) if new_first else (1, 2, 3)
    for number in order:
        fleet.start(number, 3)
        fleet.pass_to(fleet.now.mono + 50)
    served = [set(process.state.robots) for process in fleet.running.values()]
    speaking = {name for name, robot in fleet.robots.items() if robot.speaks}
    assert set().union(*served) >= speaking
    assert sum(map(len, served)) == len(set().union(*served))
    assert fleet.held.keys() == expected
    for robot in fleet.robots.values():
        robot.broken, robot.speaks = False, True
    fleet.pass_to(fleet.now.mono + 200)
    assert not fleet.held
    assert sorted(what for what, *_ in fleet.sent) == sorted(
        ["PROBLEM", "RECOVERY"] * len(expected)
    )


def test_an_exporter_that_is_gone_for_good_leaves_its_robots_to_the_others(fleet):
    fleet.start(3, 3)
    for number in (1, 2):
        fleet.start(number, 3)
    fleet.pass_to(120)
    break_some(fleet, *range(0, 60, 4))
    fleet.pass_to(150)
    fleet.stop(3, kill=True)
    expected = fleet.expected()
    fleet.pass_to(170)
    break_some(fleet, *range(1, 60, 4))  # some of these are seen by nobody
    fleet.pass_to(220)
    assert expected < fleet.held.keys() < fleet.expected()
    for number in (1, 2):
        fleet.start(number, 2)
        fleet.pass_to(fleet.now.mono + 90)
    assert fleet.held.keys() == fleet.expected()
    for robot in fleet.robots.values():
        robot.broken = False
    fleet.pass_to(fleet.now.mono + 100)
    assert not fleet.held
    assert max(fleet.begun().values()) == 1


def test_which_exporters_are_missing_is_known_once_the_others_have_settled(fleet):
    fleet.start(1, 3)
    fleet.start(2, 3)
    fleet.pass_to(fleet.now.mono + 5)
    first, second = (fleet.running[number].others for number in (1, 2))
    assert [str(each) for each in first.missing] == ["2/3", "3/3"]
    fleet.pass_to(fleet.now.mono + 60)
    assert [str(each) for each in first.missing] == ["3/3"]
    assert (first.is_first, second.is_first) == (True, False)


def test_a_history_in_which_an_exporter_is_added_and_one_dies(tmp_path):
    fleet = play(tmp_path, 200, seed=1)
    assert len(fleet.sent) == 2 * len(fleet.begun())
