"""Names and units of values: what Prometheus allows, and what the exporter uses itself.

Source of the rules: https://prometheus.io/docs/concepts/data_model/ and
https://prometheus.io/docs/practices/naming/.
"""

from __future__ import annotations

from typing import Annotated, Any

from ros_diagnostics_exporter.config.errors import WrongValueError, quoted
from ros_diagnostics_exporter.config.keys import Value
from ros_diagnostics_exporter.config.scalars import MAX_NAME, matching, text

# Of the exporter's families, of Prometheus' client and of Prometheus itself.
RESERVED_METRIC_PREFIXES = (
    *("ros_diagnostics_", "process_", "python_", "scrape_", "prometheus_", "alertmanager_"),
    *("ALERTS", "target_info"),
)
RESERVED_METRICS = frozenset({"up"})
# Of series of other types: a gauge with such a name would be read as a part of one.
RESERVED_METRIC_SUFFIXES = ("_total", "_info", "_bucket", "_sum", "_count", "_created")

# https://prometheus.io/docs/practices/naming/#base-units
NON_BASE_UNITS = {
    **dict.fromkeys(("milliseconds", "microseconds", "nanoseconds", "ms", "us"), "seconds"),
    **dict.fromkeys(("minutes", "hours", "days", "weeks"), "seconds"),
    **dict.fromkeys(("percent", "percents"), "ratio"),
    **dict.fromkeys(("fahrenheit", "kelvin"), "celsius"),
    **dict.fromkeys(("millivolts", "kilovolts"), "volts"),
    **dict.fromkeys(("milliamps", "milliamperes"), "amperes"),
    **dict.fromkeys(("millimeters", "centimeters", "kilometers"), "meters"),
    **dict.fromkeys(("bits", "kilobytes", "megabytes", "gigabytes"), "bytes"),
    **dict.fromkeys(("milligrams", "kilograms"), "grams"),
}

_METRIC = r"[a-zA-Z_][a-zA-Z0-9_]*"


def metric_name(value: Any) -> str:
    """The name of a gauge of its own for a key-value."""
    remedy = "use a name such as ros_battery_voltage_volts"
    what = "is not a metric name (letters, digits and _)"
    found = matching(value, _METRIC, what, remedy, MAX_NAME)
    if found in RESERVED_METRICS or found.startswith(RESERVED_METRIC_PREFIXES):
        raise WrongValueError(f"the metric name {quoted(found)} is reserved", remedy)
    for suffix in RESERVED_METRIC_SUFFIXES:
        if found.endswith(suffix):
            what = f"{quoted(found)} ends in {suffix}, which a gauge may not"
            raise WrongValueError(what, remedy)
    return found


def unit(value: Any) -> str:
    """A unit: a short text without control characters."""
    found = text(value)
    if not 1 <= len(found.strip()) == len(found) <= 16 or not found.isprintable():
        raise WrongValueError(
            f"{quoted(found)} is not a unit", "use 1 to 16 characters, such as V, %, °C"
        )
    return found


def base_unit_for(metric: str) -> str | None:
    """The base unit that the name should end in, if it ends in another unit; else None."""
    return NON_BASE_UNITS.get(metric.rpartition("_")[2])


MetricName = Annotated[
    str,
    Value(metric_name, "metric name", type="string", pattern=f"^{_METRIC}$", maxLength=MAX_NAME),
]
Unit = Annotated[str, Value(unit, "unit", type="string", minLength=1, maxLength=16)]
