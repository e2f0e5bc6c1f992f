"""Timeperiods -> hours of the week, with dates that differ: as Alertmanager's time intervals.

https://assets.nagios.com/downloads/nagioscore/docs/nagioscore/4/en/timeperiods.html. An exception
replaces the hours of its days. Alertmanager adds up intervals, so an exception becomes one that
mutes the day outside of its hours, and one that is active in them.
"""

from __future__ import annotations

import re
from calendar import monthrange
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from datetime import date
from typing import Any

from ros_diagnostics_exporter.config.scalars import DAY, DAYS
from ros_diagnostics_tools.nagios.importer.files import NagiosError
from ros_diagnostics_tools.nagios.importer.inheritance import Thing
from ros_diagnostics_tools.nagios.importer.ledger import Effect
from ros_diagnostics_tools.nagios.importer.site import Site

WEEKDAYS = ("monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday")
MONTHS = (
    *("january", "february", "march", "april", "may", "june", "july", "august", "september"),
    *("october", "november", "december"),
)
Ranges = tuple[tuple[int, int], ...]  # minutes of a day
Interval = dict[str, Any]  # of Alertmanager
_MONTH = "|".join(MONTHS)
_WEEKDAY = "|".join(WEEKDAYS)
_NO_SUCH_DATE = (
    "Alertmanager's time intervals cannot say these days; add the dates of the next year by hand "
    "to time_intervals"
)


@dataclass(frozen=True)
class Hours:
    """When something holds: ranges of each weekday, days to mute, days with hours of their own.

    Two of one name are the same.
    """

    name: str
    weekly: tuple[Ranges, ...] = ((),) * 7
    muted: tuple[Interval, ...] = field(default=(), compare=False)
    added: tuple[Interval, ...] = field(default=(), compare=False)

    @property
    def always(self) -> bool:
        """Whether it holds at any time."""
        return all(each == ((0, DAY),) for each in self.weekly) and not self.muted

    @property
    def never(self) -> bool:
        """Whether it never holds."""
        return not any(self.weekly) and not self.added

    def both(self, other: Hours) -> Hours:
        """When both hold."""
        if self.always or self == other:
            return other
        if other.always:
            return self
        weekly = tuple(
            tuple(_common(mine, its)) for mine, its in zip(self.weekly, other.weekly, strict=True)
        )
        muted = (*self.muted, *other.muted)
        return Hours(f"{self.name} and {other.name}", weekly, muted)

    def intervals(self) -> list[Interval]:
        """When it holds, as Alertmanager's intervals, days with the same hours together."""
        days: dict[Ranges, list[int]] = {}
        for day, ranges in enumerate(self.weekly):
            if ranges:
                days.setdefault(ranges, []).append(day)
        found = [
            {"weekdays": [WEEKDAYS[day] for day in which], **times(ranges)}
            for ranges, which in days.items()
        ]
        return [*found, *self.added]

    def inside(self) -> list[str]:
        """When it holds in the week, as fleet.yml writes it."""
        return _written(self.weekly)

    def outside(self) -> list[str]:
        """When it does not hold in the week, as fleet.yml writes it."""
        return _written(tuple(_complement(ranges)) for ranges in self.weekly)


def _written(week: Iterable[Ranges]) -> list[str]:
    days: dict[tuple[int, int], list[str]] = {}
    for day, ranges in zip(DAYS, week, strict=True):
        for each in ranges:
            days.setdefault(each, []).append(day)
    return [
        f"{','.join(which)} {clock(start)}-{clock(end)}" for (start, end), which in days.items()
    ]


def clock(minutes: int) -> str:
    """Minutes of a day as the clock shows them."""
    return f"{minutes // 60:02}:{minutes % 60:02}"


def times(ranges: Ranges) -> Interval:
    """Ranges of a day as Alertmanager's ``times``; nothing for a whole day."""
    if ranges == ((0, DAY),):
        return {}
    return {"times": [{"start_time": clock(a), "end_time": clock(b)} for a, b in ranges]}


_ISO = r"\d{4}-\d\d-\d\d"
DEEPEST = 100  # timeperiods that exclude one another
MOST_YEARS = 20
ALWAYS = Hours("always", (((0, DAY),),) * 7)


def hours(site: Site, name: str, above: tuple[str, ...] = ()) -> Hours:
    """The hours of a timeperiod; always for "" and for one that does not exist, as in Nagios."""
    thing = site.find("timeperiod", name) if name else None
    if thing is None or name in above:
        return ALWAYS
    if name not in site.hours:
        if len(above) > DEEPEST:
            raise NagiosError(f"timeperiod {name}: more than {DEEPEST} exclude one another")
        site.hours[name] = _hours(site, thing, name, above)
    found: Hours = site.hours[name]
    return found


def _hours(site: Site, thing: Thing, name: str, above: tuple[str, ...]) -> Hours:
    found = Hours(name)
    where = f"the hours {name}"
    thing.take("timeperiod_name", "the routes and downtimes that use these hours")
    for key in thing.values:
        if key in WEEKDAYS:
            ranges = _ranges(thing.take(key, where))
            day = WEEKDAYS.index(key)
            found = replace(found, weekly=(*found.weekly[:day], ranges, *found.weekly[day + 1 :]))
        elif key[0].isdigit() or key.split()[0] in (*WEEKDAYS, *MONTHS, "day"):
            found = _with_exception(found, thing, key, where)
    for each in dict.fromkeys(thing.list("exclude")):
        found = _without(found, hours(site, each, (*above, name)), thing)
    return found


def _with_exception(hours: Hours, thing: Thing, key: str, where: str) -> Hours:
    dates = _dates(key)
    if dates is None:
        thing.lose(key, _NO_SUCH_DATE, Effect.OTHERWISE)
        return hours
    ranges = _ranges(thing.take(key, where))
    muted = [{**each, **times(rest)} for each in dates if (rest := tuple(_complement(ranges)))]
    added = [{**each, **times(ranges)} for each in dates] if ranges else []
    return replace(hours, muted=(*hours.muted, *muted), added=(*hours.added, *added))


def _without(hours: Hours, other: Hours, thing: Thing) -> Hours:
    if other.muted:
        thing.lose(
            "exclude",
            f"{other.name} has dates of its own, which exclude does not keep",
            Effect.OTHERWISE,
        )
    thing.take("exclude", f"the hours {hours.name}, muted in {other.name}")
    return replace(hours, muted=(*hours.muted, *other.intervals()))


def _dates(key: str) -> list[Interval] | None:
    """The days of an exception as Alertmanager's interval; None if it has none for them."""
    if match := re.fullmatch(rf"({_ISO})(?: - ({_ISO}))?", key):
        return _calendar(match[1], match[2] or match[1])
    if match := re.fullmatch(rf"({_MONTH}) (-?\d+)(?: - (-?\d+))?", key):
        return [_date(MONTHS.index(match[1]) + 1, int(match[2]), int(match[3] or match[2]))]
    if match := re.fullmatch(rf"({_MONTH}) (\d+) - ({_MONTH}) (\d+)", key):
        return _between(match[1], int(match[2]), match[3], int(match[4]))
    if match := re.fullmatch(r"day (-?\d+)(?: - (?:day )?(-?\d+))?", key):
        return [{"days_of_month": [_days(int(match[1]), int(match[2] or match[1]))]}]
    if match := re.fullmatch(rf"({_WEEKDAY}) (-?[1-4])(?: ({_MONTH}))?", key):
        return [_nth_weekday(match[1], int(match[2]), match[3])]
    return None


def _calendar(first: str, last: str) -> list[Interval] | None:
    """The days between two dates; their whole months of one year are one interval."""
    try:
        begin, end = date.fromisoformat(first), date.fromisoformat(last)
    except ValueError:
        return None
    if not begin <= end or end.year - begin.year > MOST_YEARS:
        return None
    found: list[Interval] = []
    for year in range(begin.year, end.year + 1):
        start, stop = max(begin, date(year, 1, 1)), min(end, date(year, 12, 31))
        found += ({**each, "years": [str(year)]} for each in _of_year(start, stop))
    return found


def _of_year(begin: date, end: date) -> list[Interval]:
    if begin.month == end.month:
        return [_date(begin.month, begin.day, end.day)]
    first, last = begin.month + (begin.day > 1), end.month
    found = [_date(begin.month, begin.day, -1)] if begin.day > 1 else []
    is_whole = end.day == monthrange(end.year, end.month)[1]
    if first < last + is_whole:
        found.append({"months": [_days(first, last - (not is_whole))]})
    return found if is_whole else [*found, _date(last, 1, end.day)]


def _date(month: int, first: int, last: int) -> Interval:
    return {"months": [str(month)], "days_of_month": [_days(first, last)]}


def _days(first: int, last: int) -> str:
    return f"{first}:{last}" if first != last else str(first)


def _between(first_month: str, first: int, last_month: str, last: int) -> list[Interval]:
    begin, end = MONTHS.index(first_month) + 1, MONTHS.index(last_month) + 1
    if begin == end:
        return [_date(begin, first, last)]
    between = list(range(begin + 1, end if end > begin else end + 12))
    whole = [{"months": [str((month - 1) % 12 + 1)]} for month in between]
    return [_date(begin, first, -1), *whole, _date(end, 1, last)]


def _nth_weekday(weekday: str, number: int, month: str | None) -> Interval:
    """The first Monday is the Monday of the days 1 to 7, the last that of the last seven."""
    days = (7 * number - 6, 7 * number) if number > 0 else (7 * number, 7 * number + 6)
    found: Interval = {"weekdays": [weekday], "days_of_month": [_days(*days)]}
    return {**found, "months": [str(MONTHS.index(month) + 1)]} if month else found


def _ranges(text: str) -> Ranges:
    """``09:00-12:00,13:00-17:00`` in minutes, joined; an empty range is none."""
    found = re.findall(r"(\d+):(\d+)\s*-\s*(\d+):(\d+)", text)
    pairs = sorted((int(a) * 60 + int(b), int(c) * 60 + int(d)) for a, b, c, d in found)
    joined: list[tuple[int, int]] = []
    for start, end in pairs:
        if joined and start <= joined[-1][1]:
            joined[-1] = (joined[-1][0], max(end, joined[-1][1]))
        elif start < end:
            joined.append((start, end))
    return tuple(joined)


def _complement(ranges: Ranges) -> Iterable[tuple[int, int]]:
    at = 0
    for start, end in ranges:
        if at < start:
            yield at, start
        at = end
    if at < DAY:
        yield at, DAY


def _common(mine: Ranges, theirs: Ranges) -> Iterable[tuple[int, int]]:
    for start, end in mine:
        for begin, finish in theirs:
            if max(start, begin) < min(end, finish):
                yield max(start, begin), min(end, finish)
