"""The recordings of the real diagnostic_aggregator, as the exporter's nouns."""

import json
from pathlib import Path

from ros_diagnostics_exporter.model import Array, Status

GOLDEN = Path(__file__).parents[1] / "data" / "golden"
CASES = sorted(path.name.removesuffix(".agg.json") for path in GOLDEN.glob("*.agg.json"))

# Published, but not in the last array: an analyzer drops them.
DISCARDED = {"discard_ignore_other": {"Cam 1"}}
# Never published: placeholders that the aggregator made of its `expected` parameter.
EXPECTED = {"expected_missing": {"Motor 9", "GPS fix", "GPS/antenna"}}


def _status(raw: dict) -> Status:
    values = tuple((pair["key"], pair["value"]) for pair in raw["values"])
    return Status(raw["level"], raw["name"], raw["message"], raw["hardware_id"], values)


def _read(path: Path) -> list[tuple[float, Array]]:
    return [
        (message["t"], Array(0.0, tuple(_status(raw) for raw in message["status"]), 100))
        for message in json.loads(path.read_text())["messages"]
        if "status" in message
    ]


def aggregated(case: str) -> list[tuple[float, Array]]:
    """(seconds, what the aggregator published), in order."""
    return _read(GOLDEN / f"{case}.agg.json")


def raw(case: str) -> list[tuple[float, Array]]:
    """(seconds, what was published on /diagnostics), in order."""
    return _read(GOLDEN / f"{case}.in.json")


def expected_names(case: str) -> set[str]:
    """Every component's name as published that an aggregated array of the case may hold."""
    published = {status.name for _t, array in raw(case) for status in array.statuses}
    return (published | EXPECTED.get(case, set())) - DISCARDED.get(case, set())
