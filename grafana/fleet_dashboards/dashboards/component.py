"""One component, or one of its values, across the fleet: the odd one out."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat, statetimeline, table, timeseries
from grafana_foundation_sdk.models import common, dashboard

from fleet_dashboards.dashboards import fleet
from fleet_dashboards.lib import dashboard as frame
from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.tables import Column
from fleet_dashboards.queries import component as queries

FLEET = Column("fleet", "Fleet", width=110)
ROBOT = Column("robot", "Robot", link=links.TO_ROBOT)
ODD = 3.5  # standard deviations, as Iglewicz and Hoaglin advise


def build() -> builders.Dashboard:
    """The dashboard of one component."""
    return frame.board(
        links.COMPONENT_UID,
        "Component across the fleet",
        "Is it this robot, or all of them?",
        [variables.fleet(), variables.robots(), variables.component(), variables.key()],
        [
            count_by_state(),
            states(),
            states_over_time(),
            "Value: $key",
            values(),
            oddness(),
            odd_ones(),
        ],
    )


def count_by_state() -> stat.Panel:
    """How many robots have it in each state."""
    panel = panels.number(
        "Robots by state of the component",
        "On how many robots of the chosen fleets is this component well, on how many not?",
        queries.COUNT_BY_RANK,
    ).targets([panels.at_end(queries.COUNT_BY_RANK, "{{rank}}")])
    panel = panel.text_mode(common.BigValueTextMode.VALUE_AND_NAME)
    return fleet.by_rank(panel).height(10).span(8)


def states() -> table.Panel:
    """A row for each robot that has it."""
    return (
        tables.listing(
            "State on each robot",
            "On which robots is this component faulty, since when, and what does it say?",
            "No robot has this component",
            {
                "A": queries.STATE,
                "B": queries.PROBLEM_FOR,
                "C": queries.MESSAGES,
                "D": queries.FLAP_RATIO,
                "E": queries.CHANGES,
            },
            [
                tables.STATE,
                FLEET,
                ROBOT,
                Column("B", "For", unit="dtdurations", width=150),
                Column("message", "Message"),
                Column("D", "Flapping", unit="percentunit", width=90),
                Column("E", "Changes", width=90),
            ],
            by="fleet, robot, group",
        )
        .height(10)
        .span(16)
    )


def states_over_time() -> statetimeline.Panel:
    """A bar for each robot that has it."""
    link = builders.DashboardLink("Open this robot").url(links.TO_ROBOT_OF_SERIES)
    return panels.timeline(
        "State over time",
        "Did it fail everywhere at once, or on one robot after the other?",
        panels.over_time(queries.STATE, "{{robot}}"),
    ).data_links([link])


def values() -> timeseries.Panel:
    """The key's value on every robot, and the median."""
    link = builders.DashboardLink("Open this robot").url(links.TO_ROBOT_OF_SERIES)
    return (
        panels.graph(
            "$key on every robot",
            "Which robot's value runs away from the others'? Dashed: the median of all robots.",
            panels.over_time(queries.VALUE, "{{robot}} [{{unit}}]"),
            panels.over_time(queries.MEDIAN, "median", "B"),
        )
        .override_by_name("median", panels.dashed(palette.UNKNOWN.colour))
        .data_links([link])
    )


def oddness() -> timeseries.Panel:
    """The distance from the median, in standard deviations."""
    return (
        panels.graph(
            "Distance from the median",
            "Which robot is the odd one out? Beyond 3.5 (the dashed lines) it hardly belongs to "
            "the others: the modified z-score of Iglewicz and Hoaglin.",
            panels.over_time(queries.ODDNESS, "{{robot}}"),
        )
        .thresholds(_beyond())
        .thresholds_style(panels.threshold_lines())
    )


def odd_ones() -> table.Panel:
    """The same now, as a list."""
    odd = Column("C", "Oddness", width=120)
    panel = tables.listing(
        "Odd ones",
        "Which robots' values are now farthest from the median? Coloured beyond 3.5 standard "
        "deviations.",
        "No robot has this key as a number",
        {"A": queries.VALUE, "B": queries.DISTANCE, "C": queries.ODDNESS},
        [
            FLEET,
            ROBOT,
            Column("A", "Value"),
            Column("unit", "Unit", width=80),
            Column("B", "From the median"),
            odd,
        ],
        sort="Oddness",
        by="fleet, robot",
    )
    background = common.TableColoredBackgroundCellOptions(
        common.TableCellBackgroundDisplayMode.BASIC
    )
    return panel.thresholds(_beyond()).override_by_name(
        odd.title, [dashboard.DynamicConfigValue("custom.cellOptions", background)]
    )


def _beyond() -> builders.ThresholdsConfig:
    return panels.steps(
        (None, palette.CRITICAL.colour), (-ODD, "transparent"), (ODD, palette.CRITICAL.colour)
    )
