"""Names that fleet.yml may not give away because the exporter, its rules or Prometheus use them.

The metrics' table cannot be imported here (it stands behind the config); a test compares the two.
"""

from __future__ import annotations

RESERVED_LABELS = frozenset(
    {
        # identity of what the exporter serves
        *("fleet", "robot", "group", "component"),
        # robot_info's own
        *("ros_namespace", "domain_id", "topic", "profile", "address"),
        # set by Prometheus on targets, histograms, summaries and alerts
        *("job", "instance", "le", "quantile", "alertname", "alertstate", "severity"),
    }
)
RESERVED_LABEL_PREFIXES = ("__", "exported_")

# Families of ours, of Prometheus' client and of Prometheus itself begin so.
RESERVED_METRIC_PREFIXES = (
    *("ros_diagnostics_", "process_", "python_", "scrape_", "prometheus_", "alertmanager_"),
    *("ALERTS", "target_info"),
)
RESERVED_METRICS = frozenset({"up"})
# Series of other types end so; a gauge that did would be read as a part of one of them.
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
