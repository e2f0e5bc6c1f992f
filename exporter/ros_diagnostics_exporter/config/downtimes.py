"""Maintenance entries -> downtimes in Unix time and minutes of the week."""

from __future__ import annotations

from datetime import datetime
from itertools import chain
from types import MappingProxyType
from zoneinfo import ZoneInfo

from ros_diagnostics_exporter.config.errors import Problem
from ros_diagnostics_exporter.config.fleet import Maintenance
from ros_diagnostics_exporter.config.model import MaintenanceEntry
from ros_diagnostics_exporter.config.validate import Placed

UTC = "UTC"


def downtimes(
    entries: list[Placed[MaintenanceEntry]], problems: list[Problem]
) -> tuple[Maintenance, ...]:
    """The downtimes in the order of the files; one that ends before it begins is a problem."""
    made = []
    for placed in entries:
        downtime = _downtime(placed.entry)
        if None not in (downtime.start, downtime.end) and downtime.end <= downtime.start:  # type: ignore[operator]
            what = "is not after start"
            problems.append(placed.problem("end", what=what, remedy="put end after start"))
        made.append(downtime)
    return tuple(made)


def _downtime(entry: MaintenanceEntry) -> Maintenance:
    zone = entry.time_zone or UTC
    return Maintenance(
        name=entry.name,
        selector=MappingProxyType(entry.selector),
        comment=entry.comment,
        start=_unix(entry.start, zone),
        end=_unix(entry.end, zone),
        weekly=tuple(chain.from_iterable(entry.weekly or ())),
        time_zone=zone,
    )


def _unix(moment: datetime | None, zone: str) -> float | None:
    if moment is None:
        return None
    aware = moment if moment.tzinfo else moment.replace(tzinfo=ZoneInfo(zone))
    return aware.timestamp()
