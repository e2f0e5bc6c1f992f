"""Who is on call when: shifts and overrides of a level -> stretches of time, each with its people.

Local times become instants in one place, `instant`. It never goes backwards where local times go
forwards, so what follows one another in local time does so in real time, whatever the clocks do: a
shift that ends at 06:00 and one that begins at 06:00 leave no gap and do not overlap on any day.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import date, datetime, time, timedelta, timezone
from functools import lru_cache
from itertools import pairwise
from zoneinfo import ZoneInfo

from ros_diagnostics_exporter.weekly import Weekly

_MINUTE = timedelta(minutes=1)
_DAY = timedelta(days=1)
_WEEK = timedelta(weeks=1)
_MINUTES_OF_DAY = 1440


@dataclass(frozen=True)
class Shift:
    """People who take turns."""

    people: tuple[str, ...]
    since: datetime  # local, without a zone: the first person's first turn begins
    turn: timedelta  # of local time: whole days, so every handover has the hour of `since`
    zone: ZoneInfo
    hours: Weekly = ()  # of local time; () = all

    @property
    def cut(self) -> tuple[int, int] | None:
        """The first hours, in minutes of a day, that a daily handover divides; None: none.

        What is left of them after the handover is a turn, and before it one of another person.
        """
        handover = self.since.hour * 60 + self.since.minute
        if self.turn != _DAY or len(self.people) == 1:
            return None
        divided = (
            (first, last)
            for _day, first, last in self.hours
            if last - first < _MINUTES_OF_DAY
            and (first < handover < last or first < handover + _MINUTES_OF_DAY < last)
        )
        return next(divided, None)


@dataclass(frozen=True)
class Override:
    """A person who is on call from ``start`` until before ``end``, whatever the shifts say.

    With ``instead_of`` only where the shifts have that person; the other overrides have precedence.
    """

    start: datetime
    end: datetime
    person: str
    instead_of: str | None = None


@dataclass(frozen=True)
class Stretch:
    """From ``start`` until before ``end`` (both UTC) these people are on call; one is right."""

    start: datetime
    end: datetime
    people: frozenset[str]


@dataclass(frozen=True)
class Duty:
    """One person is on call from ``start`` until before ``end``, both UTC."""

    start: datetime
    end: datetime
    person: str


def instant(local: datetime, zone: ZoneInfo) -> datetime:
    """The first instant (UTC) at which clocks of ``zone`` show ``local`` or a later time.

    A time that the clocks skip is when they skip it; of one that they show twice it is the first.
    """
    found = local.replace(tzinfo=zone).astimezone(timezone.utc)
    while (found - _MINUTE).astimezone(zone).replace(tzinfo=None) >= local:
        found -= _MINUTE  # skipped: Python goes on as if the clocks had not changed (PEP 495)
    return found


def stretches(
    shifts: Iterable[Shift], overrides: Iterable[Override], begin: datetime, end: datetime
) -> list[Stretch]:
    """All time from ``begin`` until ``end``, in order, without gaps.

    The first stretch has its real start, which may be before ``begin``, so it is the same whenever
    this is called. Neighbours have different people.
    """
    shifts, overrides = tuple(shifts), tuple(overrides)
    regular = [duty for shift in shifts for duty in _duties(shift, end)]
    changes: dict[datetime, list[tuple[int, Duty | Override]]] = {begin: [], end: []}
    both: tuple[Duty | Override, ...] = (*regular, *overrides)
    for each in both:
        changes.setdefault(each.start, []).append((1, each))
        changes.setdefault(each.end, []).append((-1, each))
    found = list(_merged(_sweep(changes)))
    return [
        Stretch(each.start, min(each.end, end), each.people)
        for each in found
        if each.end > begin and each.start < end
    ]


def _sweep(changes: dict[datetime, list[tuple[int, Duty | Override]]]) -> Iterator[Stretch]:
    on_shift: Counter[str] = Counter()
    overriding: Counter[Override] = Counter()
    instants = sorted(changes)
    for start, end in pairwise(instants):
        for count, each in changes[start]:
            if isinstance(each, Override):
                overriding[each] += count
            else:
                on_shift[each.person] += count
        yield Stretch(start, end, _on_call(set(+on_shift), set(+overriding)))


def _on_call(on_shift: set[str], overriding: set[Override]) -> frozenset[str]:
    if always := {each.person for each in overriding if each.instead_of is None}:
        return frozenset(always)
    replaced = {each.instead_of for each in overriding}
    instead = {each.person for each in overriding if each.instead_of in on_shift}
    return frozenset((on_shift - replaced) | instead)


def _merged(stretches: Iterable[Stretch]) -> Iterator[Stretch]:
    last: Stretch | None = None
    for each in stretches:
        if last is not None and last.people == each.people:
            last = Stretch(last.start, each.end, last.people)
            continue
        if last is not None:
            yield last
        last = each
    if last is not None:
        yield last


def _duties(shift: Shift, end: datetime) -> Iterator[Duty]:
    """What the shift's people have to do before ``end``, without overrides."""
    last = end.astimezone(shift.zone).replace(tzinfo=None) + _DAY
    for opening, closing in _open(shift, last):
        number = (opening - shift.since) // shift.turn
        while (turn := shift.since + number * shift.turn) < closing:
            start = instant(max(turn, opening), shift.zone)
            stop = instant(min(turn + shift.turn, closing), shift.zone)
            if start < min(stop, end):  # else the clocks skip it
                yield Duty(start, min(stop, end), _whose(shift, number))
            number += 1


def _whose(shift: Shift, number: int) -> str:
    """Who has a turn. Days without hours are nobody's turn: else the same people had all Mondays.

    (With three people and Monday to Friday, Friday's would be Monday's, each week.)
    """
    if shift.turn == _DAY:
        weeks, day = divmod(number, 7)
        with_hours = _days_with_hours(shift)
        number = weeks * sum(with_hours) + sum(with_hours[:day])
    return shift.people[number % len(shift.people)]


@lru_cache(maxsize=256)
def _days_with_hours(shift: Shift) -> tuple[bool, ...]:
    """Of seven turns of a day, the first at `since`, whether the shift has hours in them."""
    monday = datetime.combine(shift.since, time()) - shift.since.weekday() * _DAY
    hours = [
        (monday + day * _DAY + first * _MINUTE + week, monday + day * _DAY + last * _MINUTE + week)
        for day, first, last in shift.hours
        for week in (-_WEEK, timedelta(), _WEEK)
    ]
    turns = [shift.since + day * _DAY for day in range(7)]
    return tuple(
        not hours or any(first < turn + _DAY and turn < last for first, last in hours)
        for turn in turns
    )


def _open(shift: Shift, last: datetime) -> Iterator[tuple[datetime, datetime]]:
    """The shift's hours from its `since` until ``last``, in local time."""
    if not shift.hours:
        yield shift.since, last
        return
    for ordinal in range(shift.since.toordinal() - 1, last.toordinal() + 1):
        midnight = datetime.combine(date.fromordinal(ordinal), time())
        for weekday, first, until in shift.hours:
            opening = max(midnight + first * _MINUTE, shift.since)
            closing = midnight + until * _MINUTE
            if weekday == midnight.weekday() and opening < closing:
                yield opening, closing
