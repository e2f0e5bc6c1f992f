"""What runs on the road passes the judges that Prometheus and Alertmanager bring with them."""

from __future__ import annotations

import subprocess

from testbed import http as asking


def judge(*argv: object, given: bytes | None = None) -> None:
    done = subprocess.run(
        [str(part) for part in argv], input=given, capture_output=True, check=False
    )
    assert done.returncode == 0, (done.stdout + done.stderr).decode()


def test_served_metrics_rules_and_configurations_pass(stack, tmp_path):
    stack.fault("robot_1", "Motor 1", "error", 'says "hot"\\n')  # what has to be escaped

    metrics = asking.get(stack.addresses.exporter, "/metrics")
    judge("promtool", "check", "metrics", given=metrics)
    judge("promtool", "check", "rules", *(tmp_path / "prometheus" / "rules").glob("*.yml"))
    judge("promtool", "check", "config", tmp_path / "prometheus" / "prometheus.yml")
    judge("amtool", "check-config", tmp_path / "alertmanager" / "alertmanager.yml")
