"""Scenario files: robots and events, the same outputs each time, errors with a way out."""

from pathlib import Path

import pytest

from support.simulated_fleet import level_of, of
from virtual_robots.model import ERROR, OK, WARN
from virtual_robots.schema.documents import DocumentError
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.outputs import Note, Output, Topic
from virtual_robots.simulation.scenario import load_scenario, schedule_events

SCENARIO = """
description: a minute of a mixed fleet
seed: 3
duration: 60
robots:
  - {kind: thesis, count: 3}
  - {kind: kobuki, count: 2, name: "kobuki_{n}"}
  - {kind: thesis, name: late, absent: true}
events:
  - {at: 5, robot: robot_1, component: Motor 2, what: error, message: Over temperature, for: 10}
  - {at: 8, robot: "kobuki_*", component: "*Cliff Sensor", what: cliff, for: 5}
  - {at: 10, robot: robot_2, what: crash, for: 30}
  - {at: 12, robot: late, what: join}
  - {at: 45, robot: robot_1, what: flap, period: 2, for: 8}
"""


def outputs_of(path: Path, seconds: float) -> list[Output]:
    scenario = load_scenario(path)
    fleet = Fleet(scenario.specs, scenario.model.seed)
    schedule_events(scenario, fleet)
    return list(fleet.advance(seconds))


@pytest.fixture
def scenario_file(tmp_path: Path) -> Path:
    path = tmp_path / "scenario.yaml"
    path.write_text(SCENARIO)
    return path


def test_a_scenario_of_a_minute_played_twice_gives_the_same_messages(scenario_file: Path) -> None:
    first, second = outputs_of(scenario_file, 60.0), outputs_of(scenario_file, 60.0)
    assert len(first) > 800
    assert first == second


def test_events_happen_when_and_to_whom_the_file_says(scenario_file: Path) -> None:
    outputs = outputs_of(scenario_file, 60.0)
    raw = of(outputs, Topic.RAW)
    assert {level_of(m, "Motor 2") for m in raw if 5 <= m.at < 15} == {ERROR}
    assert {level_of(m, "Motor 2") for m in raw if not 5 <= m.at < 15} == {OK}
    assert min(m.at for m in of(outputs, Topic.RAW, "late")) == pytest.approx(12.35)
    assert not [m for m in of(outputs, Topic.RAW, "robot_2") if 10 < m.at < 40]
    for robot in ("kobuki_4", "kobuki_5"):
        cliff = {level_of(m, "kobuki_ros_node: Cliff Sensor")
                 for m in of(outputs, Topic.RAW, robot) if 10 < m.at < 13}  # fmt: skip
        assert cliff == {1}


def test_events_are_noted(scenario_file: Path) -> None:
    notes = [n.text for n in outputs_of(scenario_file, 16.0) if isinstance(n, Note)]
    assert notes[:2] == [
        "robot_1, Motor 2: error Over temperature",
        "kobuki_4, kobuki_ros_node: Cliff Sensor: cliff",
    ]
    assert "robot_1, Motor 2: ok" in notes


def test_settings_lie_beside_the_scenario(tmp_path: Path) -> None:
    (tmp_path / "robot.yaml").write_text("number_of_motors: 1\n")
    path = tmp_path / "s.yaml"
    path.write_text("robots: [{kind: thesis, settings: robot.yaml}]\n")
    last = of(outputs_of(path, 3.0), Topic.RAW)[-1]
    assert sum("Motor" in s.name for s in last.statuses) == 1


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("events: [{at: 1, robot: r9, what: crash}]", "events.0: robot: no robot is called 'r9'"),
        (
            "events: [{at: 1, robot: robot_1, what: explode}]",
            "events.0: what: 'explode' cannot happen to a whole robot, only join, leave",
        ),
        (
            "events: [{at: 1, robot: robot_1, component: Motor 9, what: error}]",
            "events.0: component: robot_1 has only Motor 1, Motor 2",
        ),
        (
            "events: [{at: 1, robot: robot_1, component: Motor 1, what: melt}]",
            "events.0: what: Motor 1 knows only ok, warn, error, stale, silent, flap, overheating",
        ),
        ("events: [{robot: robot_1, what: crash}]", "events.0.at: is missing"),
        ("robots: [{count: 2, name: same}]", "robots: same is there twice; use {n}"),
        ("robots: [{name: 'r{x}'}]", "'r{x}' cannot be a ROS namespace; use letters"),
        ("robots: [{kind: tank}]", "wrong.yaml: robots: kind 'tank' is not known"),
        ("robots: [{settings: gone.yaml}]", "gone.yaml: cannot be read: No such file"),
    ],
)
def test_a_wrong_scenario_names_the_place_and_the_way_out(tmp_path, text, what):
    path = tmp_path / "wrong.yaml"
    path.write_text(text)
    with pytest.raises(DocumentError) as caught:
        outputs_of(path, 1.0)
    assert what in str(caught.value)


def test_an_event_for_a_component_that_new_settings_took_away_is_noted(tmp_path: Path) -> None:
    settings, path = tmp_path / "robot.yaml", tmp_path / "scenario.yaml"
    settings.write_text("number_of_motors: 3\n")
    path.write_text(
        "robots: [{settings: robot.yaml}]\n"
        "events: [{at: 5, robot: robot_1, component: Motor 3, what: error}]\n"
    )
    scenario = load_scenario(path)
    fleet = Fleet(scenario.specs)
    schedule_events(scenario, fleet)
    list(fleet.advance(3.0))
    settings.write_text("number_of_motors: 2\n")
    fleet.reload(settings)
    notes = [h.text for h in fleet.advance(6.0) if isinstance(h, Note)]
    assert notes == ["robot_1, Motor 3: no longer exists since the settings changed"]


def levels_at(outputs: list[Output], name: str, *seconds: int) -> list[int]:
    """The component's level in robot_1's raw message of each of the seconds."""
    raw = {int(m.at): level_of(m, name) for m in of(outputs, Topic.RAW)}
    return [raw[second] for second in seconds]


@pytest.mark.parametrize(
    ("events", "levels"),
    [
        ("{at: 5, what: warn, for: 10}, {at: 8, what: error}", [OK, WARN, ERROR, ERROR]),
        ("{at: 5, what: warn, for: 10}, {at: 8, what: error, for: 20}", [OK, WARN, ERROR, ERROR]),
        ("{at: 5, what: error, for: 10}, {at: 8, what: ok}", [OK, ERROR, OK, OK]),
        ("{at: 5, what: warn, for: 10}", [OK, WARN, WARN, OK]),
    ],
)
def test_the_end_of_a_fault_does_not_end_a_later_one(tmp_path, events, levels):
    path = tmp_path / "s.yaml"
    one = events.replace("{", "{robot: robot_1, component: Motor 2, ")
    path.write_text(f"robots: [{{count: 1}}]\nevents: [{one}]\n")
    outputs = outputs_of(path, 20.0)
    assert levels_at(outputs, "Motor 2", 3, 6, 12, 18) == levels


def test_the_end_of_a_fault_is_noted_only_if_it_ended(tmp_path: Path) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(
        "robots: [{count: 1}]\nevents:\n"
        "  - {at: 5, robot: robot_1, component: Motor 2, what: warn, for: 10}\n"
        "  - {at: 8, robot: robot_1, component: Motor 2, what: error, for: 4}\n"
    )
    notes = [n.text for n in outputs_of(path, 20.0) if isinstance(n, Note)]
    assert notes == [f"robot_1, Motor 2: {what}" for what in ("warn", "error", "ok")]


@pytest.mark.parametrize("what", ["component: Motor 1, what: flap", "what: flap, for: 5"])
def test_a_period_that_is_too_short_is_rejected(tmp_path: Path, what: str) -> None:
    path = tmp_path / "s.yaml"
    path.write_text(f"events: [{{at: 1, robot: robot_1, {what}, period: 1.0e-308}}]\n")
    with pytest.raises(DocumentError, match=r"events\.0\.period: .* 0\.01"):
        outputs_of(path, 5.0)
