"""A fault on /metrics of the real program: confirmed, with its evidence, and gone with OK."""

from __future__ import annotations

import urllib.request

import pytest
from prometheus_client.parser import text_string_to_metric_families

from testbed.polling import until

pytestmark = pytest.mark.integration

MOTOR = {"scope": "component", "robot": "robot_1", "component": "Motor 2"}


def samples(site, name: str, **labels: str) -> list[tuple[dict[str, str], float]]:
    """Those of ros_diagnostics_``name`` with these labels among their own."""
    with urllib.request.urlopen(f"http://127.0.0.1:{site.port}/metrics", timeout=20) as answer:
        text = answer.read().decode()
    return [
        (sample.labels, sample.value)
        for family in text_string_to_metric_families(text)
        for sample in family.samples
        if sample.name == f"ros_diagnostics_{name}" and labels.items() <= sample.labels.items()
    ]


def test_a_motor_that_fails_is_a_fault_after_confirm_after_until_it_is_ok(site, ends):
    exporter = ends(site.exporter()).start()
    exporter.wait_for_output("serving fleet")
    ends(site.robots(2)).start()
    until(lambda: site.up() == 2, exporter.describe, 60)
    until(lambda: samples(site, "component_level", component="Motor 2"), exporter.describe)

    site.fault("error")

    start = "fault_start_timestamp_seconds"
    until(lambda: samples(site, start, **MOTOR, state="critical"), "the fault is confirmed", 60)
    [(_labels, since)] = samples(site, start, **MOTOR, state="critical")
    [(_labels, level_since)] = samples(
        site, "component_since_timestamp_seconds", robot="robot_1", component="Motor 2"
    )
    assert since == level_since
    [(info, _one)] = samples(site, "fault_info", **MOTOR, state="critical")
    assert info["evidence"]
    assert not samples(site, start, robot="robot_2")
    assert samples(site, "component_problem_level", component="Motor 2")[0][1] == 2

    site.fault("ok")

    until(lambda: not samples(site, start, robot="robot_1"), "the fault is over", 60)
    assert not samples(site, "fault_info", robot="robot_1")
