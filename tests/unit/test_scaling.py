"""The arithmetic of docs/scaling.md."""

import pytest

from bench import scaling


@pytest.mark.parametrize(
    ("low", "high", "at_10000"),
    [
        (100.0, 280.0, 910.0),  # 10 and 90 for each 1,000
        (100.0, 300.0, 1_000.0),
        (100.0, 900.0, 10_000.0),  # grows faster than the fleet: with its square
    ],
)
def test_a_cost_follows_the_line_through_both_sizes(low: float, high: float, at_10000: float):
    found = scaling.line({"1000": {"c": low}, "3000": {"c": high}}, lambda each: each["c"])

    assert found.at(10_000) == pytest.approx(at_10000)
    assert found.at(found.reaches(50_000)) == pytest.approx(50_000)
