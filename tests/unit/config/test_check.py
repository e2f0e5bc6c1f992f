"""What --config.check tells of a valid config."""

from pathlib import Path

import pytest

from ros_diagnostics_exporter.config.check import _duration, describe
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.config.scalars import duration

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
CONFIGS = Path(__file__).parents[2] / "data/configs"


def test_all_that_was_understood_is_told(monkeypatch):
    monkeypatch.chdir(EXAMPLES / "mixed-fleet")
    assert describe(load(Path("fleet.yml"))) == (CONFIGS / "check-mixed-fleet.txt").read_text()


def test_warnings_come_last(fleet_of, tmp_path):
    text = describe(fleet_of("fleet: x\nlimits: {values: 9}"))
    assert text.splitlines()[-4:] == [
        "limits (1):",
        "  robots=2000 components=500 values=9 label_length=256 series=1000000 robot_series=20000",
        "warnings (1):",
        (
            f"  {tmp_path}/fleet.yml:1: no robots, discovery or shared topics, so there is nothing "
            'to watch; add discovery: [{topic: "/{robot}/diagnostics_agg"}]'
        ),
    ]


@pytest.mark.parametrize("text", ["0s", "250ms", "5s", "1m30s", "1d", "1w2d3h4m5s6ms"])
def test_durations_are_told_as_one_writes_them(text):
    assert _duration(duration(text)) == text
