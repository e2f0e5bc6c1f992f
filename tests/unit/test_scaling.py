"""docs/scaling.md shows what was measured, and its arithmetic is right."""

from __future__ import annotations

import copy
from typing import Any

import pytest

from bench import scaling


@pytest.mark.parametrize(
    ("low", "high", "at_10000"),
    [
        (100.0, 280.0, 910.0),  # 10 and 90 for each 1,000
        (100.0, 400.0, 400 / 3 * 10),  # starts below 0: proportional
    ],
)
def test_a_cost_follows_the_line_through_both_sizes(low: float, high: float, at_10000: float):
    found = scaling.line({"1000": {"c": low}, "3000": {"c": high}}, lambda each: each["c"])

    assert found.at(10_000) == pytest.approx(at_10000)
    assert found.at(found.reaches(50_000)) == pytest.approx(50_000)


def numbers() -> dict[str, Any]:
    """Of fleets of 1,000 and 3,000 robots, made up."""

    def of(robots: int) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
        exporter = {"cpu": robots / 2000, "received": 1.0, "memory_mb": 100 + robots / 5}
        exporter |= {"scrape_ms": robots / 10, "scrape_mb": robots / 50, "samples": robots * 150}
        prometheus = {"series": robots * 170, "memory_mb": robots / 2, "rules": robots / 2000}
        prometheus |= {"faults_group": robots / 4000, "alerts": robots * 0.8}
        return exporter, prometheus, {"kb": robots}

    found: dict[str, Any] = {"exporter": {}, "prometheus": {}, "database": {}}
    for robots in (1000, 3000):
        exporter, prometheus, database = of(robots)
        found["exporter"][str(robots)] = exporter
        found["prometheus"][str(robots)] = {"faulty": prometheus}
        found["database"][str(robots)] = database
    return found


def limits(of: dict[str, Any]) -> list[str]:
    return [line.split("|")[1] for line in scaling.limits(of).splitlines()[2:]]


def test_the_first_limit_is_listed_first():
    slow = copy.deepcopy(numbers())
    for size, each in slow["prometheus"].items():
        each["faulty"]["rules"] = int(size)

    assert "all rules" in limits(slow)[0]
    assert "all rules" not in limits(numbers())[0]
