"""The slope of a soak test's samples."""

from random import Random

import pytest

from experiments.trend import trend


def test_a_line_has_its_slope_and_no_doubt():
    found = trend([0, 1, 2, 3, 4], [10, 12, 14, 16, 18])

    assert found.slope == pytest.approx(2)
    assert found.margin == pytest.approx(0)
    assert not found.flat


def test_the_interval_contains_the_slope_nineteen_times_out_of_twenty():
    random = Random(1)
    x = [n / 100 for n in range(200)]

    def covers() -> bool:
        found = trend(x, [3 * at + random.gauss(0, 1) for at in x])
        return abs(found.slope - 3) <= found.margin

    covered = sum(covers() for _ in range(400))
    assert 360 <= covered <= 396


def test_too_few_samples_are_an_error():
    with pytest.raises(ValueError, match="run longer"):
        trend([0, 1, 2], [1, 1, 1])
