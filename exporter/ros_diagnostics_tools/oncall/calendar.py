"""Duties as an iCalendar file (RFC 5545), for the calendars of people.

The library `icalendar` escapes texts and folds lines. It is an extra: nothing else
needs it.
Times are in UTC, which every calendar shows in its owner's time zone.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime

try:
    import icalendar
except ImportError:
    icalendar = None

from ros_diagnostics_exporter.extras import install_command
from ros_diagnostics_tools.oncall.file import Level
from ros_diagnostics_tools.oncall.rota import Duty


class NoCalendarError(Exception):
    """The library is not installed; the text says how to get it."""


def calendar(duties: Mapping[Level, Sequence[Duty]], now: datetime, people: Iterable[str]) -> bytes:
    """An iCalendar file with one event for each duty of ``people``.

    The UID of an event is the same in every export, so that a calendar updates it.

    Raises:
        NoCalendarError: the library is not installed.
    """
    if icalendar is None:
        remedy = install_command("icalendar")
        raise NoCalendarError(f"the library icalendar is not installed: {remedy}")
    found, wanted = icalendar.Calendar(), set(people)
    found.add("version", "2.0")
    found.add("prodid", "-//ros-diagnostics-exporter//on call//EN")
    found.add("x-wr-calname", f"on call: {', '.join(sorted(wanted))}")
    for level, each in duties.items():
        for duty in each:
            if duty.person in wanted:
                found.add_component(_event(level, duty, now))
    return bytes(found.to_ical())


def _event(level: Level, duty: Duty, now: datetime) -> icalendar.Event:
    event = icalendar.Event()
    event.add("uid", f"{duty.start:%Y%m%dT%H%MZ}-{level.team}-{level.name}@ros-diagnostics-oncall")
    event.add("dtstamp", now)
    event.add("dtstart", duty.start)
    event.add("dtend", duty.end)
    event.add("summary", f"{duty.person} is on call: {level.team}, {level.name}")
    return event
