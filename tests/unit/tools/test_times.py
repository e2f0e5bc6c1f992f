"""The one way in which times are written on the command line."""

from datetime import datetime, timedelta, timezone
from zoneinfo import ZoneInfo

import pytest

from ros_diagnostics_tools.times import moment

NOW = datetime(2027, 1, 15, 15, 0, tzinfo=timezone.utc)
MINUTE, HOUR, DAY = timedelta(minutes=1), timedelta(hours=1), timedelta(days=1)


def in_utc(naive: datetime) -> datetime:
    return naive.replace(tzinfo=timezone.utc)


@pytest.mark.parametrize(
    ("text", "past", "ahead"),
    [
        ("10m", NOW - 10 * MINUTE, NOW + 10 * MINUTE),
        ("14:30", NOW - 30 * MINUTE, NOW - 30 * MINUTE + DAY),
        ("17:00", NOW + 2 * HOUR - DAY, NOW + 2 * HOUR),
        ("2027-01-15", NOW - 15 * HOUR, NOW - 15 * HOUR),
        ("2027-01-15T08:00", NOW - 7 * HOUR, NOW - 7 * HOUR),
        ("2027-01-15 09:00+01:00", NOW - 7 * HOUR, NOW - 7 * HOUR),
    ],
)
def test_a_time_is_absolute_or_counts_from_now(text, past, ahead):
    assert moment(text, NOW, ahead=False, localize=in_utc) == past
    assert moment(text, NOW, ahead=True, localize=in_utc) == ahead


def test_a_time_without_a_zone_is_in_the_zone_that_is_meant():
    berlin = ZoneInfo("Europe/Berlin")
    found = moment(
        "2027-07-15T08:00", NOW, ahead=True, localize=lambda naive: naive.replace(tzinfo=berlin)
    )
    assert found == datetime(2027, 7, 15, 6, 0, tzinfo=timezone.utc)


def test_a_time_of_day_is_by_the_clock_of_its_day():
    berlin = ZoneInfo("Europe/Berlin")  # its clock is set back at 03:00 of 2024-10-27
    now = datetime(2024, 10, 27, 8, 0, tzinfo=berlin)
    found = moment(
        "14:30", now, ahead=False, localize=lambda naive: naive.replace(tzinfo=berlin).astimezone()
    )
    assert found == datetime(2024, 10, 26, 12, 30, tzinfo=timezone.utc)


@pytest.mark.parametrize("text", ["", "soon", "25:00", "2027-13-01", "9999999w"])
def test_what_is_no_time_is_an_error(text):
    with pytest.raises(ValueError, match="is no time"):
        moment(text, NOW, ahead=False)
