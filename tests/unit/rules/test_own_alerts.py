"""The rules and the test of docs/own-alerts.md are accepted by promtool, and their tests pass."""

from __future__ import annotations

import re
from pathlib import Path

from support.shipped_rules import ROOT, RULE_FILES, run_tool


def test_the_page_s_own_test_passes(tmp_path: Path):
    page = (ROOT / "docs" / "own-alerts.md").read_text()
    rules, test = re.findall(r"```yaml\n(.*?)```", page, re.DOTALL)
    (tmp_path / "site.yml").write_text(rules)
    (tmp_path / "site_test.yml").write_text(test)

    run_tool("promtool", "check", "rules", tmp_path / "site.yml", *RULE_FILES)
    run_tool("promtool", "test", "rules", tmp_path / "site_test.yml")
    others = (ROOT / "tests" / "data" / "own_alerts_test.yml").read_text()
    (tmp_path / "others_test.yml").write_text(others)
    run_tool("promtool", "test", "rules", tmp_path / "others_test.yml")
