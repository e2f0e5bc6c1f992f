"""Forged diagnostics, as SECURITY.md describes them: accepted, and visible in the metrics."""

from __future__ import annotations

import urllib.request

import pytest
from prometheus_client.parser import text_string_to_metric_families

from ros_diagnostics_exporter.model import Level, Status
from support.ros_publisher import publisher
from testbed.polling import until

pytestmark = pytest.mark.integration

TOPIC = "/robot_1/diagnostics_agg"
ALL_IS_WELL = (
    Status(Level.OK, "/Motor", "OK", values=(("Motor 2", "OK"),)),
    Status(Level.OK, "/Motor/Motor 2", "all is well", "mc-02"),
)


def sample(port: int, name: str, **labels: str) -> float | None:
    """The one sample of a family that has these labels; None where there is none."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=20) as answer:
        text = answer.read().decode()
    found = [
        each.value
        for family in text_string_to_metric_families(text)
        for each in family.samples
        if each.name == f"ros_diagnostics_{name}" and labels.items() <= each.labels.items()
    ]
    assert len(found) <= 1
    return found[0] if found else None


def test_a_second_publisher_that_denies_a_fault_is_visible_and_does_not_resolve_it(site, ends):
    exporter = ends(site.exporter()).start()
    ends(site.robots(1)).start()
    motor = {"robot": "robot_1", "component": "Motor 2"}

    def becomes(value: float, name: str, **labels: str) -> None:
        until(
            lambda: sample(site.port, name, **labels) == value,
            lambda: f"{name} {value}, is {sample(site.port, name, **labels)}",
        )

    exporter.wait_for_output("serving fleet")
    until(lambda: sample(site.port, "robot_publishers", robot="robot_1"), exporter.describe)
    site.fault("error")
    becomes(2, "component_level", **motor)
    honest = sample(site.port, "robot_publishers", robot="robot_1")
    changes = sample(site.port, "component_changes_total", **motor)
    with publisher(site.domain_id) as forger:
        forger.offer(TOPIC)
        forger.wait_for_listeners()
        becomes(honest + 1, "robot_publishers", robot="robot_1")
        forger.send(TOPIC, *ALL_IS_WELL)
        # The robot keeps sending ERROR once a second: to OK and back are two changes.
        until(
            lambda: (sample(site.port, "component_changes_total", **motor) or 0) >= changes + 2,
            lambda: f"two changes, are {sample(site.port, 'component_changes_total', **motor)}",
        )
        assert (sample(site.port, "component_flap_ratio", **motor) or 0) > 0
        becomes(2, "component_level", **motor)
    becomes(honest, "robot_publishers", robot="robot_1")
