"""The shipped Alertmanager configuration, judged by amtool."""

from __future__ import annotations

from shipped_rules import ALERTMANAGER, run_tool


def test_configuration_and_templates_pass_amtool():
    said = run_tool("amtool", "check-config", ALERTMANAGER / "alertmanager.yml")

    assert "SUCCESS" in said
