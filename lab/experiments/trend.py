"""The slope of a series, with how sure it is."""

from __future__ import annotations

from collections.abc import Sequence
from math import sqrt
from statistics import NormalDist, correlation, linear_regression
from typing import NamedTuple

CONFIDENCE = 0.95


class Trend(NamedTuple):
    """Least squares: the slope a unit of x, and the half width of its 95 % interval."""

    slope: float
    margin: float

    @property
    def flat(self) -> bool:
        """Whether the interval has 0 in it: no growth was seen."""
        return abs(self.slope) <= self.margin


def trend(x: Sequence[float], y: Sequence[float]) -> Trend:
    """Fit a line through at least four points.

    Neighbouring samples of a process' memory are alike, so they count as fewer than they are: with
    a correlation r between one residual and the next, as n (1 - r) / (1 + r).

    Raises:
        ValueError: Less than four points.
    """
    if len(x) < 4:
        raise ValueError(f"{len(x)} samples after the warm-up, too few for a slope: run longer")
    slope, intercept = linear_regression(x, y)
    residuals = [each - intercept - slope * at for at, each in zip(x, y, strict=True)]
    squares = sum(each * each for each in residuals)
    if squares <= 1e-18 * sum(each * each for each in y):  # a line, or all the same
        return Trend(slope, 0.0)
    effective = max(3.0, len(x) * _independent(residuals))
    mean = sum(x) / len(x)
    spread = sum((at - mean) ** 2 for at in x) * effective / len(x)
    error = sqrt(squares / len(x) * effective / (effective - 2) / spread)
    return Trend(slope, NormalDist().inv_cdf((1 + CONFIDENCE) / 2) * error)


def _independent(residuals: Sequence[float]) -> float:
    """Return the share of the samples that are independent of the one before."""
    before, after = residuals[:-1], residuals[1:]
    if len(set(before)) == 1 or len(set(after)) == 1:
        return 1.0
    alike = max(0.0, min(0.999, correlation(before, after)))
    return (1 - alike) / (1 + alike)
