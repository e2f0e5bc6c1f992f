"""What outlives the process, each field described once: its type, how it is written and read.

`rows` applies the tables to records; times in rows are Unix time. A field that a row lacks is read
as its default, so that rows of an earlier version are still read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from enum import Enum
from math import inf
from types import MappingProxyType
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, TypeAdapter, ValidationError, create_model

from ros_diagnostics_exporter.config.errors import first_error
from ros_diagnostics_exporter.faults.model import (
    DOWNTIMES,
    LEARNED,
    MISSIONS,
    CapabilityState,
    PartName,
    Row,
    Verdict,
)
from ros_diagnostics_exporter.faults.needs import Bad
from ros_diagnostics_exporter.faults.records import SLOTS, FlapHistory, Presence
from ros_diagnostics_exporter.model import Instant, Level
from ros_diagnostics_exporter.robots.missions import MissionsLearned
from ros_diagnostics_exporter.sources.robot_graph import Learned

# Limits for what is read from the file: whatever passes them can be restored and served; NaN does
# not.
NEVER = 1e11  # Unix time of what does not come
Moment = Annotated[float, Field(ge=-NEVER, le=NEVER)]
Seconds = Annotated[float, Field(ge=0, le=1e11)]
Interval = Annotated[float, Field(gt=0, le=1e11)]
Text = Annotated[str, Field(max_length=4096)]
Labels = Annotated[dict[Text, Text], Field(max_length=1000)]


class Clock:
    """Turns readings of the monotonic clock into Unix time and back, by one Instant."""

    def __init__(self, now: Instant) -> None:
        self.offset = now.wall - now.mono

    def wall(self, mono: float | None) -> float | None:
        """The Unix time; None for never."""
        return None if mono is None or mono == -inf else mono + self.offset

    def mono(self, wall: float | None) -> float:
        """The monotonic clock's reading then."""
        return -inf if wall is None else wall - self.offset

    def instant(self, wall: float | None) -> Instant | None:
        """Both."""
        return None if wall is None else Instant(wall - self.offset, wall)


class Kind(NamedTuple):
    """A kind of field: its type as JSON, the value of a field that a row lacks, and both ways."""

    type: Any
    default: Any = ...
    write: Callable[[Any, Clock], Any] = lambda value, _clock: value
    read: Callable[[Any, Clock], Any] = lambda value, _clock: value


Table = Mapping[str, Kind]  # by the name of the record's attribute


def write(table: Table, record: object, clock: Clock) -> dict[str, Any]:
    """The fields of a record as JSON has them."""
    return {name: kind.write(getattr(record, name), clock) for name, kind in table.items()}


def read(table: Table, fields: Mapping[str, Any], clock: Clock) -> dict[str, Any]:
    """The attributes that `write` wrote, by name."""
    return {name: kind.read(fields[name], clock) for name, kind in table.items()}


_MONO = Kind(
    Moment | None, None, lambda mono, clock: clock.wall(mono), lambda wall, clock: clock.mono(wall)
)
_MONO_OR_NONE = _MONO._replace(read=lambda wall, clock: None if wall is None else clock.mono(wall))
_INSTANT = Kind(
    Moment | None,
    None,
    lambda instant, _clock: None if instant is None else instant.wall,
    lambda wall, clock: clock.instant(wall),
)
_LABELS = Kind(
    Labels, write=lambda labels, _: dict(labels), read=lambda labels, _: MappingProxyType(labels)
)


class _History(NamedTuple):
    """The states of one thing that may flap."""

    slots: Annotated[list[Level], Field(min_length=SLOTS, max_length=SLOTS)]
    last: Moment
    changed: Annotated[list[Moment], Field(max_length=SLOTS - 1)] = []  # noqa: RUF012


def _write_history(history: FlapHistory | None, clock: Clock) -> dict[str, Any] | None:
    if history is None:
        return None
    changed = [mono + clock.offset for mono in history.changed]
    return {
        "slots": [*history.slots],
        "last": history.last + clock.offset,
        "changed": changed,
    }


def _read_history(stored: _History | None, clock: Clock) -> FlapHistory | None:
    if stored is None:
        return None
    history = FlapHistory(stored.slots, clock.mono(stored.last))
    history.changed = tuple(map(clock.mono, stored.changed))
    return history


_HISTORY = Kind(_History | None, None, _write_history, _read_history)
_Part = tuple[Text, Text, Text, Text, Text, CapabilityState, Moment]
_PARTS = Kind(
    list[_Part],
    write=lambda parts, clock: [
        (*part, int(bad.state), min(bad.due + clock.offset, NEVER)) for part, bad in parts.items()
    ],
    read=lambda parts, clock: {
        PartName(*part): Bad(state, clock.mono(due)) for *part, state, due in parts
    },
)
_DEPENDS_ON = Kind(
    Annotated[list[tuple[Text, Text]], Field(max_length=1000)],
    [],
    lambda names, _clock: sorted(names),
    lambda names, _clock: frozenset(names),
)


def _enum(enum: type[Enum]) -> Kind:
    return Kind(enum, write=lambda value, _clock: value.value)


def _schema(name: str, *tables: Table) -> Any:
    """What validates the rows that these tables write."""
    fields = {key: (kind.type, kind.default) for table in tables for key, kind in table.items()}
    return create_model(name, **fields)  # type: ignore[call-overload]


def _record(name: str, table: Table) -> Kind:
    """A field that is a record itself, or None; it is read as its attributes by name."""
    return Kind(
        _schema(name, table) | None,
        write=lambda record, clock: None if record is None else write(table, record, clock),
        read=lambda stored, clock: None if stored is None else read(table, vars(stored), clock),
    )


# What another explained, of each subject.
_EXPLAINED: Table = {"explained_until": _MONO, "returns_until": _MONO}
FLEET: Table = {"settled_at": _MONO, "grace_until": _MONO}
ROBOT_SETTINGS: Table = {
    "labels": _LABELS,
    "confirm_after": Kind(Seconds),
    "flap_interval": Kind(Interval),
    "presence_interval": Kind(Interval),
    "boot_grace": Kind(Seconds, 0.0),
}
ROBOT: Table = {
    "declared": Kind(bool),
    "presence": _enum(Presence),
    "maintenance": Kind(bool),
    "maintained": Kind(
        Annotated[list[Text], Field(max_length=1000)],
        [],
        lambda names, _clock: sorted(names),
        lambda names, _clock: frozenset(names),
    ),
    "returned_until": _MONO,
    "booted_until": _MONO,
    "is_restarted": Kind(bool, default=False),
    "history_before": _HISTORY,
    "total": Kind(Annotated[int, Field(ge=0)]),
    "counted": Kind(bool),
    "history": _HISTORY,
    **_EXPLAINED,
}
_COMPONENT_SETTINGS: Table = {
    "confirm_after": Kind(Seconds),
    "planned_stale": Kind(bool),
    "stale_is_critical": Kind(bool),
    "measured": Kind(bool, default=False),
    "uplink": Kind(bool, default=False),
    "depends_on": _DEPENDS_ON,
}
COMPONENT: Table = {
    "settings": _record("settings", _COMPONENT_SETTINGS),
    "level": _enum(Level),
    "since": _INSTANT,
    "counted": Kind(bool),
    "flaps": _HISTORY,
    "boots_until": _MONO,
    **_EXPLAINED,
}
CAUSE: Table = {"active": _INSTANT, "adopted": Kind(bool)}
CAPABILITY: Table = {
    "worst": _enum(CapabilityState),
    "parts": _PARTS,
    "adopted": Kind(bool, default=False),
    **_EXPLAINED,
}
_FAULT: Table = {
    "since": Kind(Moment),
    "confirmed": Kind(Moment),
    "labels": _LABELS,
    "evidence": Kind(Text),
    "capabilities": Kind(Text, ""),
    "details": Kind(
        Annotated[dict[Text, Any], Field(max_length=100)], {}, lambda each, _: dict(each)
    ),
}
PROBLEM: Table = {
    "since": _INSTANT._replace(type=Moment, default=...),
    "clock": _MONO._replace(type=Moment, default=...),
    "verdict": _enum(Verdict),
    "fault": _record("fault", _FAULT),
    "waits_since": _MONO_OR_NONE,
    "by_setting": Kind(bool, default=False),
    "boots_until": _MONO,
    **_EXPLAINED,
}
END: Table = {
    "reason": Kind(Literal["recovered", "removed"]),
    "at": Kind(Moment),
    "message": Kind(Text),
    "since": Kind(Moment),
    "labels": _LABELS,
}

SCHEMAS: dict[str, TypeAdapter[Any]] = {  # by kind, in the order in which they refer to each other
    kind: TypeAdapter(_schema(kind, *tables))
    for kind, tables in {
        "fleet": (FLEET,),
        "robot": (ROBOT_SETTINGS, ROBOT),
        "component": (COMPONENT,),
        "cause": (CAUSE,),
        "capability": (CAPABILITY,),
        "problem": (PROBLEM,),
        "end": (END,),
    }.items()
}


class _Downtime(NamedTuple):
    robot: Text
    component: Text
    start: Moment
    end: Moment
    author: Text
    comment: Text


class _Downtimes(NamedTuple):
    planned: Annotated[list[_Downtime], Field(max_length=1000)]


_FIELDS = {
    **SCHEMAS,
    DOWNTIMES: TypeAdapter(_Downtimes),
    LEARNED: TypeAdapter(Learned),
    MISSIONS: TypeAdapter(MissionsLearned),
}
_ROW: TypeAdapter[Any] = TypeAdapter(
    tuple[
        Text,
        Annotated[tuple[Text, ...], Field(max_length=10)],
        dict[str, Any],
    ]
)


def parse(stored: Iterable[Any]) -> tuple[list[Row], list[str]]:
    """The rows that are valid, and what is wrong with each of the others."""
    rows: list[Row] = []
    wrong: list[str] = []
    for content in stored:
        row = _row(content)
        if isinstance(row, Row):
            rows.append(row)
        else:
            wrong.append(row)
    return rows, wrong


def _row(content: Any) -> Row | str:
    """One row, or what is wrong with it."""
    try:
        kind, key, fields = _ROW.validate_python(content)
    except ValidationError as error:
        return f"a row of the faults: {first_error(error)}"
    row = Row(kind, key, fields)
    try:
        _FIELDS[kind].validate_python(fields)
    except KeyError:
        return f"{named(row)}: there are no rows of this kind"
    except ValidationError as error:
        return f"{named(row)}: {first_error(error)}"
    return row


def named(row: Row) -> str:
    """Which row of the faults it is, for the log."""
    return f"{row.kind} {' '.join(filter(None, row.key))!r:.60}"
