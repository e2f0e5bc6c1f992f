"""Timeperiods as hours of the week and Alertmanager's time intervals."""

from calendar import monthrange
from datetime import date, timedelta

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_tools.nagios.importer.files import Directive, read
from ros_diagnostics_tools.nagios.importer.hours import _calendar, hours
from ros_diagnostics_tools.nagios.importer.inheritance import Templates
from ros_diagnostics_tools.nagios.importer.ledger import ImportLedger
from ros_diagnostics_tools.nagios.importer.site import Site

WEEK = ("monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday")
ALL_WEEK = "\n".join(f"{day} 00:00-24:00" for day in WEEK)


def found(tmp_path, *lines: str, others: str = ""):
    path = tmp_path / "periods.cfg"
    body = "\n".join(lines)
    path.write_text(f"define timeperiod {{\ntimeperiod_name p\n{body}\n}}\n{others}")
    ledger = ImportLedger()
    things = Templates(read([path]).definitions, ledger).things()
    settings: dict[str, Directive] = {}
    return hours(Site(ledger, settings, {"timeperiod": things}), "p"), ledger


def test_days_with_the_same_hours_are_one_interval(tmp_path):
    made, _ = found(tmp_path, "monday 08:00-12:00,12:00-17:00", "friday 08:00-17:00")

    times = [{"start_time": "08:00", "end_time": "17:00"}]
    assert made.intervals() == [{"weekdays": ["monday", "friday"], "times": times}]
    assert made.outside() == [
        "Mon,Fri 00:00-08:00",
        "Mon,Fri 17:00-24:00",
        "Tue,Wed,Thu,Sat,Sun 00:00-24:00",
    ]


def test_always_never_and_both(tmp_path):
    always, _ = found(tmp_path, ALL_WEEK)
    never, _ = found(tmp_path)
    some, _ = found(tmp_path, "monday 08:00-17:00")

    assert always.always
    assert never.never
    assert always.both(some) is some
    assert some.both(always) is some


def test_both_hold_where_the_hours_overlap(tmp_path):
    one, _ = found(tmp_path, "monday 08:00-17:00", "tuesday 08:00-17:00")
    other, _ = found(tmp_path, "monday 12:00-20:00")

    assert one.both(other).weekly[0] == ((12 * 60, 17 * 60),)
    assert one.both(other).weekly[1] == ()


@pytest.mark.parametrize(
    ("date", "interval"),
    [
        ("2026-12-24", {"months": ["12"], "days_of_month": ["24"], "years": ["2026"]}),
        ("december 25", {"months": ["12"], "days_of_month": ["25"]}),
        ("april 10 - 15", {"months": ["4"], "days_of_month": ["10:15"]}),
        ("february -1", {"months": ["2"], "days_of_month": ["-1"]}),
        ("day 1 - 5", {"days_of_month": ["1:5"]}),
        ("monday 3", {"weekdays": ["monday"], "days_of_month": ["15:21"]}),
        ("monday -1 may", {"weekdays": ["monday"], "days_of_month": ["-7:-1"], "months": ["5"]}),
    ],
)
def test_a_date_without_hours_is_muted(tmp_path, date, interval):
    made, ledger = found(tmp_path, ALL_WEEK, f"{date} 00:00-00:00")

    assert list(made.muted) == [interval]
    assert made.added == ()
    assert not ledger.lost_rows


def test_a_date_with_hours_of_its_own_replaces_those_of_the_day(tmp_path):
    made, _ = found(tmp_path, "monday 08:00-17:00", "december 24 09:00-12:00")

    date = {"months": ["12"], "days_of_month": ["24"]}
    assert made.added == ({**date, "times": [{"start_time": "09:00", "end_time": "12:00"}]},)
    assert made.muted[0]["times"] == [
        {"start_time": "00:00", "end_time": "09:00"},
        {"start_time": "12:00", "end_time": "24:00"},
    ]


def test_a_range_of_months_is_its_parts(tmp_path):
    made, _ = found(tmp_path, "november 10 - january 5 00:00-00:00")

    assert list(made.muted) == [
        {"months": ["11"], "days_of_month": ["10:-1"]},
        {"months": ["12"]},
        {"months": ["1"], "days_of_month": ["1:5"]},
    ]


@pytest.mark.parametrize(
    "date",
    [
        *("day 1 - 15 / 5", "monday 1 - 2", "2026-02-01 - 2026-01-01", "2026-02-30"),
        *("2026-01-01 - 2096-01-01", "2026-01-01 - 2026-03-01 / 7"),
    ],
)
def test_a_date_that_alertmanager_cannot_say_is_reported(tmp_path, date):
    made, ledger = found(tmp_path, f"{date} 00:00-24:00")

    assert made.muted == made.added == ()
    assert [each.key for each, _ in ledger.lost_rows] == [date]


def years(year, **more):
    return {**more, "years": [year]}


@pytest.mark.parametrize(
    ("dates", "intervals"),
    [
        (
            "2027-08-02 - 2027-08-13",
            [years("2027", months=["8"], days_of_month=["2:13"])],
        ),
        (
            "2026-12-24 - 2027-01-06",
            [
                years("2026", months=["12"], days_of_month=["24:31"]),
                years("2027", months=["1"], days_of_month=["1:6"]),
            ],
        ),
        ("2027-07-01 - 2027-08-31", [years("2027", months=["7:8"])]),
        (
            "2027-01-15 - 2027-12-15",
            [
                years("2027", months=["1"], days_of_month=["15:-1"]),
                years("2027", months=["2:11"]),
                years("2027", months=["12"], days_of_month=["1:15"]),
            ],
        ),
    ],
)
def test_dates_with_years_are_translated(tmp_path, dates, intervals):
    made, ledger = found(tmp_path, ALL_WEEK, f"{dates} 00:00-00:00")

    assert list(made.muted) == intervals
    assert not ledger.lost_rows


@given(st.dates(date(2024, 1, 1), date(2029, 1, 1)), st.integers(0, 900), st.integers(-3, 903))
def test_the_intervals_of_dates_hold_on_exactly_these_days(first, length, day):
    """As Alertmanager reads them: a negative day counts from the month's end."""
    last, shown = first + timedelta(length), first + timedelta(day)

    def holds(interval):
        of_month = monthrange(shown.year, shown.month)[1]
        begin, _, end = interval.get("days_of_month", ["1:-1"])[0].partition(":")
        begin, end = (
            int(each) if int(each) > 0 else of_month + 1 + int(each)
            for each in (begin, end or begin)
        )
        low, _, high = interval["months"][0].partition(":")
        in_month = int(low) <= shown.month <= int(high or low)
        return interval["years"] == [str(shown.year)] and in_month and begin <= shown.day <= end

    assert any(map(holds, _calendar(str(first), str(last)))) == (first <= shown <= last)


def test_what_is_excluded_is_muted(tmp_path):
    lunch = "define timeperiod {\ntimeperiod_name lunch\nmonday 12:00-13:00\n}\n"
    made, _ = found(tmp_path, "monday 08:00-17:00", "exclude lunch", others=lunch)

    assert made.muted[0]["weekdays"] == ["monday"]
