"""What the real diagnostic_aggregator was given makes ours publish what the real one did."""

import heapq
import json
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from virtual_robots.aggregator import Aggregator, AnalyzerConfigError, Report, load_parameters
from virtual_robots.model import Status

GOLDEN = Path(__file__).parents[2] / "data/golden"
ABORTS = {
    "int_pub_rate": "pub_rate: is 1, must be a number with a decimal point, as in 1.0",
    "int_timeout": "power.timeout: is 5, must be a number with a decimal point, as in 5.0",
    "new_string_publish_values": "publish_values: is 'false', must be true or false",
}
CASES = sorted(path.name.removesuffix(".in.json") for path in GOLDEN.glob("*.in.json"))
OLD_CASES = sorted(path.name.removesuffix(".agg.json") for path in GOLDEN.glob("4.2.6/*.agg.json"))


def read(path: Path) -> list[dict[str, Any]]:
    return json.loads(path.read_text())["messages"]


def as_status(raw: dict[str, Any]) -> Status:
    values = tuple((v["key"], v["value"]) for v in raw["values"])
    return Status(raw["level"], raw["name"], raw["message"], raw["hardware_id"], values)


def replay(
    folder: Path, case: str, version: str, start: float, end: float
) -> Iterator[tuple[float, Report]]:
    """Everything that is published from ``start`` to ``end``, with its time."""
    aggregator = Aggregator(load_parameters(folder / f"{case}.config.yaml"), start, version)
    messages = read(folder / f"{case}.in.json")
    inputs = [(m["t"], 0, m["status"]) for m in messages if "status" in m]
    count = round((end - start) / aggregator.period) + 1
    due = [(start + i * aggregator.period, 1, []) for i in range(count)]
    for now, is_due, statuses in heapq.merge(inputs, due, key=lambda e: e[:2]):
        report = (
            aggregator.publish(now)
            if is_due
            else aggregator.receive([as_status(s) for s in statuses], now)
        )
        if report is not None:
            yield now, report


def assert_equal_to_recording(
    case: str, version: str, inputs: Path = GOLDEN, outputs: Path | None = None
) -> None:
    folder = outputs or inputs
    arrays, tops = read(folder / f"{case}.agg.json"), read(folder / f"{case}.top.json")
    start, end = arrays[0]["t"], arrays[-1]["t"]
    published = list(replay(inputs, case, version, start, end))
    assert [t for t, _ in published] == pytest.approx([a["t"] for a in arrays], abs=0.02)
    for (now, report), array in zip(published, arrays, strict=True):
        assert list(report.statuses) == [as_status(s) for s in array["status"]], f"at {now}"
    # One recording ends between an array and its top-level state.
    assert len(arrays) - len(tops) in {0, 1}
    for (now, report), top in zip(published, tops, strict=False):
        assert now == pytest.approx(top["t"], abs=0.02)
        assert report.toplevel == as_status(top["status"]), f"toplevel at {now}"


@pytest.mark.parametrize("case", [c for c in CASES if c not in ABORTS])
def test_equals_the_recording_of_4_2_7(case: str) -> None:
    assert_equal_to_recording(case, "4.2.7")


@pytest.mark.parametrize("case", OLD_CASES)
def test_equals_the_recording_of_4_2_6(case: str) -> None:
    assert_equal_to_recording(case, "4.2.6", outputs=GOLDEN / "4.2.6")


@pytest.mark.parametrize("case", ABORTS)
def test_what_aborts_the_real_one_is_a_clear_error(case: str) -> None:
    path = GOLDEN / f"{case}.config.yaml"
    with pytest.raises(AnalyzerConfigError) as caught:
        Aggregator(load_parameters(path), 0.0)
    assert ABORTS[case] in str(caught.value)
    assert str(caught.value).startswith(f"{path}: ")


if "DIAGNOSTICS_DUMPS" in os.environ:  # a folder with dumps of real robots, which are not published

    def test_equals_what_real_robots_configurations_gave() -> None:
        """4.0.0 rolls up as 4.2.6 does."""
        folder = Path(os.environ["DIAGNOSTICS_DUMPS"]) / "aggregated"
        recorded = 0
        for path in sorted(folder.glob("*.in.json")):
            document = json.loads(path.read_text())
            if document["aggregator_exit_code_before_end"] is None:
                version = document["diagnostic_aggregator"].split()[0].replace("4.0.0", "4.2.6")
                assert_equal_to_recording(document["case"], version, inputs=folder)
                recorded += 1
        assert recorded
