"""support/short_clocks.py finds every duration of the shipped rules."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
import yaml

from e2e.rule_scenarios import fleets
from support import short_clocks
from support.shipped_rules import ROOT, run_tool

LONG = re.compile(r"\b\d+[mhd]\b")


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    """A copy of the shipped rules with short durations."""
    shutil.copytree(ROOT / "prometheus" / "rules", tmp_path / "rules")
    short_clocks.scale(tmp_path / "rules", fleets.SETTINGS)
    return tmp_path / "rules"


def test_promtool_accepts_the_rules_with_short_durations(rules: Path):
    run_tool("promtool", "check", "rules", *rules.glob("*.yml"))


@pytest.mark.parametrize("name", short_clocks.SCALED)
def test_no_duration_of_minutes_is_left(name: str, rules: Path):
    groups = yaml.safe_load((rules / name).read_text())["groups"]
    clocks = [str(group.get("interval", "")) for group in groups]
    for rule in (rule for group in groups for rule in group["rules"]):
        clocks += [rule["expr"], rule.get("for", ""), rule.get("keep_firing_for", "")]
    assert [clock for clock in clocks if LONG.search(clock)] == []


def test_an_unknown_setting_is_an_error(tmp_path: Path):
    shutil.copytree(ROOT / "prometheus" / "rules", tmp_path / "rules")
    with pytest.raises(LookupError, match="no patience"):
        short_clocks.scale(tmp_path / "rules", {"patience": 1})


@pytest.mark.parametrize(
    ("shipped", "short"),
    [
        ("rate(up[10m])", "rate(up[60000ms])"),
        ("x[29m:5m] offset 14m", "x[174000ms:30000ms] offset 84000ms"),
        ("x[299999ms]", "x[29999ms]"),
        ("sum5m > 5", "sum5m > 5"),
    ],
)
def test_ranges_and_offsets_are_a_tenth(shipped: str, short: str):
    assert short_clocks.expression(shipped) == short
