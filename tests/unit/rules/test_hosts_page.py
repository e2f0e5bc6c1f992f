"""What docs/hosts.md says of thresholds is what the rules have, and its example works."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import yaml

from support.shipped_rules import PROMETHEUS, ROOT, run_tool

PAGE = (ROOT / "docs" / "hosts.md").read_text()
RULES = PROMETHEUS / "rules" / "hosts.yml"


def thresholds(level: str) -> dict[str, list[str]]:
    """Check -> the numbers of a level, as the rules have them."""
    found: dict[str, list[str]] = {}
    first = yaml.safe_load(RULES.read_text())["groups"][0]
    for rule in first["rules"]:
        if rule["record"].endswith(f"threshold:{level}"):
            number = rule["expr"].removeprefix("vector(").removesuffix(")")
            found.setdefault(rule["labels"]["check"], []).append(number.removeprefix("100 - "))
    return found


def test_the_table_has_every_check_with_its_thresholds():
    rows = [[cell.strip() for cell in row.split("|")[1:-1]] for row in PAGE.splitlines()]
    first = PAGE.splitlines().index("|---|---|---|---|") + 1
    table = {row[0].split("`")[1]: row[1:3] for row in rows[first:] if row and row[0][:1] == "`"}
    shown = {
        level: {
            check: re.findall(r"\d+", row[at]) or ["0"] for check, row in table.items() if row[at]
        }
        for at, level in enumerate(("warning", "critical"))
    }

    assert shown == {level: thresholds(level) for level in ("warning", "critical")}


def test_a_check_of_ones_own_is_a_fault(tmp_path: Path):
    [rules] = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "site.yml").write_text(rules)
    labels = {"fleet": "f", "robot": "r1", "site": "north"}
    series = ", ".join(f'{name}="{value}"' for name, value in labels.items())
    hot = f'node_hwmon_temp_celsius{{job="ros-diagnostics-node", instance="a:9100", {series}}}'
    labels |= {"check": "temperature", "scope": "host", "state": "critical", "severity": "critical"}
    alert: dict[str, Any] = {
        "exp_labels": labels,
        "exp_annotations": {
            "summary": "temperature of r1 is CRITICAL.",
            "description": (
                "A check of the robot's computer: it is beyond its threshold, or does not answer."
            ),
            "evidence": "91 degrees C",
            "since": "1970-01-01 00:00:00 +0000 UTC",
        },
    }
    test = {
        "rule_files": ["site.yml", str(RULES)],
        "evaluation_interval": "15s",
        "group_eval_order": [
            "site-hosts",
            "ros-diagnostics.host-thresholds",
            "ros-diagnostics.hosts",
        ],
        "tests": [
            {
                "interval": "15s",
                "input_series": [{"series": hot, "values": "91x10"}],
                "alert_rule_test": [
                    {
                        "eval_time": at,
                        "alertname": "RosDiagnosticsHostCritical",
                        "exp_alerts": expected,
                    }
                    for at, expected in (("45s", []), ("60s", [alert]))
                ],
            }
        ],
    }
    (tmp_path / "test.yml").write_text(yaml.safe_dump(test))

    run_tool("promtool", "test", "rules", tmp_path / "test.yml")
