"""The clocks that the stories with virtual robots shorten are there, and nothing else changes."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml

from e2e.rule_scenarios import clocks as scaled
from e2e.rule_scenarios import fleets
from support.shipped_rules import ROOT

LONG = re.compile(r"\b\d+[mhd]\b")


@pytest.fixture
def rules(tmp_path: Path) -> Path:
    """A copy of the shipped rules with short clocks."""
    shutil.copytree(ROOT / "prometheus" / "rules", tmp_path / "rules")
    scaled.scale(tmp_path / "rules", fleets.SETTINGS)
    return tmp_path / "rules"


def test_rules_with_short_clocks_are_rules(rules: Path):
    argv = ["promtool", "check", "rules", *rules.glob("*.yml")]
    done = subprocess.run(argv, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.mark.parametrize("name", scaled.SCALED)
def test_no_clock_of_minutes_is_left(name: str, rules: Path):
    groups = yaml.safe_load((rules / name).read_text())["groups"]
    clocks = [str(group.get("interval", "")) for group in groups]
    for rule in (rule for group in groups for rule in group["rules"]):
        clocks += [rule["expr"], rule.get("for", ""), rule.get("keep_firing_for", "")]
    assert [clock for clock in clocks if LONG.search(clock)] == []


def test_a_setting_that_is_no_more_is_told(tmp_path: Path):
    shutil.copytree(ROOT / "prometheus" / "rules", tmp_path / "rules")
    with pytest.raises(LookupError, match="no patience"):
        scaled.scale(tmp_path / "rules", {"patience": 1})


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
    assert scaled.expression(shipped) == short
