"""Rule scenarios: virtual robots over real DDS, exporters, blackbox_exporter and Prometheus.

All scenarios run at once, on different robots of three fleets, with a tenth of the shipped
durations (`testbed/short_clocks.py`); the tests compare the series ALERTS of the whole run.
PROMETHEUS=/path/to/prometheus runs them on another release.

The first process of the test run that needs them runs them; the others read its result.
"""

import json
import os
from pathlib import Path
from typing import Any

import pytest

from e2e.rule_scenarios import recording
from e2e.rule_scenarios.all_scenarios import SCENARIOS
from e2e.rule_scenarios.scenario import Scenario
from testbed.locks import claim
from testbed.polling import until

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]

SECONDS = 900.0  # until another process has run them
# The robot that is forgotten was the only one of its entry of `discovery`, which matches nothing
# then: a fault of the exporter, if the other scenarios go on for five minutes.
LATER = {"ExporterFault entries of fleet.yml"}


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """What Prometheus recorded while all scenarios ran."""
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent
    path = folder / "rule-scenarios.json"

    def done_or_mine() -> Any:
        return path.exists() or claim(f"rule-scenarios{path}")

    mine = until(done_or_mine, "the result of the rule scenarios", SECONDS, every=1)
    if mine is not True:
        with mine:
            _run(tmp_path_factory.mktemp("scenarios"), path)
    result: dict[str, Any] = json.loads(path.read_text())
    return result


def _run(folder: Path, path: Path) -> None:
    from e2e.rule_scenarios.runner import run_all  # imports ROS; most processes only read

    result: dict[str, Any] = {"problem": "the run failed: see the first test that failed"}
    try:
        result = run_all(folder)
    finally:
        draft = path.with_suffix(".part")
        draft.write_text(json.dumps(result))
        draft.rename(path)


def test_every_scenario_finished(recorded: dict[str, Any]):
    assert recorded["problem"] == ""


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario.title)
def test_scenario(scenario: Scenario, recorded: dict[str, Any]):
    """Exactly the expected alerts fired and resolved, each once and in this order."""
    found = recording.changes(recorded, scenario)
    assert recording.by_step(found, scenario) == recording.expected(scenario), found


def test_no_other_alert_fired(recorded: dict[str, Any]):
    assert recording.unexpected(recorded, SCENARIOS) <= LATER


@pytest.mark.parametrize(
    ("scenario", "robot"),
    [pytest.param(scenario, robot, id=robot) for scenario in SCENARIOS for robot in scenario.ranks],
)
def test_recorded_states(scenario: Scenario, robot: str, recorded: dict[str, Any]):
    began = recorded["began"][scenario.title][1]  # all were OK then
    assert recording.ranks(recorded, robot, began) == scenario.ranks[robot]


def test_a_confirmed_warning_that_turns_critical_fires_at_once(recorded: dict[str, Any]):
    """Sooner than confirm_after (6 s) after the state was recorded."""
    scenario = SCENARIOS[0]
    changed = {word: at for at, word in recording.changes(recorded, scenario)}
    seen = next(
        at
        for each in recorded["ranks"]
        if each["metric"]["robot"] == "worsens"
        for at, value in each["values"]
        if value == "6"
    )
    assert changed["+ComponentCritical worsens Motor 1"] - seen < 6
