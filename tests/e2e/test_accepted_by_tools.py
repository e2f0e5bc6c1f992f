"""promtool and amtool accept what a running site serves and is configured with."""

from __future__ import annotations

from support.shipped_rules import run_tool
from testbed import http


def test_promtool_and_amtool_accept_metrics_rules_and_configurations(stack, tmp_path):
    stack.fault("robot_1", "Motor 1", "error", 'says "hot"\\n')  # needs escaping

    metrics = http.get(stack.addresses.exporter, "/metrics").decode()
    run_tool("promtool", "check", "metrics", stdin=metrics)
    run_tool("promtool", "check", "rules", *(tmp_path / "prometheus" / "rules").glob("*.yml"))
    run_tool("promtool", "check", "config", tmp_path / "prometheus" / "prometheus.yml")
    run_tool("amtool", "check-config", tmp_path / "alertmanager" / "alertmanager.yml")
