"""Each query of docs/recipes.md, on an hour of two robots: promtool evaluates it on the rules.

r1: a motor in ERROR from 10 to 20 and from 40 minutes on. r2: silent from the 50th minute on.
"""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from support.shipped_rules import PROMETHEUS, ROOT, run_tool

PAGE = (ROOT / "docs" / "recipes.md").read_text()
RECIPES = re.findall(r"\n\n((?:(?!\n\n).)+):\n\n```promql\n(.*?)```", PAGE, re.DOTALL)
MOTOR = 'fleet="f", robot="r1", group="/Motor", component="Motor 1"'
BATTERY = 'fleet="f", robot="r1", group="/Battery", component="Battery 1"'
FAULT = f'{MOTOR}, site="hall", scope="component", state="critical", severity="critical", fault="a"'
SILENT = (
    'fleet="f", robot="r2", site="hall", scope="robot", state="silent", severity="critical", '
    'fault="b"'
)
MESSAGE = "_x60 1x59 stale _x119 1x180"
# One sample each 10 s, for 70 minutes.
INPUT = {
    'up{job="j", instance="e"}': "1x420",
    'ros_diagnostics_exporter_settled{fleet="f", job="j", instance="e"}': "1x420",
    'ros_diagnostics_robot_info{fleet="f", robot="r1", robot_group="red", site="hall"}': "1x420",
    'ros_diagnostics_robot_info{fleet="f", robot="r2", robot_group="red", site="hall"}': "1x420",
    'ros_diagnostics_robot_up{fleet="f", robot="r1"}': "1x420",
    'ros_diagnostics_robot_up{fleet="f", robot="r2"}': "1x299 0x120",
    'ros_diagnostics_robot_state{fleet="f", robot="r1"}': "0x59 6x59 0x120 6x180",
    'ros_diagnostics_robot_state{fleet="f", robot="r2"}': "0x299 5x120",
    'ros_diagnostics_robot_maintenance{fleet="f", robot="r1"}': "0x420",
    'ros_diagnostics_robot_maintenance{fleet="f", robot="r2"}': "0x420",
    f"ros_diagnostics_component_level{{{MOTOR}}}": "0x59 2x59 0x119 2x180",
    f"ros_diagnostics_component_state{{{MOTOR}}}": "_x60 6x59 stale _x119 6x180",
    f'ros_diagnostics_component_message_info{{{MOTOR}, message="hot"}}': MESSAGE,
    f"ros_diagnostics_component_changes_total{{{MOTOR}}}": "0x59 1x59 2x119 3x180",
    f'ros_diagnostics_component_value{{{BATTERY}, key="Level", unit="%"}}': "20x420",
    f'ros_diagnostics_fault_start_timestamp_seconds{{{FAULT}, evidence="hot"}}': (
        "_x60 600x59 stale _x119 2400x180"
    ),
    f'ros_diagnostics_fault_end_timestamp_seconds{{{FAULT}, reason="recovered"}}': (
        "_x120 1200x119 stale"
    ),
    (
        f'ros_diagnostics_fault_start_timestamp_seconds{{{SILENT}, evidence="silent"}}'
    ): "_x300 3000x120",
}
# What availability.yml records of two hours: it is asked for as it is, because promtool evaluates
# all rules at one interval, and these have one of their own.
SUM = "ros_diagnostics_part_seconds:sum5m"
RECORDED = {
    f'robot:{SUM}{{fleet="f", robot="r1", part="ok"}}': "300x11 0x11",
    f'robot:{SUM}{{fleet="f", robot="r1", part="critical"}}': "0x11 300x11",
    f'robot:{SUM}{{fleet="f", robot="r2", part="ok"}}': "300x17 0x5",
    f'robot:{SUM}{{fleet="f", robot="r2", part="maintenance"}}': "0x17 300x5",
    f'robot_group:{SUM}{{fleet="f", robot_group="red", part="ok"}}': "600x11 300x5 0x5",
    f'robot_group:{SUM}{{fleet="f", robot_group="red", part="critical"}}': "0x11 300x11",
    f'robot_group:{SUM}{{fleet="f", robot_group="red", part="maintenance"}}': "0x17 300x5",
    f'capability:{SUM}{{fleet="f", robot="r1", capability="lifting", part="able"}}': "300x17 0x5",
    f'capability:{SUM}{{fleet="f", robot="r1", capability="lifting", part="lost"}}': "0x17 300x5",
    f'capability:{SUM}{{fleet="f", capability="lifting at hall", part="able"}}': "300x22",
}
R1, R2 = '{fleet="f", robot="r1"}', '{fleet="f", robot="r2"}'
HELD = "fleet:ros_diagnostics_fault_start:held"
# The first words of each recipe, and its result.
EXPECTED: dict[str, dict[str, float]] = {
    "Usable share of each robot": {R1: 0.5, R2: 1},
    "The same of each group": {'{fleet="f", robot_group="red"}': 30 / 42},
    "How many hours each robot": {
        '{fleet="f", robot="r1", part="ok"}': 1,
        '{fleet="f", robot="r1", part="critical"}': 1,
        '{fleet="f", robot="r2", part="ok"}': 1.5,
        '{fleet="f", robot="r2", part="maintenance"}': 0.5,
    },
    "The ten robots": {R1: 1},
    "Could it lift?": {
        '{fleet="f", robot="r1", capability="lifting"}': 18 / 24,
        '{fleet="f", capability="lifting at hall"}': 1,
    },
    "How often each component": {'{fleet="f", robot="r1", component="Motor 1"}': 2},
    "For how many hours": {'{fleet="f", robot="r1", component="Motor 1"}': 41 / 60},
    "All faults of an hour ago": {f'{HELD}{{{FAULT}, evidence="hot"}}': 600},
    "For how many minutes": {
        f'{{{FAULT}, evidence="hot"}}': 30,
        f'{{{SILENT}, evidence="silent"}}': 20,
    },
    "How many robots": {'{fleet="f", state="critical"}': 1, '{fleet="f", state="ok"}': 1},
    "Components in ERROR": {f'ros_diagnostics_component_message_info{{{MOTOR}, message="hot"}}': 1},
    "Robots by site": {'{fleet="f", site="hall"}': 1},
    "Batteries below": {f'ros_diagnostics_component_value{{{BATTERY}, key="Level", unit="%"}}': 20},
    "The components that changed": {f"{{{MOTOR}}}": 3},
}


def test_there_is_an_expected_result_for_each_recipe():
    assert len(RECIPES) == len(EXPECTED)
    for (title, _query), begin in zip(RECIPES, EXPECTED, strict=True):
        assert title.startswith(begin)


@pytest.mark.parametrize("recorded", [True, False], ids=["availability", "other"])
def test_each_recipe_has_its_result(recorded: bool, tmp_path: Path):
    queries = [
        {
            "expr": query,
            "eval_time": "115m" if recorded else "70m",
            "exp_samples": [
                {"labels": labels, "value": value} for labels, value in expected.items()
            ],
        }
        for (_title, query), expected in zip(RECIPES, EXPECTED.values(), strict=True)
        if (SUM in query) is recorded
    ]
    assert queries
    given, interval = (RECORDED, "5m") if recorded else (INPUT, "10s")
    rules = [] if recorded else ["faults", "states"]
    test: dict[str, Any] = {
        "interval": interval,
        "input_series": [{"series": key, "values": text} for key, text in given.items()],
        "promql_expr_test": queries,
    }
    content = {
        "rule_files": [str(PROMETHEUS / "rules" / f"{name}.yml") for name in rules],
        "evaluation_interval": interval,
        "group_eval_order": [f"ros-diagnostics.{name}" for name in rules],
        "tests": [test],
    }
    (tmp_path / "test.yml").write_text(yaml.safe_dump(content))
    run_tool("promtool", "test", "rules", tmp_path / "test.yml")
