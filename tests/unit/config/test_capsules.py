"""`capsules` of fleet.yml: how much is kept, and what --config.check says of it."""

from __future__ import annotations

import pytest

from ros_diagnostics_exporter.config.check import describe

MINIMAL = "fleet: x\nrobots: [{name: r1}]\n"


def test_without_the_key_it_is_a_minute_and_ten_seconds(fleet_of):
    fleet = fleet_of(MINIMAL)
    assert (fleet.capsules.before, fleet.capsules.after) == (60.0, 10.0)
    assert "capsules" not in describe(fleet)


def test_the_key_says_how_much(fleet_of):
    fleet = fleet_of(MINIMAL + "capsules: {before: 2m}\n")
    assert (fleet.capsules.before, fleet.capsules.after) == (120.0, 10.0)
    assert "capsules (1):\n  2m before, 10s after\n" in describe(fleet)


@pytest.mark.parametrize(
    ("value", "error"),
    [
        ("{after: 11m}", 'capsules.after: "11m" is more than a capsule may have; use 10m or less'),
        ("{before: soon}", 'capsules.before: "soon" is not a duration'),
        ("{during: 1s}", "capsules.during: is not a key; use one of before, after"),
    ],
)
def test_any_other_value_is_an_error(errors_of, value, error):
    [line] = errors_of(MINIMAL + f"capsules: {value}\n")
    assert error in line
