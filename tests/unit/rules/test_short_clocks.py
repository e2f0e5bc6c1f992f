"""testbed/short_clocks.py finds every duration of the shipped rules."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from support.shipped_rules import PROMETHEUS, read_yaml
from testbed import short_clocks

LONG = re.compile(r"\b\d+[mhd]\b")


def test_no_duration_of_minutes_is_left(tmp_path: Path):
    shutil.copytree(PROMETHEUS / "rules", tmp_path / "rules")
    short_clocks.scale(tmp_path / "rules")
    clocks = []
    for name in short_clocks.SCALED:
        for group in read_yaml(tmp_path / "rules" / name)["groups"]:
            clocks.append(str(group.get("interval", "")))
            for rule in group["rules"]:
                clocks += [rule["expr"], rule.get("for", ""), rule.get("keep_firing_for", "")]
    assert [clock for clock in clocks if LONG.search(clock)] == []


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
