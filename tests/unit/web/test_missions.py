"""The missions on a robot's page, of a real robot's state."""

import re
from dataclasses import replace
from html import unescape

import pytest

from ros_diagnostics_exporter.api.missions import missions
from ros_diagnostics_exporter.decode.goals import ABORTED, CANCELED, SUCCEEDED
from ros_diagnostics_exporter.events import Wanted
from support.missions import DOCK, FLEET, GOTO, MODES, Mission, drive
from support.state_driver import ERROR, LASER, StateDriver
from support.web_server import ask, fleet, no_fault_history, robot


@pytest.fixture
def page(serve):
    """The page of robot r of a driver's state, as text."""

    def read(driver: StateDriver, **given: object) -> str:
        assert driver.events is not None  # they are in the log now
        server = serve(
            fleet_snapshot=lambda: {**fleet(robot("r")), "time": driver.now.wall},
            missions=lambda name: missions(driver.state, name, driver.now),
            find_events=lambda wanted: driver.log.find(replace(wanted, since=None)),
            **given,
        )
        answer = ask(server, "/robots/r")
        assert answer.status == 200
        body = answer.text.partition("<body")[2].partition("<script>")[0]
        return unescape(" ".join(re.sub(r"<[^>]+>", " ", body).split()))

    return read


@pytest.fixture
def mission(tmp_path):
    return Mission.of(tmp_path, FLEET + MODES)


def section(text: str) -> str:
    return text.partition(" Missions Success ")[2].partition(" Robot ")[0]


def test_a_robots_page_has_the_three_numbers_each_with_what_it_is_of(mission, page):
    drive(mission, "auto", seconds=7200)
    mission.run(GOTO, SUCCEEDED, 2)
    mission.run(GOTO, ABORTED)
    mission.run(GOTO, CANCELED)
    drive(mission, "manual")

    found = section(page(mission.driver))
    assert "67 % of 3 goals Interventions per hour 0.5 (1 in 2.0 h of autonomy)" in found
    assert "Hours between interventions 2.0 Counted since 2023-11-14 22:" in found


def test_it_has_what_runs_and_what_was_wrong_when_goals_were_aborted(mission, page):
    mission.begin(GOTO)
    mission.driver.stand(2, LASER._replace(level=ERROR))
    mission.end(GOTO, ABORTED)
    mission.driver.stand(2, LASER)
    mission.run("follow_path", SUCCEEDED)
    mission.begin(DOCK)
    mission.driver.stand(3, LASER)

    found = section(page(mission.driver))
    assert "dock_robot 1 running, for 3 s" in found
    assert "follow_path 100 % of 1 goal; not a mission" in found
    assert "a goal of navigate_to_pose was aborted: while Laser 1 was CRITICAL" in found


def test_what_the_section_has_is_in_no_list_below_it(mission, page):
    assert mission.run(GOTO, ABORTED).driver.events
    (event,) = mission.driver.log.find(Wanted(kind="goal"))
    text = "a goal of navigate_to_pose was aborted: nothing else was wrong"
    entries = [{"time": event["time"], "text": text}]

    def why(*given: object, ask: bool) -> dict:
        return {**no_fault_history(*given, ask=ask), "entries": entries}

    assert page(mission.driver, why=why).count(text) == 1


def test_goals_of_which_nobody_knows_the_end_are_named(mission, page):
    mission.run(GOTO, SUCCEEDED)
    mission.begin(GOTO).goals[GOTO] = []
    mission.send(GOTO)

    assert section(page(mission.driver)).startswith("100 % of 1 goal; 1 of 2 goals unknown")


def test_a_robot_without_goals_and_modes_has_no_such_section(tmp_path, page):
    mission = Mission.of(tmp_path, FLEET)

    assert "Missions" not in page(mission.driver)
    assert "Missions" not in page(StateDriver())
