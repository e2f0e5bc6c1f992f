"""Goals of a robot's actions -> what is wrong with each action, and for how long; time is given."""

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.decode.goals import ABORTED, SUCCEEDED
from support.missions import DOCK, FLEET, GOTO, MODES, SPIN, Mission, drive, topic
from support.state_driver import ERROR, OK, WARN, StateDriver


@pytest.fixture
def mission(tmp_path):
    return Mission.of(tmp_path, FLEET)


def test_aborted_goals_are_a_warning_and_then_critical(mission):
    assert mission.run(GOTO, ABORTED).level(GOTO) == OK
    assert mission.run(GOTO, ABORTED).level(GOTO) == WARN
    mission.run(GOTO, SUCCEEDED)
    mission.run(GOTO, ABORTED, 2)

    assert mission.level(GOTO) == ERROR
    assert mission.message(GOTO) == "aborted 4 of the last 5 goals, the last at 22:14:25 UTC"


def test_an_aborted_goal_is_a_fault_until_one_succeeds_again(mission):
    assert mission.run(DOCK, ABORTED).stand(11).faults == {DOCK}

    assert mission.run(DOCK, SUCCEEDED).faults == set()


def test_as_many_as_are_too_many_have_to_succeed_in_a_row(mission):
    assert mission.run(GOTO, ABORTED, 2).run(GOTO, SUCCEEDED).level(GOTO) == WARN

    assert mission.run(GOTO, SUCCEEDED).level(GOTO) == OK


def test_aborted_goals_are_over_after_their_time(mission):
    assert mission.run(DOCK, ABORTED).stand(590).level(DOCK) == ERROR
    missions, now = mission.driver.robot.missions, mission.driver.now.mono
    assert now + 9 < missions.due < now + 11  # it is not judged all the time

    assert mission.stand(15).level(DOCK) == OK


def test_the_time_does_not_run_while_the_server_is_away(mission):
    mission.run(DOCK, ABORTED)
    del mission.types[topic(DOCK)]
    mission.stand(900)

    assert mission.faults == {DOCK}


@pytest.mark.parametrize("is_judged_anew", [True, False])
def test_a_goal_that_runs_for_too_long_is_a_warning_until_it_ends(mission, is_judged_anew):
    mission.begin(DOCK).stand(10)  # what runs is said again at another time than after just 15m
    assert mission.begin(GOTO).stand(900).level(GOTO) == OK
    state = mission.driver.state
    if is_judged_anew:
        state.configure(state.fleet, mission.driver.now)
    assert mission.stand(1).level(GOTO) == WARN
    assert mission.message(GOTO) == "a goal has been running for longer than 15m"

    assert mission.end(GOTO, SUCCEEDED).level(GOTO) == OK


def test_recoveries_count_by_their_beginning(mission):
    assert mission.run(SPIN, SUCCEEDED, 2).level(SPIN) == OK
    mission.run(SPIN, ABORTED)

    assert mission.level(SPIN) == WARN
    assert mission.message(SPIN) == "started 3 times within 10m"


def test_a_component_says_how_many_goals_run_and_for_how_long(mission):
    mission.begin(GOTO)
    mission.stand(95)

    values = dict(mission.driver.component(GOTO).last.values)
    assert values["running"] == "1"
    assert 60 <= float(values["longest"].removesuffix(" s")) <= 95


def test_a_restart_of_the_exporter_ends_no_fault_and_changes_no_count(mission, tmp_path):
    assert mission.run(GOTO, ABORTED, 2).begin(GOTO).stand(11).faults == {GOTO}
    driver = mission.driver.again(tmp_path / "x.db")
    again = Mission(driver.state.fleet, driver)
    again.goals, again.number = mission.goals, mission.number
    assert again.stand(60).faults == {GOTO}

    again.end(GOTO, SUCCEEDED)
    counts = driver.robot.missions.actions[GOTO].goals.counts
    assert (counts.results["aborted"], counts.results["succeeded"]) == (2, 1)
    assert again.run(GOTO, SUCCEEDED).faults == set()


def test_an_action_is_as_bad_as_its_fault_that_is_known_from_alerts_alone(mission):
    (fault,) = mission.run(DOCK, ABORTED).stand(12).driver.state.faults()
    again = StateDriver(fleet=mission.driver.state.fleet)
    again.now = mission.driver.now
    again.state.adopt([fault], again.now)
    assert Mission(again.state.fleet, again).level(DOCK) == ERROR


def test_after_a_restart_of_the_exporter_the_interventions_and_the_time_go_on(tmp_path):
    driven = Mission.of(tmp_path, FLEET + MODES)
    for mode in ("auto", "manual"):
        drive(driven, mode)
    before = driven.driver.robot.missions.autonomy
    driven.driver = driven.driver.again(tmp_path / "x.db")
    drive(driven, "manual")
    drive(driven, "auto")

    after = driven.driver.robot.missions.autonomy
    assert after is not before
    assert (after.interventions, after.read(driven.driver.now.mono)) == (1, 10.0)


def test_an_action_whose_entry_is_removed_is_no_component_any_more(mission):
    assert mission.run(DOCK, ABORTED).stand(11).faults == {DOCK}
    robot = Robot("r", namespace="/r", profile=Profile()).reading(Source.RAW)

    mission.driver.configure(Fleet("f", (robot,)))
    mission.stand(1)

    assert mission.faults == set()
    assert {each.label for each in mission.driver.robot.components} == {"Laser 1"}
