"""Alertmanager's time intervals, evaluated as it does.

Source: ContainsTime in timeinterval/timeinterval.go of Alertmanager 0.25; the fields that are used.
"""

from datetime import datetime, timedelta, timezone
from typing import Any

KNOWN = {"years", "months", "days_of_month", "times"}


def contains(intervals: list[dict[str, Any]], at: datetime) -> bool:
    """Whether one of the intervals has the instant; without a location they are in UTC."""
    return any(_contains(each, at.astimezone(timezone.utc)) for each in intervals)


def _contains(interval: dict[str, Any], at: datetime) -> bool:
    assert interval.keys() <= KNOWN
    last_day = ((at.replace(day=1) + timedelta(days=31)).replace(day=1) - timedelta(days=1)).day
    days = [_range(each) for each in interval["days_of_month"]]
    assert all(1 <= first <= last <= last_day for first, last in days) or not _month(interval, at)
    return (
        _month(interval, at)
        and any(first <= at.day <= last for first, last in days)
        and any(_has_clock(each, at) for each in interval.get("times", [ALL_DAY]))
    )


def _month(interval: dict[str, Any], at: datetime) -> bool:
    years, months = map(_range, interval["years"]), map(_range, interval["months"])
    return any(a <= at.year <= b for a, b in years) and any(a <= at.month <= b for a, b in months)


ALL_DAY = {"start_time": "00:00", "end_time": "24:00"}


def _has_clock(times: dict[str, str], at: datetime) -> bool:
    start, end = (_minutes(times[key]) for key in ("start_time", "end_time"))
    assert start < end
    return start <= at.hour * 60 + at.minute < end


def _minutes(clock: str) -> int:
    hours, minutes = clock.split(":")
    return int(hours) * 60 + int(minutes)


def _range(text: str) -> tuple[int, int]:
    first, _, last = text.partition(":")
    return int(first), int(last or first)
