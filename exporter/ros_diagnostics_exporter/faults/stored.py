"""The fields of the rows of faults, each described once: its name, its type and its limits.

`rows` writes and reads them; times in them are Unix time. What of a file cannot be restored is
named by `parse`.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, TypeAdapter, ValidationError

from ros_diagnostics_exporter.config.errors import first_error
from ros_diagnostics_exporter.faults.model import DOWNTIMES, LEARNED, Row
from ros_diagnostics_exporter.faults.records import SLOTS
from ros_diagnostics_exporter.sources.robot_graph import Learned

# Limits for what is read from the file: whatever passes them can be restored and served; NaN does
# not.
Moment = Annotated[float, Field(ge=-1e11, le=1e11)]
Seconds = Annotated[float, Field(ge=0, le=1e11)]
Interval = Annotated[float, Field(gt=0, le=1e11)]
Text = Annotated[str, Field(max_length=4096)]
Number = Annotated[int, Field(ge=0, le=3)]
Labels = Annotated[dict[Text, Text], Field(max_length=1000)]


class History(NamedTuple):
    """The states of one thing that may flap."""

    slots: Annotated[list[Number], Field(min_length=SLOTS, max_length=SLOTS)]
    last: Moment
    changed: Annotated[list[Moment], Field(max_length=SLOTS - 1)]


class StoredSettings(NamedTuple):
    """How a component is judged."""

    confirm_after: Seconds
    planned_stale: bool
    stale_is_critical: bool
    behind: Annotated[list[tuple[Text, Text]], Field(max_length=1000)] = []  # noqa: RUF012


class StoredFault(NamedTuple):
    """What is fixed when a problem is confirmed."""

    since: Moment
    confirmed: Moment
    labels: Labels
    evidence: Text
    work: Text
    details: Annotated[dict[Text, Any], Field(max_length=100)] = {}  # noqa: RUF012


class OfFleet(NamedTuple):
    """The times of a start."""

    settled_at: Moment | None
    grace_until: Moment | None


class OfRobot(NamedTuple):
    """A robot."""

    labels: Labels
    confirm_after: Seconds
    flap_interval: Interval
    presence_interval: Interval
    declared: bool
    presence: Literal["never", "silent", "up"]
    maintenance: bool
    returned_until: Moment | None
    total: Annotated[int, Field(ge=0)]
    counted: bool
    history: History | None


class OfComponent(NamedTuple):
    """A component in trouble."""

    settings: StoredSettings
    level: Number
    since: Moment | None
    counted: bool
    flaps: History | None
    explained_until: Moment | None = None


class OfCause(NamedTuple):
    """A larger cause."""

    active: Moment | None
    covers_until: Moment | None
    adopted: bool


class OfCapability(NamedTuple):
    """A capability in trouble; each part with how good it is."""

    active: Moment | None
    covers_until: Moment | None
    worst: Annotated[int, Field(ge=0, le=4)]
    parts: list[tuple[Text, Text, Text, Text, Text, Annotated[int, Field(ge=0, le=4)], Moment]]


class OfProblem(NamedTuple):
    """A problem."""

    since: Moment
    clock: Moment
    verdict: Number
    fault: StoredFault | None


class OfEnd(NamedTuple):
    """What ended a fault."""

    reason: Literal["recovered", "removed"]
    at: Moment
    message: Text
    since: Moment
    labels: Labels


Stored = OfFleet | OfRobot | OfComponent | OfCause | OfCapability | OfProblem | OfEnd
SCHEMAS: dict[str, TypeAdapter[Any]] = {  # by kind, in the order in which they refer to each other
    "fleet": TypeAdapter(OfFleet),
    "robot": TypeAdapter(OfRobot),
    "component": TypeAdapter(OfComponent),
    "cause": TypeAdapter(OfCause),
    "capability": TypeAdapter(OfCapability),
    "problem": TypeAdapter(OfProblem),
    "end": TypeAdapter(OfEnd),
}


def as_fields(stored: Stored | History | StoredSettings | StoredFault) -> dict[str, object]:
    """The fields by name, as JSON has them; `SCHEMAS` read them again."""
    nested = History, StoredSettings, StoredFault
    return {
        name: as_fields(value) if isinstance(value, nested) else value
        for name, value in stored._asdict().items()
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


_FIELDS = {**SCHEMAS, DOWNTIMES: TypeAdapter(_Downtimes), LEARNED: TypeAdapter(Learned)}
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
