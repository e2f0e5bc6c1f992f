"""oncall.yml: people, teams, their levels of escalation, overrides -> one frozen OnCall.

It is read and checked as fleet.yml is: every problem with its line, key, value and way out.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from datetime import date, datetime, timedelta, timezone
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Literal
from zoneinfo import ZoneInfo

from pydantic import BaseModel, ConfigDict, Field, PlainValidator, ValidationError, model_validator

from ros_diagnostics_exporter.config.errors import (
    ConfigError,
    Finding,
    WrongValueError,
    explanation,
    quoted,
    suggestion,
)
from ros_diagnostics_exporter.config.scalars import (
    DAYS,
    Moment,
    Name,
    TimeZone,
    WeeklyTime,
    text,
)
from ros_diagnostics_exporter.config.yaml_file import Document, KeyPath, read
from ros_diagnostics_tools.oncall.rota import Duty, Override, Shift, Stretch, instant, stretches

_MATCHER = re.compile(r"[A-Za-z_:][A-Za-z0-9_:]*\s*(=~|!~|!=|=)\s*\S.*", re.ASCII)


def email(value: Any) -> str:
    """An email address without a display name."""
    found = text(value)
    if not re.fullmatch(r"[^\s@,<>\"{}]+@[^\s@,<>\"{}]+", found):
        raise WrongValueError(
            f"{quoted(found)} is not an address", "write it like anna@example.org"
        )
    return found


def phone(value: Any) -> str:
    """A telephone number with its country (E.164)."""
    if not isinstance(value, str) or not re.fullmatch(r"\+[1-9]\d{6,14}", value, re.ASCII):
        what = f"{quoted(value)} is not a telephone number"
        raise WrongValueError(what, 'write it with its country, in quotes: "+4915112345678"')
    return value


def matcher(value: Any) -> str:
    """A condition on a label, as routes of alertmanager.yml have it."""
    found = text(value)
    if not _MATCHER.fullmatch(found):
        raise WrongValueError(f"{quoted(found)} is not a matcher", "write it like team = arms")
    return found


def minute(value: datetime) -> datetime:
    """A time without seconds: Alertmanager's hours have minutes."""
    if value.second:
        raise WrongValueError(f"{quoted(str(value))} has seconds", "use a full minute")
    return value


Email = Annotated[str, PlainValidator(email)]
Phone = Annotated[str, PlainValidator(phone)]
Matcher = Annotated[str, PlainValidator(matcher)]


class Entry(BaseModel):
    """A mapping in oncall.yml: unknown keys are errors, types are not converted."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class PersonEntry(Entry):
    """How a person is reached."""

    email: Email | None = None
    phone: Phone | None = None

    @model_validator(mode="after")
    def _can_be_reached(self) -> PersonEntry:
        if self.email is None and self.phone is None:
            raise WrongValueError("cannot be reached", "add email or phone")
        return self


class ShiftEntry(Entry):
    """People who take turns, around the clock or within hours."""

    people: list[Name] = Field(min_length=1)
    since: Moment  # the first person's first turn begins
    every: Literal["day", "week"] = "week"
    hours: list[WeeklyTime] | None = None
    time_zone: TimeZone | None = None  # None: that of the file

    @model_validator(mode="after")
    def _has_a_local_start(self) -> ShiftEntry:
        if self.since.tzinfo is not None:
            what = f"since {self.since.isoformat()} has an offset, which clocks change"
            raise WrongValueError(what, "write the time of day of every handover, in time_zone")
        minute(self.since)
        return self


class LevelEntry(Entry):
    """Who is on call for the alerts that alertmanager.yml sends to one receiver."""

    receiver: Name  # whose routes the level takes over
    like: list[Name] | None = None  # receivers to copy; None: `receiver` itself
    shifts: list[ShiftEntry] = Field(min_length=1)


class TeamEntry(Entry):
    """A team, its alerts, its levels of escalation."""

    name: Name
    matchers: list[Matcher] | None = None  # which alerts; None: all
    levels: dict[Name, LevelEntry] = Field(min_length=1)


class OverrideEntry(Entry):
    """A person who is on call for a while, whatever the shifts say."""

    person: Name
    start: Moment
    end: Moment
    instead_of: Name | None = None  # only where the shifts have this person
    team: Name | None = None
    level: Name | None = None
    comment: str | None = None

    @model_validator(mode="after")
    def _has_minutes(self) -> OverrideEntry:
        minute(self.start)
        minute(self.end)
        return self


class OnCallFile(Entry):
    """The file oncall.yml; docs/on-call.md explains its keys."""

    time_zone: TimeZone
    people: dict[Name, PersonEntry] = Field(min_length=1)
    teams: list[TeamEntry] = Field(min_length=1)
    overrides: list[OverrideEntry] | None = None


@dataclass(frozen=True)
class Person:
    """How a person is reached; one of the two may be missing."""

    name: str
    email: str | None
    phone: str | None


@dataclass(frozen=True)
class Level:
    """One level of one team, and its place in the file."""

    team: str
    name: str
    matchers: tuple[str, ...]
    receiver: str
    like: tuple[str, ...]
    shifts: tuple[Shift, ...]
    overrides: tuple[Override, ...]
    place: KeyPath

    @property
    def title(self) -> str:
        """The level for people, and the beginning of its receivers' names."""
        return f"{self.team}/{self.name}"

    def people(self) -> list[str]:
        """Everybody who is in one of its shifts, each once."""
        return list(dict.fromkeys(chain.from_iterable(shift.people for shift in self.shifts)))

    def everybody(self) -> list[str]:
        """`people`, and those who are there by an override only."""
        return list(dict.fromkeys([*self.people(), *(each.person for each in self.overrides)]))

    def stretches(self, begin: datetime, end: datetime) -> list[Stretch]:
        """Who is on call between the two; see `rota.stretches`."""
        return stretches(self.shifts, self.overrides, begin, end)


@dataclass(frozen=True)
class OnCall:
    """oncall.yml, valid in itself; whether its rotas have gaps depends on the time: `duties`."""

    document: Document
    zone: ZoneInfo  # of times without one
    people: dict[str, Person]
    levels: tuple[Level, ...]  # those of a team that matches first come first

    def duties(self, begin: datetime, end: datetime) -> dict[Level, list[Duty]]:
        """Who is on call between the two, at every level exactly one person at any time.

        Raises:
            ConfigError: at some time nobody is on call, or several people are; with the times.
        """
        found = {level: level.stretches(begin, end) for level in self.levels}
        problems = [each for level in found for each in self._clashes(level, found[level], begin)]
        if problems:
            raise ConfigError(problems)
        return {
            level: [Duty(each.start, each.end, *each.people) for each in found[level]]
            for level in found
        }

    def _clashes(
        self, level: Level, stretches: list[Stretch], begin: datetime
    ) -> Iterator[Finding]:
        wrong = [each for each in stretches if len(each.people) != 1]
        until = self.local(stretches[-1].end)
        more = f", and {len(wrong) - _SHOWN} more gaps or overlaps until {until}"
        for number, each in enumerate(wrong[:_SHOWN], start=1):
            people, start = sorted(each.people), max(each.start, begin)
            who = f"{' and '.join(people)} are all on call" if people else "nobody is on call"
            what = f"from {self.local(start)} until {self.local(each.end)} {who}"
            what += more if number == _SHOWN < len(wrong) else ""
            remedy = "leave one of them" if people else "add a shift, hours or an override"
            yield self.document.problem(level.place, what, remedy)

    def days(self, duties: Iterable[Duty], person: str, begin: datetime) -> Counter[str]:
        """On how many Mondays, Tuesdays and so on a person is on call, from ``begin`` on."""
        dates: set[date] = set()
        for duty in duties:
            if duty.person == person:
                both = max(duty.start, begin), duty.end - _TICK
                first, last = (at.astimezone(self.zone).toordinal() for at in both)
                dates.update(map(date.fromordinal, range(first, last + 1)))
        return Counter(DAYS[each.weekday()] for each in dates)

    def warnings(self) -> Iterator[Finding]:
        """Shifts with turns of a day whose handover divides the hours of a day."""
        for level in self.levels:
            for at, shift in enumerate(level.shifts):
                if shift.cut is None:
                    continue
                first, last = (f"{each // 60 % 24:02}:{each % 60:02}" for each in shift.cut)
                what = (
                    f"the handover at {shift.since:%H:%M} divides the hours {first}-{last}, so "
                    "each part is a turn of its own"
                )
                remedy = f"write the beginning of the hours, T{first}"
                yield self.document.problem((*level.place, "shifts", at, "since"), what, remedy)

    def local(self, when: datetime) -> str:
        """A time for people, in the file's time zone."""
        return f"{when.astimezone(self.zone):%Y-%m-%d %a %H:%M %Z}"


_TICK = timedelta(microseconds=1)
_SHOWN = 3  # gaps and overlaps of a level: most come back every week


def load(path: Path) -> OnCall:
    """Read oncall.yml.

    Raises:
        ConfigError: it cannot be used; one line for each problem.
    """
    document, problems = read(path)
    if document is None or problems:
        raise ConfigError(problems, [path])
    try:
        content = OnCallFile.model_validate(document.data if document.data is not None else {})
    except ValidationError as error:
        explained = (explanation(each, OnCallFile) for each in error.errors(include_url=False))
        raise ConfigError([document.problem(*each) for each in explained], [path]) from None
    problems = [*_unknown(document, content), *_twice(document, content), *_wide(document, content)]
    if problems:
        raise ConfigError(problems, [path])
    return _resolved(document, content)


def _unknown(document: Document, content: OnCallFile) -> Iterator[Finding]:
    """Names of people, teams and levels that are not in the file; overrides that end early."""
    people, teams = list(content.people), [team.name for team in content.teams]
    levels = [level for team in content.teams for level in team.levels]
    named: list[tuple[KeyPath, str | None, list[str]]] = [
        (("teams", t, "levels", name, "shifts", s, "people", p), person, people)
        for t, team in enumerate(content.teams)
        for name, level in team.levels.items()
        for s, shift in enumerate(level.shifts)
        for p, person in enumerate(shift.people)
    ]
    zone = ZoneInfo(content.time_zone)
    for at, override in enumerate(content.overrides or ()):
        place = ("overrides", at)
        named += [
            ((*place, "person"), override.person, people),
            ((*place, "instead_of"), override.instead_of, people),
            ((*place, "team"), override.team, teams),
            ((*place, "level"), override.level, levels),
        ]
        if _moment(override.end, zone) <= _moment(override.start, zone):
            what = f"{quoted(str(override.end))} is not after {quoted(str(override.start))}"
            yield document.problem((*place, "end"), what, "let it end after its start")
    for where, name, known in named:
        if name is not None and name not in known:
            yield document.problem(where, f"{quoted(name)} is unknown", suggestion(name, known))


def _twice(document: Document, content: OnCallFile) -> Iterator[Finding]:
    for at, team in enumerate(content.teams):
        before = content.teams[:at]
        if team.name in [other.name for other in before]:
            remedy = "give each team a name of its own"
            yield document.problem(("teams", at), f"{quoted(team.name)} is used twice", remedy)
        if any(not other.matchers for other in before):
            what = "gets no alerts: a team without matchers, before it, gets all"
            remedy = "move the team without matchers to the end"
            yield document.problem(("teams", at), what, remedy)
            return


def _wide(document: Document, content: OnCallFile) -> Iterator[Finding]:
    """Overrides that would put one person on call at several levels at once."""
    for at, entry in enumerate(content.overrides or ()):
        levels = [
            f"{team.name}/{level}"
            for team in content.teams
            for level in team.levels
            if entry.team in (None, team.name) and entry.level in (None, level)
        ]
        if entry.instead_of is None and len(levels) > 1:
            what = f"puts {entry.person} on call for {', '.join(levels)} at once"
            remedy = "add instead_of, or team and level"
            yield document.problem(("overrides", at), what, remedy)


def _resolved(document: Document, content: OnCallFile) -> OnCall:
    zone = ZoneInfo(content.time_zone)
    people = {
        name: Person(name, person.email, person.phone) for name, person in content.people.items()
    }
    levels = (
        Level(
            team.name,
            name,
            tuple(team.matchers or ()),
            level.receiver,
            tuple(level.like or [level.receiver]),
            tuple(_shift(shift, zone) for shift in level.shifts),
            tuple(_overrides(content.overrides or (), team.name, name, zone)),
            ("teams", at, "levels", name),
        )
        for at, team in enumerate(content.teams)
        for name, level in team.levels.items()
    )
    return OnCall(document, zone, people, tuple(levels))


def _shift(entry: ShiftEntry, zone: ZoneInfo) -> Shift:
    return Shift(
        tuple(entry.people),
        entry.since,
        timedelta(days=1 if entry.every == "day" else 7),
        ZoneInfo(entry.time_zone) if entry.time_zone else zone,
        tuple(chain.from_iterable(entry.hours or ())),
    )


def _overrides(
    entries: Iterable[OverrideEntry], team: str, level: str, zone: ZoneInfo
) -> Iterator[Override]:
    for entry in entries:
        if entry.team in (None, team) and entry.level in (None, level):
            start, end = _moment(entry.start, zone), _moment(entry.end, zone)
            yield Override(start, end, entry.person, entry.instead_of)


def _moment(time: datetime, zone: ZoneInfo) -> datetime:
    """A time of the file as an instant in UTC."""
    return time.astimezone(timezone.utc) if time.tzinfo else instant(time, zone)
