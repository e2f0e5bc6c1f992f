"""The mixin for jsonnet users has all dashboards and rules, and needs nothing but its folder."""

import json
import shutil
from pathlib import Path
from typing import Any

import _gojsonnet
import pytest
import yaml

from support.committed_dashboards import BOARDS
from support.shipped_rules import ROOT, RULE_FILES, read_yaml, run_tool

MIXIN = ROOT / "packaging" / "mixin"
NAME = "ros-diagnostics-mixin"
STALE = "packaging/mixin is not what the rules and dashboards say: ./run generate"


@pytest.fixture
def evaluate(tmp_path: Path):
    """A function (code): what jsonnet makes of it where the mixin's folder alone is vendored."""
    shutil.copytree(MIXIN, tmp_path / NAME)

    def made(code: str) -> Any:
        text = f"local mixin = import '{NAME}/mixin.libsonnet'; {code}"
        return json.loads(_gojsonnet.evaluate_snippet("site", text, jpathdir=[str(tmp_path)]))

    return made


def shipped(pattern: str, *, servers: bool) -> list[dict[str, Any]]:
    """The groups of the rules, with the address of each alert's runbook."""
    files = [file for file in RULE_FILES if servers or file.stem != "servers"]
    groups = json.loads(json.dumps([group for f in files for group in read_yaml(f)["groups"]]))
    for rule in (rule for group in groups for rule in group["rules"] if "alert" in rule):
        rule.setdefault("annotations", {})["runbook_url"] = pattern.replace("%s", rule["alert"])
    return groups


def has_alerts(group: dict[str, Any]) -> bool:
    return any("alert" in rule for rule in group["rules"])


def test_alerts_and_rules_are_the_shipped_groups_in_their_order(evaluate, tmp_path: Path):
    found = evaluate("{alerts: mixin.prometheusAlerts, rules: mixin.prometheusRules}")

    groups = shipped("http://localhost:9877/runbooks/%s.html", servers=False)
    assert found["alerts"]["groups"] == [each for each in groups if has_alerts(each)], STALE
    assert found["rules"]["groups"] == [each for each in groups if not has_alerts(each)], STALE
    assert found["rules"]["groups"]
    for name, content in found.items():
        (tmp_path / f"{name}.yml").write_text(yaml.safe_dump(content))
        run_tool("promtool", "check", "rules", tmp_path / f"{name}.yml")


def test_a_site_configures_it_as_any_mixin(evaluate):
    config = "{_config+:: {runbookURLPattern: 'https://runbooks.example.org/%s', servers: true}}"
    code = f"local site = mixin + {config}; site.prometheusAlerts.groups"
    groups = shipped("https://runbooks.example.org/%s", servers=True)

    assert evaluate(code) == [each for each in groups if has_alerts(each)], STALE


def test_dashboards_are_the_shipped_ones(evaluate):
    boards = evaluate("mixin.grafanaDashboards")

    assert boards == {f"{uid}.json": board for uid, board in BOARDS.items()}, STALE
