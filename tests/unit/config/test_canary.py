"""`canary` of fleet.yml: how often, and what --config.check says of it."""

from __future__ import annotations

import pytest

from ros_diagnostics_exporter.config.check import describe

MINIMAL = "fleet: x\nrobots: [{name: r1}]\n"


def test_without_the_key_there_is_none(fleet_of):
    fleet = fleet_of(MINIMAL)
    assert fleet.canary is None
    assert "canary" not in describe(fleet)


def test_the_key_says_how_often(fleet_of):
    fleet = fleet_of(MINIMAL + "canary: 5m\n")
    assert fleet.canary == 300.0
    assert "canary (1):\n  every 5m\n" in describe(fleet)


@pytest.mark.parametrize(
    ("value", "error"),
    [
        ("30s", 'canary: "30s" is too often for a canary; use 1m or more, such as 5m; omit it for'),
        ("0", "canary: 0 is too often for a canary; use 1m or more"),
        ("often", 'canary: "often" is not a duration; write seconds or a duration such as 5s'),
        ("true", "canary: true is not a duration"),
    ],
)
def test_another_value_is_an_error(errors_of, value, error):
    [line] = errors_of(MINIMAL + f"canary: {value}\n")
    assert error in line
