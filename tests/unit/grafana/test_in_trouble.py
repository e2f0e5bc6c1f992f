"""What panels show in situations of no end-to-end test, by promtool with the shipped rules.

in_trouble.yml has them; in most the monitoring itself is in trouble. Each has series as in a
promtool test, and what a panel shows at some times: a line for each series that its query must
return.
"""

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from support.committed_dashboards import filled, queries
from support.shipped_rules import CENTRE_RULE_FILES, RULE_FILES, read_yaml, run_tool

SITUATIONS = read_yaml(Path(__file__).parent / "in_trouble.yml")
QUERIES = {(each.board, each.place, each.ref): each for each in queries()}
RULES = {"site": RULE_FILES, "centre": CENTRE_RULE_FILES, "none": []}


@pytest.mark.parametrize("situation", SITUATIONS, ids=lambda each: each["name"])
def test_a_panel_shows(situation: dict[str, Any], tmp_path: Path):
    _show(situation, tmp_path)


@pytest.mark.parametrize(
    ("robots", "names"),
    [(16, ["amr_15", "scout"]), (17, ["a16", "scut"]), (221, ["\N{NO-BREAK SPACE}"])],
)
def test_the_more_tiles_the_shorter_are_their_names(robots: int, names: list[str], tmp_path: Path):
    looked_at = {"scout", f"amr_{robots - 1}"}
    series = {}
    for robot in ["scout", *(f"amr_{number}" for number in range(1, robots))]:
        labels = f'{{fleet="hall", robot="{robot}"}}'
        series[f"robot:ros_diagnostics:info{labels}"] = "1"
        series[f"robot:ros_diagnostics_state:rank{labels}"] = "6" if robot in looked_at else "0"
    tiles = {"board": "ros-diagnostics-fleet", "panel": "All robots of $wall", "at": "0s"}
    cells = [f'{{name="{name}"}} 6' for name in names]
    shown = [{**tiles, "by": "name", "above": 0, "cells": cells}]

    _show({"rules": "none", "series": series, "shown": shown}, tmp_path)


def test_long_names_differ_within_the_width_of_their_column(tmp_path: Path):
    name = "autonomous_mobile_robot_with_a_very_long_name_of_sixty_ch_0"
    labels = [f'{{fleet="hall", robot="{robot}"}}' for robot in (f"{name}1", f"{name}2")]
    rank = {f"robot:ros_diagnostics_state:rank{each}": "6" for each in labels}
    up = {f"ros_diagnostics_robot_up{each}": "0" for each in labels}
    info = {f"robot:ros_diagnostics:info{each}": "1" for each in labels}
    cells = [
        '{who="autono\N{HORIZONTAL ELLIPSIS}_ch_01"} 6',
        '{who="autono\N{HORIZONTAL ELLIPSIS}_ch_02"} 6',
    ]
    problems = {"board": "ros-diagnostics-fleet", "panel": "Problems", "ref": "A", "at": "0s"}
    shown = [{**problems, "by": "who", "above": 0, "cells": cells}]

    _show({"rules": "none", "series": rank | up | info, "shown": shown}, tmp_path)


def _show(situation: dict[str, Any], tmp_path: Path) -> None:
    document = {
        "rule_files": [str(file) for file in RULES[situation["rules"]]],
        "evaluation_interval": "5s",
        "tests": [
            {
                "interval": "5s",
                "input_series": [
                    {"series": series, "values": values}
                    for series, values in situation["series"].items()
                ],
                "promql_expr_test": [_expected(each) for each in situation["shown"]],
            }
        ],
    }
    file = tmp_path / "in_trouble.yml"
    file.write_text(yaml.safe_dump(document, allow_unicode=True))

    run_tool("promtool", "test", "rules", file)


def _expected(shown: dict[str, Any]) -> dict[str, Any]:
    query = QUERIES[shown["board"], shown["panel"], shown.get("ref", "A")]
    expr = filled(query.expr, shown.get("variables"))
    if labels := shown.get("by"):  # what else the query returns is not of interest
        expr = f"max by ({labels}) (\n{expr}\n) > {shown.get('above', '-Inf')}"
    return {
        "expr": expr,
        "eval_time": shown["at"],
        "exp_samples": [_sample(cell) for cell in shown["cells"]],
    }


def _sample(cell: str) -> dict[str, Any]:
    parts = re.fullmatch(r"(\{.*\}) (\S+)", cell)
    assert parts, f"not a cell: {cell}"
    return {"labels": parts[1], "value": float(parts[2])}
