"""Names and units of values: what Prometheus allows, and what would clash with ours.

Source of the rules: https://prometheus.io/docs/concepts/data_model/ and
https://prometheus.io/docs/practices/naming/.
"""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import PlainValidator, WithJsonSchema

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.reserved import (
    NON_BASE_UNITS,
    RESERVED_METRIC_PREFIXES,
    RESERVED_METRIC_SUFFIXES,
    RESERVED_METRICS,
)
from ros_diagnostics_exporter.config.scalars import MAX_NAME, shown, text

_METRIC = r"[a-zA-Z_][a-zA-Z0-9_]*"


def metric_name(value: Any) -> str:
    """The name of a gauge that a key-value may be promoted to."""
    found = text(value)
    remedy = "use a name such as ros_battery_voltage_volts"
    if len(found) > MAX_NAME or not re.fullmatch(_METRIC, found, re.ASCII):
        raise WrongValueError(
            f"{shown(found)} is not a metric name (letters, digits and _)", remedy
        )
    if found in RESERVED_METRICS or found.startswith(RESERVED_METRIC_PREFIXES):
        raise WrongValueError(f"the metric name {shown(found)} is taken", remedy)
    for suffix in RESERVED_METRIC_SUFFIXES:
        if found.endswith(suffix):
            what = f"{shown(found)} ends in {suffix}, which a gauge may not"
            raise WrongValueError(what, remedy)
    return found


def unit(value: Any) -> str:
    """A unit as people write it: a short text without control characters."""
    found = text(value)
    if not 1 <= len(found.strip()) == len(found) <= 16 or not found.isprintable():
        raise WrongValueError(
            f"{shown(found)} is not a unit", "use 1 to 16 characters, as V, %, °C"
        )
    return found


def base_unit_for(metric: str) -> str | None:
    """The base unit that the name should end in, if it ends in another; else None."""
    return NON_BASE_UNITS.get(metric.rpartition("_")[2])


MetricName = Annotated[
    str,
    PlainValidator(metric_name),
    WithJsonSchema(
        {"title": "metric name", "type": "string", "pattern": f"^{_METRIC}$", "maxLength": MAX_NAME}
    ),
]
Unit = Annotated[
    str,
    PlainValidator(unit),
    WithJsonSchema({"title": "unit", "type": "string", "minLength": 1, "maxLength": 16}),
]
