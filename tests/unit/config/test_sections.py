"""Sections of one or two keys: what --config.check says of them, and of another value."""

import pytest

from ros_diagnostics_exporter.config.check import describe

MINIMAL = "fleet: x\nrobots: [{name: r1}]\n"


def test_without_the_keys_there_is_no_canary_and_a_recording_has_a_minute_and_ten_seconds(fleet_of):
    fleet = fleet_of(MINIMAL)
    assert fleet.canary is None
    assert (fleet.recordings.before, fleet.recordings.after) == (60.0, 10.0)
    assert not {"canary", "recordings"} & {*describe(fleet).split()}


def test_the_keys_say_how_often_and_how_much(fleet_of):
    fleet = fleet_of(MINIMAL + "canary: 5m\nrecordings: {before: 2m}\n")
    assert (fleet.canary, fleet.recordings.before, fleet.recordings.after) == (300.0, 120.0, 10.0)
    assert "canary (1):\n  every 5m\n" in describe(fleet)
    assert "recordings (1):\n  2m before, 10s after\n" in describe(fleet)


@pytest.mark.parametrize(
    ("section", "error"),
    [
        ("canary: 30s", '"30s" is too often for a canary; use 1m or more, such as 5m; omit it for'),
        ("canary: 0", "canary: 0 is too often for a canary; use 1m or more"),
        ("canary: often", '"often" is not a duration; write seconds or a duration such as 5s'),
        ("canary: true", "canary: true is not a duration"),
        ("recordings: {after: 11m}", '"11m" is more than a recording may have; use 10m or less'),
        ("recordings: {before: soon}", 'recordings.before: "soon" is not a duration'),
        ("recordings: {during: 1s}", "recordings.during: is not a key; use one of before, after"),
    ],
)
def test_another_value_is_an_error(errors_of, section, error):
    [line] = errors_of(MINIMAL + section)
    assert error in line
