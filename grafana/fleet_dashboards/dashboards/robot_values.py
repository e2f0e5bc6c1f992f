"""A robot's key-values as graphs: batteries and temperatures in front, then one for each unit."""

from __future__ import annotations

import re

from grafana_foundation_sdk.builders import timeseries
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.lib import palette, panels
from fleet_dashboards.queries import robot as queries


def battery() -> timeseries.Panel:
    """Batteries: the first thing that ends a mission."""
    return _values(
        "Batteries",
        "How full are the batteries? Dashed: the bounds of fleet.yml.",
        queries.BATTERY,
        queries.BATTERY_THRESHOLDS,
    ).min(0)


def temperature() -> timeseries.Panel:
    """Temperatures."""
    return _values(
        "Temperatures",
        "What becomes too hot? Dashed: the bounds of fleet.yml.",
        queries.TEMPERATURE,
        queries.TEMPERATURE_THRESHOLDS,
    )


def bare_values() -> timeseries.Panel:
    """Numbers whose unit nobody gave."""
    return _values(
        "Values without a unit",
        "What do the other numbers do, those that come without a unit?",
        queries.BARE_VALUES,
        queries.BARE_THRESHOLDS,
    )


def other_values() -> timeseries.Panel:
    """A panel for each unit that this robot's values have."""
    panel = _values(
        "Values in $unit",
        "What do the numbers in this unit do? One panel for each unit.",
        queries.OTHER_VALUES,
        queries.OTHER_THRESHOLDS,
    )
    return panel.repeat("unit").repeat_direction("h").max_per_row(2)


def _values(title: str, description: str, expr: str, thresholds: str) -> timeseries.Panel:
    """Values with their unit; their bounds as dashed lines in the colour of the state."""
    panel = panels.graph(
        title,
        description,
        panels.over_time(expr, "{{component}}: {{key}} [{{unit}}]"),
        panels.over_time(
            thresholds, "{{severity}} {{bound}}: {{component}} {{key}} [{{unit}}]", "B"
        ),
    )
    for unit, grafana_unit in palette.UNITS.items():
        regexp = rf"/ \[{re.escape(unit).replace('/', chr(92) + '/')}\]$/"
        panel = panel.override_by_regexp(
            regexp, [dashboard.DynamicConfigValue("unit", grafana_unit)]
        )
    for severity, colour in BOUNDS.items():
        panel = panel.override_by_regexp(f"/^{severity} (low|high): /", panels.dashed(colour))
    return panel


BOUNDS = {"warning": palette.WARNING.colour, "critical": palette.CRITICAL.colour}
