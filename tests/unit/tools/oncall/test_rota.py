"""Who is on call at any time, compared with looking at a clock minute by minute."""

from collections.abc import Iterator
from datetime import datetime, timedelta, timezone
from zoneinfo import ZoneInfo

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ros_diagnostics_tools.oncall.rota import Override, Shift, Stretch, instant, stretches

UTC = timezone.utc
BERLIN, NEW_YORK = ZoneInfo("Europe/Berlin"), ZoneInfo("America/New_York")
LORD_HOWE = ZoneInfo("Australia/Lord_Howe")  # its clocks change by half an hour
# When clocks go forward and back, in UTC.
CHANGES = {
    BERLIN: ("2027-03-28T01:00", "2027-10-31T01:00"),
    NEW_YORK: ("2027-03-14T07:00", "2027-11-07T06:00"),
    LORD_HOWE: ("2027-10-02T15:30", "2027-04-03T15:00"),
}
STEP = timedelta(minutes=15)  # all times of these tests are multiples of it
WEEK, DAY = timedelta(days=7), timedelta(days=1)


local = datetime.fromisoformat


def utc(text: str) -> datetime:
    return local(text).replace(tzinfo=UTC)


def clock(zone: ZoneInfo, begin: datetime, end: datetime) -> Iterator[tuple[datetime, datetime]]:
    """Every step with the latest time that a clock on the wall has shown until then.

    So an hour that is shown twice counts once, the first time.
    """
    latest, now = local("1970-01-01"), begin - DAY
    while now < end:
        latest = max(latest, now.astimezone(zone).replace(tzinfo=None))
        if now >= begin:
            yield now, latest
        now += STEP


def looked_up(shift: Shift, shown: datetime) -> set[str]:
    """Who of the shift is on call while the clock shows a time."""
    if shown < shift.since:
        return set()
    for weekday, first, until in shift.hours:
        for days in (0, 1):  # also hours that began the day before
            day = shown - days * DAY
            minutes = shown.hour * 60 + shown.minute + days * 1440
            if day.weekday() == weekday and first <= minutes < until:
                break
        else:
            continue
        break
    else:
        if shift.hours:
            return set()
    turn = (shown - shift.since) // shift.turn
    if shift.hours and shift.turn == DAY:
        turn = sum(has_hours(shift, each) for each in range(turn))
    return {shift.people[turn % len(shift.people)]}


def has_hours(shift: Shift, turn: int) -> bool:
    """Whether the clock shows the shift's hours at any time in a turn of a day."""
    steps = (shift.since + turn * DAY + minute * timedelta(minutes=1) for minute in range(1440))
    minutes = {(shown.weekday(), shown.hour * 60 + shown.minute) for shown in steps}
    return any(
        (weekday + minute // 1440) % 7 == day and first <= minute < until
        for weekday, first, until in shift.hours
        for day, shown in minutes
        for minute in (shown, shown + 1440)
    )


def at(found: list[Stretch], when: datetime) -> frozenset[str]:
    hits = [each.people for each in found if each.start <= when < each.end]
    assert len(hits) == 1, f"{len(hits)} stretches at {when}"
    return hits[0]


moments = st.integers(0, 7 * 96 - 1).map(lambda steps: steps * STEP)


@settings(max_examples=50)
@given(
    zone=st.sampled_from(list(CHANGES)),
    direction=st.integers(0, 1),
    handover=moments,
    turn=st.sampled_from([DAY, WEEK]),
    people=st.integers(1, 4),
)
def test_around_a_clock_change_exactly_one_person_has_each_turn(
    zone: ZoneInfo, direction: int, handover: timedelta, turn: timedelta, people: int
):
    change = utc(CHANGES[zone][direction])
    begin, end = change - 2 * DAY, change + 2 * DAY
    since = local("2027-02-01") + handover
    shift = Shift(tuple("abcd"[:people]), since, turn, zone)

    found = stretches([shift], [], begin, end)

    for when, shown in clock(zone, begin, end):
        assert at(found, when) == looked_up(shift, shown), (when, shown)


@settings(max_examples=50)
@given(
    zone=st.sampled_from(list(CHANGES)),
    direction=st.integers(0, 1),
    cuts=st.sets(st.integers(0, 95).map(lambda step: step * 15), min_size=2, max_size=4),
    handover=moments,
)
def test_shifts_that_divide_the_day_leave_no_gap_and_do_not_overlap(
    zone: ZoneInfo, direction: int, cuts: set[int], handover: timedelta
):
    """Day, evening and night shift, with their borders anywhere, also in the hour that changes."""
    change = utc(CHANGES[zone][direction])
    begin, end = change - 2 * DAY, change + 2 * DAY
    borders = sorted(cuts)
    shifts = [
        Shift(
            (f"{first}-a", f"{first}-b"),
            local("2027-02-01") + handover,
            WEEK,
            zone,
            tuple((day, first, until) for day in range(7)),
        )
        for first, until in zip(borders, [*borders[1:], borders[0] + 1440], strict=True)
    ]

    found = stretches(shifts, [], begin, end)

    for when, shown in clock(zone, begin, end):
        expected = set().union(*(looked_up(shift, shown) for shift in shifts))
        assert len(expected) == 1
        assert at(found, when) == expected, (when, shown)


spans = st.tuples(st.integers(0, 191), st.integers(1, 96))


@given(
    overrides=st.lists(
        st.tuples(spans, st.sampled_from("abcx"), st.sampled_from([None, "a", "b"])), max_size=4
    ),
    hours=st.lists(
        st.tuples(st.integers(0, 6), st.integers(0, 95), st.integers(1, 96)), max_size=3
    ),
)
def test_overrides_replace_what_the_shifts_say(overrides: list, hours: list):
    """Those without instead_of before the others, and those before the shifts."""
    begin, end = utc("2027-01-04T00:00"), utc("2027-01-06T00:00")
    weekly = tuple((day, 15 * first, 15 * (first + length)) for day, first, length in hours)
    shift = Shift(("a", "b"), local("2027-01-01T12:00"), DAY, ZoneInfo("UTC"), weekly)
    entries = [
        Override(begin + start * STEP, begin + (start + length) * STEP, person, instead_of)
        for (start, length), person, instead_of in overrides
    ]

    found = stretches([shift], entries, begin, end)

    for when, shown in clock(ZoneInfo("UTC"), begin, end):
        now = [each for each in entries if each.start <= when < each.end]
        expected = {each.person for each in now if each.instead_of is None}
        if not expected:
            expected = looked_up(shift, shown)
            away = {each.instead_of for each in now}
            expected = (expected - away) | {
                each.person for each in now if each.instead_of in expected
            }
        assert at(found, when) == expected, when


@given(later=st.integers(0, 10_000).map(lambda minutes: timedelta(minutes=minutes)))
def test_a_duty_has_the_same_start_whenever_it_is_asked_for(later: timedelta):
    """The names of Alertmanager's receivers contain it."""
    shift = Shift(("a", "b", "c"), local("2026-11-23T09:00"), WEEK, BERLIN)
    begin, end = utc("2027-03-01T00:00"), utc("2027-05-01T00:00")
    whole = stretches([shift], [], begin, end)

    found = stretches([shift], [], begin + later, end)

    assert found == [each for each in whole if each.end > begin + later]


def test_a_single_person_has_one_stretch_and_not_one_for_each_turn():
    shift = Shift(("maria",), local("2020-01-01T09:00"), WEEK, BERLIN)

    found = stretches([shift], [], utc("2027-03-01T00:00"), utc("2027-05-01T00:00"))

    start, end = utc("2020-01-01T08:00"), utc("2027-05-01T00:00")
    assert found == [Stretch(start, end, frozenset({"maria"}))]


def test_nobody_is_on_call_before_the_first_turn():
    shift = Shift(("a",), local("2027-03-01T09:00"), WEEK, BERLIN)
    begin, start = utc("2027-02-28T00:00"), utc("2027-03-01T08:00")

    found = stretches([shift], [], begin, start + DAY)

    assert found[0] == Stretch(begin, start, frozenset())
    assert [each.people for each in found[1:]] == [{"a"}]


def test_a_shift_that_begins_within_its_hours_has_the_rest_of_them():
    nights = ((6, 22 * 60, 30 * 60),)  # Sunday 22:00 to Monday 06:00
    shift = Shift(("a",), local("2027-03-01T00:00"), WEEK, BERLIN, nights)
    begin, start, end = map(utc, ("2027-02-28T12:00", "2027-02-28T23:00", "2027-03-01T05:00"))

    found = stretches([shift], [], begin, begin + DAY)

    assert [(each.start, each.end) for each in found if each.people] == [(start, end)]


@pytest.mark.parametrize(
    ("zone", "text", "expected"),
    [
        (BERLIN, "2027-03-27T09:00", "2027-03-27T08:00"),
        (BERLIN, "2027-03-29T09:00", "2027-03-29T07:00"),  # 09:00 stays 09:00
        (BERLIN, "2027-03-28T02:30", "2027-03-28T01:00"),  # skipped: when the clocks change
        (BERLIN, "2027-10-31T02:30", "2027-10-31T00:30"),  # twice: the first time
        (BERLIN, "2027-10-31T03:00", "2027-10-31T02:00"),
        (LORD_HOWE, "2027-10-03T02:15", "2027-10-02T15:30"),
        (LORD_HOWE, "2027-04-04T01:45", "2027-04-03T14:45"),
    ],
)
def test_instant(zone: ZoneInfo, text: str, expected: str):
    assert instant(local(text), zone) == utc(expected)


def days_of(people: str, hours: tuple[tuple[int, int, int], ...], weeks: int) -> str:
    """Who is on call on each day of a daily rota, from a Monday on; "-" for nobody."""
    shift = Shift(tuple(people), local("2026-11-02T09:00"), DAY, BERLIN, hours)
    begin = utc("2026-11-02T00:00")
    found = stretches([shift], [], begin, begin + weeks * WEEK)
    noons = (begin + day * DAY + timedelta(hours=12) for day in range(7 * weeks))
    return "".join(next(iter(at(found, noon)), "-") for noon in noons)


WORKING = tuple((day, 540, 1140) for day in range(5))


@pytest.mark.parametrize(
    ("people", "expected"),
    [
        ("abc", "abcab--cabca--bcabc--"),
        ("abcdefg", "abcde--fgabc--defga--"),
        ("a", "aaaaa--aaaaa--aaaaa--"),
    ],
)
def test_days_without_hours_are_nobodys_turn(people: str, expected: str):
    assert days_of(people, WORKING, 3) == expected


def test_a_turn_of_the_night_counts_once():
    nights = tuple((day, 1140, 1140 + 14 * 60) for day in range(4))  # Monday to Thursday, 19 to 9
    shift = Shift(("a", "b", "c"), local("2026-11-02T19:00"), DAY, BERLIN, nights)
    begin = utc("2026-11-02T00:00")
    found = stretches([shift], [], begin, begin + 2 * WEEK)

    midnights = (begin + day * DAY + timedelta(hours=23) for day in range(14))
    assert "".join(next(iter(at(found, each)), "-") for each in midnights) == "abca---bcab---"
