"""The files that docs/virtual-robots.md shows are files that work."""

import re
from pathlib import Path

from support.simulated_fleet import fleet_of, of
from virtual_robots.schema.thesis import ThesisSettings, load_settings
from virtual_robots.simulation.actions import Step
from virtual_robots.simulation.components import Fault
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.outputs import FieldMessage, GoalStep, Note, Topic
from virtual_robots.simulation.robot_events import EVENTS
from virtual_robots.simulation.scenario import load_scenario, schedule_events

PAGE = (Path(__file__).parents[3] / "docs" / "virtual-robots.md").read_text()
SETTINGS, KIND, GRIPPER, SCENARIO = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
ANALYZERS = """/**:
  ros__parameters:
    gripper: {type: diagnostic_aggregator/GenericAnalyzer, path: Gripper, contains: [Finger]}
"""


def test_the_settings_name_every_parameter(tmp_path: Path) -> None:
    path = tmp_path / "robot.yaml"
    path.write_text(SETTINGS)
    assert load_settings(path).model_fields_set == set(ThesisSettings.model_fields)


def test_the_kind_runs(tmp_path: Path) -> None:
    (tmp_path / "my_robot.yaml").write_text(KIND)
    (tmp_path / "my_robot.analyzers.yaml").write_text(ANALYZERS)
    last = of(fleet_of(str(tmp_path / "my_robot.yaml")).advance(5.0), Topic.AGGREGATED)[-1]
    assert [s.name for s in last.statuses] == [
        "/Gripper",
        "/Gripper/gripper_node: Finger 1",
        "/Gripper/gripper_node: Finger 2",
    ]


def test_the_kind_with_a_topic_of_its_own_and_an_action_runs(tmp_path: Path) -> None:
    path = tmp_path / "gripper.yaml"
    path.write_text(GRIPPER)
    fleet = fleet_of(str(path))
    fleet.inject("robot_1", "Gripper", Fault("opened", 0.0))
    outputs = list(fleet.advance(60.0))
    (alarm,) = [each for each in outputs if isinstance(each, FieldMessage)][-1].fields["alarms"]
    assert alarm == {"code": 7}
    steps = [each.step for each in outputs if isinstance(each, GoalStep)]
    assert steps == [Step.START, *2 * [Step.BEGIN, Step.ABORT]]


def test_the_scenario_plays_all_its_events(tmp_path: Path) -> None:
    path = tmp_path / "scenario.yaml"
    path.write_text(SCENARIO)
    scenario = load_scenario(path)
    fleet = Fleet(scenario.specs, scenario.model.seed)
    schedule_events(scenario, fleet)
    notes = [h.text for h in fleet.advance(60.0) if isinstance(h, Note)]
    assert len(notes) >= len(scenario.model.events)


def test_the_page_lists_every_event_of_a_robot() -> None:
    for event in EVENTS:
        assert f"\n| `{event}` |" in PAGE
