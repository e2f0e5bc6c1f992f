"""The mixin for jsonnet users has all dashboards and rules."""

from __future__ import annotations

import json
import re
import shutil

import pytest
import yaml

from support.committed_dashboards import BOARDS, GRAFANA
from support.shipped_rules import ROOT, RULE_FILES, run_tool

MIXIN = ROOT / "packaging" / "mixin" / "mixin.libsonnet"


def test_it_imports_every_dashboard_and_every_file_of_rules():
    imported = re.findall(r"import(?:str)? '([^']+)'", MIXIN.read_text())

    assert {(MIXIN.parent / path).resolve() for path in imported} == {
        *(GRAFANA / "dashboards").glob("*.json"),
        *RULE_FILES,
    }


def is_there() -> bool:
    """Whether jsonnet is the one in Go: Debian's cannot read the rules, or reads other indents."""
    return shutil.which("jsonnet") is not None and "Go" in run_tool("jsonnet", "--version")


@pytest.mark.skipif(not is_there(), reason="jsonnet in Go is not installed")
def test_jsonnet_builds_the_shipped_dashboards_and_groups():
    code = f"local m = import '{MIXIN}'; [m.grafanaDashboards, m.prometheusRules.groups]"
    boards, groups = json.loads(run_tool("jsonnet", "-e", code))

    assert boards == {f"{uid}.json": board for uid, board in BOARDS.items()}
    assert groups == [
        group for file in RULE_FILES for group in yaml.safe_load(file.read_text())["groups"]
    ]
