"""Durations as Prometheus writes them, or plain seconds."""

import pytest

from ros_diagnostics_exporter.config.scalars import duration


@pytest.mark.parametrize(
    ("said", "seconds"),
    [
        (5, 5.0),
        (0.5, 0.5),
        (0, 0.0),
        ("5s", 5.0),
        ("1m30s", 90.0),
        ("24h", 86_400.0),
        ("250ms", 0.25),
        ("1w2d3h4m5s6ms", 788_645.006),
        ("90s", 90.0),
    ],
)
def test_duration_is_seconds(said, seconds):
    assert duration(said) == seconds


@pytest.mark.parametrize("said", ["", "5", "s", "5 s", "1h1h", "5S", "-5s", "1.5s", "٣s"])
def test_other_text_is_no_duration(said):
    with pytest.raises(ValueError, match=r"is not a duration; write seconds or .* 5s, 1m30s, 24h"):
        duration(said)
