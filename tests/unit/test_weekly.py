"""When times of the week begin and end, minute by minute and over changes of the clock."""

from datetime import datetime
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter.weekly import holds, next_change

BERLIN = "Europe/Berlin"
windows = st.tuples(st.integers(0, 6), st.integers(0, 1439), st.integers(1, 1440)).map(
    lambda each: (each[0], each[1], each[1] + each[2])
)


def unix(text: str) -> float:
    return datetime.fromisoformat(text).replace(tzinfo=ZoneInfo(BERLIN)).timestamp()


@pytest.mark.parametrize(
    ("now", "change"),
    [
        ("2026-03-02T05:00", "2026-03-02T06:00"),
        ("2026-03-02T06:00", "2026-03-02T18:00"),
        ("2026-03-02T17:59:59", "2026-03-02T18:00"),
        ("2026-03-06T18:00", "2026-03-09T06:00"),
        ("2026-03-27T20:00", "2026-03-30T06:00"),  # summer time begins on the 29th
        ("2026-10-23T20:00", "2026-10-26T06:00"),  # and ends on the 25th of October
    ],
)
def test_working_hours(now, change):
    weekly = tuple((day, 360, 1080) for day in range(5))
    assert next_change(weekly, BERLIN, unix(now)) == unix(change)


def test_windows_that_touch_are_one_and_the_whole_week_never_changes():
    assert next_change(((0, 0, 1440), (1, 0, 60)), BERLIN, unix("2026-03-02T12:00")) == unix(
        "2026-03-03T01:00"
    )
    week = tuple((day, 0, 1440) for day in range(7))
    assert next_change(week, BERLIN, unix("2026-03-02T12:00")) == float("inf")


@given(st.lists(windows, min_size=1, max_size=4), st.integers(0, 2 * 366 * 24 * 60))
def test_nothing_changes_before_and_something_does_then(weekly, minute):
    weekly, start = tuple(weekly), 29_453_760 + minute  # 2026 and 2027
    now = holds.__wrapped__(weekly, BERLIN, start)
    change = next_change(weekly, BERLIN, start * 60.0)
    later = range(start, start + 10_080 if change == float("inf") else int(change // 60), 7)
    assert all(holds.__wrapped__(weekly, BERLIN, each) == now for each in later)
    if change < float("inf"):
        assert change % 60 == 0
        assert holds.__wrapped__(weekly, BERLIN, int(change // 60) - 1) == now
        assert holds.__wrapped__(weekly, BERLIN, int(change // 60)) != now
