"""Alerts, their pages and stories, settings and metrics: compared both ways."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from ros_diagnostics_exporter.cli import ack
from ros_diagnostics_exporter.metrics.self_metrics import ALL_FAMILIES
from support.shipped_rules import PROMETHEUS, ROOT, RULE_FILES, STORY_FILES, alerts, rules, run_tool

PAGES = {page.stem: page for page in (ROOT / "docs" / "alerts").glob("*.md")}
HEADINGS = ["Meaning", "Impact", "Diagnosis", "Mitigation", "Tuning"]
DASHBOARDS = {"fleet", "robot", "component", "alerts", "monitoring"}
# Always fires, so it neither begins nor ends.
ALWAYS = {"RosDiagnosticsWatchdog"}
RECORD = re.compile(r"\b\w+:ros_diagnostics\w*:\w+|\bros_diagnostics:\w+:\w+")
SETTING = re.compile(r"ros_diagnostics:\w+:(?:seconds|ratio|count)")


def every_alert() -> list[Any]:
    return [pytest.param(name, rule, id=name) for name, found in alerts().items() for rule in found]


def test_every_alert_has_its_page_and_every_page_its_alert():
    assert set(PAGES) == set(alerts())


@pytest.mark.parametrize("name", sorted(PAGES))
def test_page_says_what_to_know_and_do(name: str):
    text = PAGES[name].read_text()

    assert text.startswith(f"# {name}\n")
    assert re.findall(r"^## (.*)$", text, re.MULTILINE) == HEADINGS


def test_queries_of_the_pages_can_be_typed(tmp_path: Path):
    """Each line of a page's promql block is a query that Prometheus understands."""
    lines = [
        line
        for page in PAGES.values()
        for block in re.findall(r"```promql\n(.*?)```", page.read_text(), re.DOTALL)
        for line in block.splitlines()
    ]
    checked = tmp_path / "queries.yml"
    queries = [{"record": f"page:query:line{n}", "expr": line} for n, line in enumerate(lines)]
    checked.write_text(yaml.safe_dump({"groups": [{"name": "pages", "rules": queries}]}))

    assert f"SUCCESS: {len(lines)} rules found" in run_tool("promtool", "check", "rules", checked)


@pytest.mark.parametrize(("name", "rule"), every_alert())
def test_alert_speaks_to_people_and_links_to_its_page(name: str, rule: dict[str, Any]):
    said = rule["annotations"]

    assert name.startswith("RosDiagnostics")
    assert rule["labels"]["severity"] in {"critical", "warning", "info"}
    assert said["summary"].endswith(".")
    assert "\n" not in said["summary"]
    assert said["runbook_url"].endswith(f"/{name}.md")
    [uid] = re.findall(r"/d/ros-diagnostics-(\w+)", said["dashboard_url"])
    assert uid in DASHBOARDS


@pytest.mark.parametrize("name", sorted(set(alerts()) - ALWAYS))
def test_a_story_tells_that_the_alert_waits_fires_and_ends(name: str):
    told = [
        [bool(c["exp_alerts"]) for c in story.get("alert_rule_test", ()) if c["alertname"] == name]
        for file in STORY_FILES
        for story in yaml.safe_load(file.read_text())["tests"]
    ]

    assert any(when[:1] == [False] and when[-1:] == [False] and any(when) for when in told)


def test_what_can_be_acknowledged_are_alerts_that_say_since_when():
    for name in ack.STATES:
        for rule in alerts()[name]:
            assert "since" in rule["annotations"]


def test_settings_are_all_used_and_all_there():
    settings = yaml.safe_load((PROMETHEUS / "rules" / "settings.yml").read_text())
    recorded = {rule["record"] for group in settings["groups"] for rule in group["rules"]}
    used = {
        name
        for rule in rules()
        if rule.get("record") not in recorded
        for text in (rule["expr"], *rule.get("annotations", {}).values())
        for name in SETTING.findall(text)
    }
    computed = {rule["record"] for rule in rules() if "record" in rule} - recorded

    assert used - computed == {name for name in recorded if SETTING.fullmatch(name)}


@pytest.mark.parametrize(
    ("moment", "told"),
    [  # 1970 began with a Thursday
        ("6h59m", False),
        ("7h", True),
        ("18h59m", True),
        ("19h", False),
        ("31h", True),
        ("55h", False),
        ("79h", False),
        ("103h", True),
    ],
)
def test_the_working_hours_in_the_comment_of_the_settings(moment: str, told: bool, tmp_path: Path):
    text = (PROMETHEUS / "rules" / "settings.yml").read_text()
    [hours] = re.findall(r"^      #   (vector\(1\) and .*)$", text, re.MULTILINE)
    samples = [{"labels": "{}", "value": 1}] if told else []
    question = {"expr": hours, "eval_time": moment, "exp_samples": samples}
    story = tmp_path / "hours.yml"
    story.write_text(yaml.safe_dump({"tests": [{"promql_expr_test": [question]}]}))

    run_tool("promtool", "test", "rules", story)


def test_rules_read_only_families_that_the_exporter_serves():
    families = {family.name for family in ALL_FAMILIES}
    read = {
        name
        for file in RULE_FILES
        for name in re.findall(r"(?<![\w:])ros_diagnostics_\w+(?!:)\b", file.read_text())
    }

    assert read <= families
    assert read


def test_rules_read_only_records_that_are_recorded():
    recorded = {rule["record"] for rule in rules() if "record" in rule}
    read = {name for rule in rules() for name in RECORD.findall(rule["expr"])}

    assert read <= recorded
