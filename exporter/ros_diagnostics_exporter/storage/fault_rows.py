"""The rows of faults as a file has them, and what is wrong with those that cannot be restored."""

from __future__ import annotations

from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field, TypeAdapter, ValidationError

from ros_diagnostics_exporter.config.errors import first_error
from ros_diagnostics_exporter.faults.flapping import SLOTS
from ros_diagnostics_exporter.faults.model import DOWNTIMES, Row

# Limits for what is read from the file: whatever passes them can be restored and served.
_Moment = Annotated[float, Field(ge=-1e11, le=1e11, allow_inf_nan=False)]
_Seconds = Annotated[float, Field(ge=0, le=1e11, allow_inf_nan=False)]
_Interval = Annotated[float, Field(gt=0, le=1e11, allow_inf_nan=False)]
_Text = Annotated[str, Field(max_length=4096)]
_Number = Annotated[int, Field(ge=0, le=3)]
_Labels = Annotated[dict[_Text, _Text], Field(max_length=1000)]


class _History(NamedTuple):
    slots: Annotated[list[_Number], Field(min_length=SLOTS, max_length=SLOTS)]
    last: _Moment


class _Settings(NamedTuple):
    confirm_after: _Seconds
    planned_stale: bool
    stale_is_critical: bool


class _Fault(NamedTuple):
    since: _Moment
    confirmed: _Moment
    labels: _Labels
    evidence: _Text
    work: _Text = ""


class _Downtime(NamedTuple):
    robot: _Text
    component: _Text
    start: _Moment
    end: _Moment
    author: _Text
    comment: _Text


class _Downtimes(NamedTuple):
    planned: Annotated[list[_Downtime], Field(max_length=1000)]


class _OfFleet(NamedTuple):
    settled_at: _Moment | None
    grace_until: _Moment | None


class _OfRobot(NamedTuple):
    labels: _Labels
    confirm_after: _Seconds
    flap_interval: _Interval
    presence_interval: _Interval
    declared: bool
    presence: Literal["never", "silent", "up"]
    maintenance: bool
    returned_until: _Moment | None
    total: Annotated[int, Field(ge=0)]
    counted: bool
    history: _History | None


class _OfComponent(NamedTuple):
    settings: _Settings
    level: _Number
    since: _Moment | None
    counted: bool
    flaps: _History | None


class _OfCause(NamedTuple):
    active: _Moment | None
    covers_until: _Moment | None
    adopted: bool


class _OfProblem(NamedTuple):
    since: _Moment
    clock: _Moment
    verdict: _Number
    fault: _Fault | None


class _OfEnd(NamedTuple):
    reason: Literal["recovered", "removed"]
    at: _Moment
    message: _Text
    since: _Moment
    labels: _Labels


_FIELDS: dict[str, TypeAdapter[Any]] = {
    DOWNTIMES: TypeAdapter(_Downtimes),
    "fleet": TypeAdapter(_OfFleet),
    "robot": TypeAdapter(_OfRobot),
    "component": TypeAdapter(_OfComponent),
    "cause": TypeAdapter(_OfCause),
    "problem": TypeAdapter(_OfProblem),
    "end": TypeAdapter(_OfEnd),
}
_ROW: TypeAdapter[Any] = TypeAdapter(
    tuple[
        Literal["downtimes", "fleet", "robot", "component", "cause", "problem", "end"],
        Annotated[tuple[_Text, ...], Field(max_length=10)],
        dict[str, Any],
    ]
)


def parse(found: Any) -> tuple[list[Row], str]:
    """The rows that are valid, and what is wrong with the others; "" for nothing."""
    if not isinstance(found, list):
        return [], "its faults are no list"
    rows: list[Row] = []
    wrong: list[str] = []
    for number, each in enumerate(found, 1):
        row = _row(each)
        if isinstance(row, Row):
            rows.append(row)
        else:
            wrong.append(f"row {number} of its faults: {row}")
    more = f", and {len(wrong) - 1} more rows" if len(wrong) > 1 else ""
    return rows, f"{wrong[0]}{more}" if wrong else ""


def _row(found: Any) -> Row | str:
    """One row, or what is wrong with it."""
    try:
        kind, key, fields = _ROW.validate_python(found)
        _FIELDS[kind].validate_python(fields)
    except ValidationError as error:
        return first_error(error)
    return Row(kind, key, fields)
