"""``ros-diagnostics missions`` on a real robot's state, through HTTP."""

import json
from dataclasses import replace

import pytest

from ros_diagnostics_exporter.api.missions import missions
from ros_diagnostics_exporter.decode.goals import ABORTED, SUCCEEDED
from support.missions import DOCK, FLEET, GOTO, MODES, Mission, drive
from support.state_driver import ERROR, LASER, StateDriver


@pytest.fixture
def mission(tmp_path):
    return Mission.of(tmp_path, FLEET + MODES)


@pytest.fixture
def ask(serve, run):
    """What the command prints of a driver's state."""

    def ask(driver: StateDriver, *arguments: str, command: str = "missions", code: int = 0) -> str:
        assert driver.events is not None  # they are in the log now
        server = serve(
            missions=lambda name: missions(driver.state, name, driver.now),
            find_events=lambda wanted: driver.log.find(replace(wanted, since=None)),
        )
        return "".join(run(command, *arguments, at=server, code=code))

    return ask


def row(text: str, action: str) -> str:
    (line,) = (each for each in text.splitlines() if each.startswith(f"r      {action} "))
    return " ".join(line.split())


def test_a_row_says_how_the_goals_of_an_action_ended(mission, ask):
    mission.run(GOTO, ABORTED, 2)
    mission.run(GOTO, SUCCEEDED)
    text = ask(mission.begin(DOCK).run("follow_path", SUCCEEDED).driver)

    assert "r navigate_to_pose WARNING 1 of 3 2 0 0 aborted 2 of the last 3" in row(text, GOTO)
    assert "r dock_robot OK 0 0 1, for " in row(text, DOCK)
    assert row(text, "follow_path") == "r follow_path 1 of 1 0 0 0"


def test_it_says_what_was_wrong_when_goals_were_aborted(mission, ask):
    mission.begin(GOTO)
    mission.driver.stand(2, LASER._replace(level=ERROR))
    mission.end(GOTO, ABORTED)
    mission.driver.stand(2, LASER)
    text = ask(mission.run(GOTO, ABORTED).driver, "r")

    expected = (
        "2 goals of navigate_to_pose were aborted in the last 7 days: 1 of them while Laser 1"
    )
    assert f"{expected} was CRITICAL." in " ".join(text.split())


def test_it_says_how_often_somebody_had_to_help(mission, ask):
    drive(mission, "auto", seconds=360)
    drive(mission, "manual")

    text = " ".join(ask(mission.driver).split())
    assert (
        "Robot Success Interventions per hour Hours between interventions r 10 (1 in 0.1 h of"
        in text
    )


def test_the_history_has_each_aborted_goal_and_intervention_with_what_was_wrong(mission, ask):
    drive(mission, "auto")
    mission.begin(GOTO)
    drive(mission, "auto", pressed="true")
    mission.driver.stand(2, LASER._replace(level=ERROR))
    text = " ".join(ask(mission.end(GOTO, ABORTED).driver, "r", command="history").split())

    assert "intervention: nothing else was wrong" in text
    assert "a goal of navigate_to_pose was aborted: while Laser 1 was CRITICAL" in text


def test_without_actions_it_says_so(ask):
    driver = StateDriver().stand(2, LASER)

    assert "No action of a robot was seen" in ask(driver)
    assert "missions?robot=x answered 404" in ask(driver, "x", code=1)


def test_as_json_it_has_all_of_it(mission, ask):
    found = json.loads(ask(mission.run(GOTO, ABORTED).driver, "--output", "json"))

    (robot,) = found["robots"]
    (action,) = (each for each in robot["actions"] if each["action"] == GOTO)
    assert action["results"]["aborted"] == 1
    assert [each["component"] for each in found["aborted"]] == [GOTO]
