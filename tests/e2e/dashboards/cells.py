"""Expected cells, read from cells/*.yml, and their comparison with a query's result.

A cell is written as its labels and its value, `{robot=well} 0`. The value may also be `a|b` (one of
them), `a..b` (between), `ago a..b` (a Unix time so many seconds ago), `ms ago a..b` (the same in
milliseconds) or `nan`. A cell after `? ` may be missing. The label `instance` is compared for
exporters only, whose addresses get the names of their fleets.
"""

import math
import re
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import yaml

FOLDER = Path(__file__).parent / "cells"
NOT_COMPARED = {"__name__", "_place", "instance", "python_version", "version", "fault"}
CELL = re.compile(r"(?P<optional>\? )?\{(?P<labels>.*)\} (?P<value>.+)")
Labels = tuple[tuple[str, str], ...]


class View(NamedTuple):
    """A dashboard with values of its variables, at the end of a time range."""

    board: str
    name: str
    variables: dict[str, str]
    at: str  # "now", or "recorded": the end of the recorded history
    cells: dict[str, dict[str, list[str]]]  # panel -> refId -> cells

    def __str__(self) -> str:
        return f"{self.board}: {self.name}"


def views() -> list[View]:
    """All views of all dashboards."""
    return [
        View(path.stem, each["view"], each["variables"], each["at"], each["cells"])
        for path in sorted(FOLDER.glob("*.yml"))
        for each in yaml.safe_load(path.read_text(encoding="utf-8"))
    ]


def found_cells(
    result: list[dict[str, Any]], fleets: Mapping[str, str], now: float
) -> dict[Labels, float]:
    """The cells of an instant query at ``now``, or the last ones of a range query.

    ``fleets`` has the fleet of each exporter's address. The name of a day that ends then, or a
    number of days before, is that number.
    """
    days = {
        time.strftime("%a %-d", time.gmtime(now - (back + 0.5) * 86400)): f"{back} days before"
        for back in range(7)
    }
    found: dict[Labels, float] = {}
    for series in result:
        metric = series["metric"].items()
        # The lines of an evidence are one line in a cell.
        compared = {k: v.replace("\n", " ") for k, v in metric if k not in NOT_COMPARED}
        if (address := series["metric"].get("instance")) in fleets:
            compared["instance"] = fleets[address]
        if "day" in compared:
            compared["day"] = days.get(compared["day"], compared["day"])
        labels = tuple(sorted(compared.items()))
        value = series["value"] if "value" in series else series["values"][-1]
        assert labels not in found, f"two cells with the labels {labels}"
        found[labels] = float(value[1])
    return found


def differences(expected: list[str], found: dict[Labels, float], now: float) -> list[str]:
    """One line for each cell that is missing, is unexpected or has another value."""
    wrong: list[str] = []
    remaining = dict(found)
    for cell in expected:
        parts = CELL.fullmatch(cell)
        assert parts, f"not a cell: {cell}"
        value = remaining.pop(_labels(parts["labels"]), None)
        if value is None:
            if not parts["optional"]:
                wrong.append(f"missing: {cell}")
        elif not _fits(parts["value"], value, now):
            wrong.append(f"expected {cell}, found {value}")
    return wrong + [f"unexpected: {dict(labels)} {value}" for labels, value in remaining.items()]


def _labels(text: str) -> Labels:
    pairs = (pair.partition("=") for pair in re.split(r", (?=\w+=)", text) if pair)
    return tuple(sorted((name, value) for name, _equals, value in pairs))


def _fits(expected_value: str, value: float, now: float) -> bool:
    for prefix, unit in (("ms ago ", 1000), ("ago ", 1)):
        if expected_value.startswith(prefix):
            return _fits(expected_value.removeprefix(prefix), now - value / unit, now)
    if ".." in expected_value:
        low, _dots, high = expected_value.partition("..")
        return float(low) <= value <= float(high)
    if expected_value == "nan":
        return math.isnan(value)
    return any(
        math.isclose(value, float(each), rel_tol=1e-4, abs_tol=1e-9)
        for each in expected_value.split("|")
    )
