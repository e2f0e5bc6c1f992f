"""Times of planned downtimes as fleet.yml writes them -> Unix time, minutes of the week."""

from __future__ import annotations

import re
import zoneinfo
from datetime import datetime
from typing import Annotated, Any

from pydantic import PlainValidator, WithJsonSchema

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.scalars import shown, text

DAYS = ("Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun")
DAY = 24 * 60  # minutes
_DAY = "(?:Mon|Tue|Wed|Thu|Fri|Sat|Sun)"
_DAYS = rf"{_DAY}(?:-{_DAY})?(?:,{_DAY}(?:-{_DAY})?)*|daily"
_CLOCK = r"(?:[01]\d|2[0-3]):[0-5]\d|24:00"
_WEEKLY = re.compile(rf"({_DAYS}) ({_CLOCK})-({_CLOCK})", re.ASCII)
_MOMENT = r"\d{4}-\d\d-\d\d(?:[T ]\d\d:\d\d(?::\d\d)?(?:Z|[+-]\d\d:\d\d)?)?"

Weekly = tuple[int, int, int]


def weekly(value: Any) -> tuple[Weekly, ...]:
    """`Mon-Fri 22:00-06:00` -> (weekday, from, to) in minutes; beyond 1440 is the day after."""
    found = text(value)
    match = _WEEKLY.fullmatch(found)
    if match is None:
        remedy = (
            "write days and times as Mon-Fri 22:00-06:00, Sat,Sun 00:00-24:00, daily 12:00-13:00"
        )
        raise WrongValueError(f"{shown(found)} is not a weekly time", remedy)
    days, start, end = match.groups()
    first, last = _minutes(start), _minutes(end)
    if first in (last, DAY):
        raise WrongValueError(f"{shown(found)} lasts no time", "write 00:00-24:00 for a whole day")
    return tuple((day, first, last if last > first else last + DAY) for day in _days(days))


def _days(written: str) -> list[int]:
    if written == "daily":
        return list(range(7))
    found: set[int] = set()
    for part in written.split(","):
        first, _, last = part.partition("-")
        begin, end = DAYS.index(first), DAYS.index(last or first)
        found.update(day % 7 for day in range(begin, end + 1 if end >= begin else end + 8))
    return sorted(found)


def _minutes(clock: str) -> int:
    hours, minutes = clock.split(":")
    return int(hours) * 60 + int(minutes)


def moment(value: Any) -> datetime:
    """A date and time by ISO 8601; without an offset it is meant in the entry's time zone."""
    remedy = "write it as 2026-03-28T22:00 or 2026-03-28T22:00:00+01:00"
    found = text(value)
    if not re.fullmatch(_MOMENT, found, re.ASCII):
        raise WrongValueError(f"{shown(found)} is not a date and time", remedy)
    try:
        # Python 3.10 does not know "Z".
        return datetime.fromisoformat(found.replace("Z", "+00:00"))
    except ValueError:
        raise WrongValueError(f"{shown(found)} is not in the calendar", remedy) from None


def time_zone(value: Any) -> str:
    """The IANA name of a time zone that this machine has rules for."""
    found = text(value)
    try:
        zoneinfo.ZoneInfo(found)
    except (zoneinfo.ZoneInfoNotFoundError, ValueError, OSError):
        remedy = "use a name from the IANA list, as Europe/Berlin (install tzdata if it is missing)"
        raise WrongValueError(f"{shown(found)} is not a time zone known here", remedy) from None
    return found


WeeklyTime = Annotated[
    tuple[Weekly, ...],
    PlainValidator(weekly),
    WithJsonSchema({"title": "weekly time", "type": "string", "pattern": f"^{_WEEKLY.pattern}$"}),
]
Moment = Annotated[
    datetime,
    PlainValidator(moment),
    WithJsonSchema({"title": "date and time", "type": "string", "pattern": f"^{_MOMENT}$"}),
]
TimeZone = Annotated[
    str,
    PlainValidator(time_zone),
    WithJsonSchema({"title": "time zone", "type": "string", "minLength": 1}),
]
