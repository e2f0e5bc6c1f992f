"""What the fleet of the experiments publishes."""

from __future__ import annotations

from collections import Counter

import pytest

from experiments.fleet import faulty_components


def test_faults_are_spread_over_robots_and_components():
    found = faulty_components(robots=50, components=16, faults=150)

    assert sum(len(parts) for parts in found.values()) == 150
    assert {len(parts) for parts in found.values()} == {3}
    by_component = Counter(part for parts in found.values() for part in parts)
    assert max(by_component.values()) < 50 / 4  # else they would have a common cause


def test_an_array_has_groups_components_values_and_its_number():
    pytest.importorskip("rclpy")
    from experiments.fleet import array
    from ros_diagnostics_exporter.sources.dds import decode

    statuses = decode(array(7, components=6, values=3, faulty=frozenset({5}))).statuses

    assert [status.name for status in statuses if status.name.count("/") == 1] == [
        "/Group 0",
        "/Group 1",
    ]
    parts = [status for status in statuses if "part" in status.name]
    assert [status.level for status in parts] == [0, 0, 0, 0, 0, 2]
    assert len(parts[1].values) == 3
    assert parts[0].values[-1] == ("Sequence", "7")
