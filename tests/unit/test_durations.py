"""Durations: text to seconds and back."""

import pytest

from ros_diagnostics_exporter.durations import parse, written


@pytest.mark.parametrize("text", ["0s", "250ms", "5s", "1m30s", "1d", "1w2d3h4m5s6ms"])
def test_a_parsed_duration_is_written_as_before(text):
    assert written(parse(text)) == text


def test_numbers_may_have_decimals():
    assert (parse("1.5s"), parse("0.5h")) == (1.5, 1800.0)


def test_a_duration_has_the_seconds_of_its_units():
    units = {"w": 604_800.0, "d": 86_400.0, "h": 3_600.0, "m": 60.0, "s": 1.0, "ms": 0.001}
    assert {unit: parse(f"1{unit}") for unit in units} == units


@pytest.mark.parametrize("text", ["", "5", "5 s", "1h1h", "5S", "-5s", ".5s", "30s1m", "٣s"])
def test_other_text_is_not_a_duration(text):
    with pytest.raises(ValueError, match="is not a duration"):
        parse(text)
