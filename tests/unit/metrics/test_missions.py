"""The goals, interventions and autonomy of robots as they are served."""

from __future__ import annotations

import pytest
from prometheus_client.parser import text_string_to_metric_families

from ros_diagnostics_exporter.decode.goals import ABORTED, SUCCEEDED
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.robots.goals import RESULTS
from support.missions import DOCK, FLEET, GOTO, MODES, SPIN, Mission, drive
from support.state_driver import StateDriver

OURS = {each.name for each in metrics.MISSION_FAMILIES}


@pytest.fixture
def mission(tmp_path):
    made = Mission.of(tmp_path, FLEET + MODES)
    drive(made, "auto")
    return made


def samples(driver: StateDriver) -> dict[str, dict[tuple[str, ...], float]]:
    """By the name of the sample: the labels but those of the robot, and the value."""
    found: dict[str, dict[tuple[str, ...], float]] = {}
    for family in text_string_to_metric_families(driver.exposition.render().decode()):
        for each in family.samples:
            labels = {key: text for key, text in each.labels.items() if key not in metrics.ROBOT}
            name = each.name.removeprefix(metrics.PREFIX)
            found.setdefault(name, {})[tuple(labels.values())] = each.value
    return found


def test_a_robot_without_actions_serves_nothing_of_them():
    driver = StateDriver()
    driver.stand(3)

    assert not OURS & {*driver.exposition.render().decode().split()}


def test_every_family_is_served_with_its_labels(mission):
    mission.run(GOTO, SUCCEEDED)
    families = text_string_to_metric_families(mission.driver.exposition.render().decode())
    shown = {each.name: each for each in families}

    for family in metrics.MISSION_FAMILIES:
        found = shown[family.name.removesuffix("_total")]
        assert found.type == family.type
        for each in found.samples:
            assert {*each.labels} - {"le"} == set(family.labels)


def test_goals_are_counted_by_how_they_ended(mission):
    mission.run(GOTO, ABORTED, 2)
    mission.run(SPIN, SUCCEEDED)
    mission.run("follow_path", ABORTED)
    mission.begin(DOCK)
    found = samples(mission.driver)

    counts = found["goals_total"]
    assert {key: value for key, value in counts.items() if value} == {
        (GOTO, "aborted", "true"): 2,
        (SPIN, "succeeded", "false"): 1,
        ("follow_path", "aborted", "false"): 1,
    }
    assert {key for key in counts if key[0] == DOCK} == {(DOCK, each, "true") for each in RESULTS}
    assert {key: value for key, value in found["goals_running"].items() if value} == {(DOCK,): 1}


def test_durations_are_a_histogram_of_the_actions_that_an_entry_names(mission):
    mission.run(GOTO, SUCCEEDED, 3)
    mission.run("follow_path", SUCCEEDED)
    found = samples(mission.driver)

    buckets = found["goal_duration_seconds_bucket"]
    assert {key[1]: value for key, value in buckets.items() if key[0] == GOTO} == {
        "1.0": 0,
        **dict.fromkeys(("10.0", "60.0", "300.0", "1800.0", "+Inf"), 3),
    }
    assert found["goal_duration_seconds_sum"][GOTO,] == 15
    assert found["goal_duration_seconds_count"] == {(GOTO,): 3, (DOCK,): 0, (SPIN,): 0}


def test_interventions_and_the_time_of_autonomy_are_served_as_they_are(mission):
    drive(mission, "auto", seconds=60)
    assert 30 <= samples(mission.driver)["autonomous_seconds_total"][()] <= 65
    drive(mission, "manual")

    found = samples(mission.driver)
    assert (found["interventions_total"], found["autonomous_seconds_total"]) == ({(): 1}, {(): 65})


WANTED = FLEET.replace(
    "actions:", "values: [{component: dock, key: longest, unit: s}]\n    actions:", 1
)


@pytest.mark.parametrize(("config", "keys"), [(FLEET, set()), (WANTED, {"longest"})])
def test_the_values_of_an_action_are_series_only_where_an_entry_is_for_it(tmp_path, config, keys):
    made = Mission.of(tmp_path, config)
    made.begin(DOCK)

    found = samples(made.driver).get("component_value", {})

    assert {(DOCK, each) for each in keys} <= {key[1:3] for key in found}
    assert keys or not found
