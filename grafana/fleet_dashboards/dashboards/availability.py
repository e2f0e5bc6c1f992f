"""The availability report: which share of the time range was spent in which part.

A part is a state, or what is not the robot's own time: planned maintenance, time in which nobody
looked. A table's rows become a file by Inspect > Data > Download CSV.
"""

from __future__ import annotations

from grafana_foundation_sdk.builders import table, timeseries

from fleet_dashboards.lib import links, palette, panels, tables
from fleet_dashboards.lib.tables import Column
from fleet_dashboards.queries import alerts as queries

PARTS = {
    "ok": palette.OK.colour,
    "warning": palette.WARNING.colour,
    "stale": palette.STALE.colour,
    "critical": palette.CRITICAL.colour,
    "unknown": palette.UNKNOWN.colour,
    "unreachable": palette.UNREACHABLE_COLOUR,
    "maintenance": palette.MAINTENANCE_COLOUR,
    "pending": palette.PENDING.colour,
    "undetermined": palette.UNDETERMINED_COLOUR,
}
FLEET = Column("fleet", "Fleet")
AVAILABLE = Column("available", "Available", unit="percentunit", width=100)
SHARES = [AVAILABLE] + [
    Column(part, "OK" if part == "ok" else part.capitalize(), unit="percentunit", width=110)
    for part in PARTS
]
SUMS = (
    "Available is OK and WARNING, out of the time that was judged: maintenance, pending and "
    "undetermined are left out. The other columns sum to 100 %."
)


def by_robot() -> table.Panel:
    """A row for each robot."""
    return tables.pivot(
        "Availability of the robots",
        f"How reliable was each robot? {SUMS} Faults are confirmed CRITICAL ones and silences; the "
        "longest is the longest time in CRITICAL or UNKNOWN, whichever, maintenance included. As a "
        "file: menu of the panel, Inspect, Data, Download CSV.",
        "Nothing is recorded for this range",
        queries.BY_ROBOT,
        [
            FLEET,
            Column("robot", "Robot", link=links.TO_ROBOT),
            *SHARES,
            Column("faults", "Faults", width=80),
            Column("longest", "Longest", unit="dtdurations", width=150),
        ],
        label="part",
        sort="Available",
    ).height(12)


def by_group() -> table.Panel:
    """A row for each group of robots."""
    return tables.pivot(
        "Availability of the groups",
        f"How reliable was each group of robots? {SUMS}",
        "Nothing is recorded for this range",
        queries.BY_GROUP,
        [FLEET, Column("robot_group", "Group"), *SHARES],
        label="part",
        sort="Available",
    ).height(8)


def by_fleet() -> table.Panel:
    """A row for each fleet."""
    return tables.pivot(
        "Availability of the fleets",
        f"How reliable was each fleet? {SUMS}",
        "Nothing is recorded for this range",
        queries.BY_FLEET,
        [FLEET, *SHARES],
        label="part",
        sort="Available",
    ).height(6)


def over_time() -> timeseries.Panel:
    """The shares of every five minutes."""
    panel = panels.graph(
        "Availability over time",
        "When was the fleet available, and what was it otherwise?",
        panels.over_time(queries.OVER_TIME, "{{part}}"),
        unit="percentunit",
    )
    for part, colour in PARTS.items():
        panel = panel.override_by_name(part, panels.series(part, colour))
    return panels.stacked(panel).min(0).max(1).span(panels.WIDTH)
