"""testbed/short_clocks.py finds every duration of the shipped rules."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest
import yaml

from support.shipped_rules import ROOT, run_tool
from testbed import short_clocks

LONG = re.compile(r"\b\d+[mhd]\b")


@pytest.fixture
def prometheus(tmp_path: Path) -> Path:
    """A copy of the shipped folder with short durations."""
    shutil.copytree(ROOT / "prometheus", tmp_path / "prometheus")
    short_clocks.set_interval(tmp_path / "prometheus", 2)
    short_clocks.scale(tmp_path / "prometheus" / "rules")
    return tmp_path / "prometheus"


def test_promtool_accepts_the_configuration_with_short_durations(prometheus: Path):
    run_tool("promtool", "check", "config", prometheus / "prometheus.yml")


@pytest.mark.parametrize("name", short_clocks.SCALED)
def test_no_duration_of_minutes_is_left(name: str, prometheus: Path):
    groups = yaml.safe_load((prometheus / "rules" / name).read_text())["groups"]
    clocks = [str(group.get("interval", "")) for group in groups]
    for rule in (rule for group in groups for rule in group["rules"]):
        clocks += [rule["expr"], rule.get("for", ""), rule.get("keep_firing_for", "")]
    assert [clock for clock in clocks if LONG.search(clock)] == []


def test_every_scrape_and_evaluation_follows_the_interval(prometheus: Path):
    config = yaml.safe_load((prometheus / "prometheus.yml").read_text())
    rules = yaml.safe_load((prometheus / "rules" / "states.yml").read_text())

    assert config["global"]["scrape_interval"] == "2s"
    assert {job.get("scrape_interval") for job in config["scrape_configs"]} == {None}
    assert [group["interval"] for group in rules["groups"]] == ["2s", "2s"]


def test_a_number_that_is_not_there_is_an_error(prometheus: Path):
    with pytest.raises(LookupError, match="have the number 300"):
        short_clocks.scale(prometheus / "rules")


@pytest.mark.parametrize(
    ("shipped", "short"),
    [
        ("rate(up[10m])", "rate(up[60000ms])"),
        ("x[29m:5m] offset 14m", "x[174000ms:30000ms] offset 84000ms"),
        ("x[1d:15s]", "x[8640000ms:1500ms]"),
        ("x[299999ms]", "x[29999ms]"),
        ("sum5m > 5", "sum5m > 5"),
    ],
)
def test_ranges_and_offsets_are_a_tenth(shipped: str, short: str):
    assert short_clocks.expression(shipped) == short
