"""The rules and the test of docs/own-alerts.md are accepted by promtool, and their tests pass."""

import re
from pathlib import Path

from support.existing_site import ALERTMANAGER, added
from support.shipped_rules import ROOT, RULE_FILES, alerts, run_tool

PAGE = (ROOT / "docs" / "own-alerts.md").read_text()


def test_the_page_s_own_test_passes(tmp_path: Path):
    rules, test = re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)
    (tmp_path / "site.yml").write_text(rules)
    (tmp_path / "site_test.yml").write_text(test)

    run_tool("promtool", "check", "rules", tmp_path / "site.yml", *RULE_FILES)
    run_tool("promtool", "test", "rules", tmp_path / "site_test.yml")
    others = (ROOT / "tests" / "data" / "own_alerts_test.yml").read_text()
    (tmp_path / "others_test.yml").write_text(others)
    run_tool("promtool", "test", "rules", tmp_path / "others_test.yml")


def test_they_are_routed_as_the_shipped_ones_and_named_as_none_of_them(tmp_path: Path):
    (prefix,) = re.findall(r"The name begins with `(\w+)`", PAGE)
    names = re.findall(r"- alert: (\w+)", PAGE)
    config = tmp_path / "alertmanager.yml"
    config.write_text(added(ALERTMANAGER.format(smtp="localhost:25"), "alertmanager.yml"))

    for name in names:
        assert name.startswith(prefix)
        labels = (f"alertname={name}", "severity=critical")
        arguments = ("config", "routes", "test", f"--config.file={config}", *labels)
        assert run_tool("amtool", *arguments) == "robots\n"
    assert not [name for name in alerts() if name.startswith(prefix)]
