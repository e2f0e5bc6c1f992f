"""The text that --config.check prints for a valid config."""

from pathlib import Path

from ros_diagnostics_exporter.config.check import describe
from ros_diagnostics_exporter.config.load import load

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
CONFIGS = Path(__file__).parents[2] / "data/configs"


def test_the_whole_config_is_described(monkeypatch, expect_text):
    """`pytest --update` rewrites the text."""
    monkeypatch.chdir(EXAMPLES / "mixed-fleet")
    expect_text(describe(load(Path("fleet.yml"))), CONFIGS / "check-mixed-fleet.txt")


def test_what_has_no_ros_is_in_no_domain(fleet_of):
    text = describe(fleet_of("fleet: x\nrobots: [{name: dock, source: queries}]"))
    assert "  dock: source queries, profile default\n" in text


def test_warnings_come_last(fleet_of, tmp_path):
    text = describe(fleet_of("fleet: x\nlimits: {values: 9}"))
    assert text.splitlines()[-4:] == [
        "limits (1):",
        (
            "  robots=2000 new_robots=50 components=500 values=9 label_length=256 "
            "message_bytes=1048576 series=1000000 robot_series=20000"
        ),
        "warnings (1):",
        (
            f"  {tmp_path}/fleet.yml:1: no robots, discovery or shared topics, so there is nothing "
            'to watch; add discovery: [{topic: "/{robot}/diagnostics_agg"}]'
        ),
    ]


def test_patterns_of_a_discovery_are_printed_as_they_are_written(fleet_of):
    text = describe(
        fleet_of("""
            fleet: x
            discovery:
              - {topic: "/{robot}/diagnostics_agg", include: ["tb*", "amr-?"], exclude: ["*.sim"]}
        """)
    )
    assert ", only tb* or amr-?, not *.sim, " in text
