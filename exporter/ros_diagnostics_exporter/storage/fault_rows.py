"""The rows of faults as a file has them, and what is wrong with those that cannot be restored."""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

from pydantic import Field, TypeAdapter, ValidationError

from ros_diagnostics_exporter.config.errors import first_error
from ros_diagnostics_exporter.faults.model import DOWNTIMES, LEARNED, Row
from ros_diagnostics_exporter.faults.stored import SCHEMAS, Moment, Text
from ros_diagnostics_exporter.sources.graph import Learned


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
    except KeyError as error:
        return f"there are no rows of kind {error}"
    except ValidationError as error:
        return first_error(error)
    return Row(kind, key, fields)
