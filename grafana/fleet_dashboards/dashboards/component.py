"""One component, or one of its values, on all robots."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat, statetimeline, table, timeseries
from grafana_foundation_sdk.models import common, dashboard

from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.dashboard import new_dashboard
from fleet_dashboards.lib.promql import component_rank
from fleet_dashboards.lib.tables import Column

_ALL = 'fleet=~"$fleet", component="$component"'
_SELECTED = f'{_ALL}, robot=~"$robot"'
_BY = "by (fleet, robot, group)"
_RANK = f"max {_BY} ({component_rank(_SELECTED)})"


def build() -> builders.Dashboard:
    """Return the dashboard of one component."""
    return new_dashboard(
        links.COMPONENT_UID,
        "Component across the fleet",
        "Is one robot faulty, or all of them?",
        [variables.fleet(), variables.robots(), variables.component(), variables.key()],
        [
            robots_by_state(),
            states(),
            states_over_time(),
            "Value: $key",
            values(),
            distances(),
            outliers(),
        ],
    )


def robots_by_state() -> stat.Panel:
    """Count the robots by the component's state."""
    return panels.count_by_state(
        "Robots by state of the component",
        "On how many robots of the chosen fleets is this component in each state?",
        f'count_values("rank", {component_rank(_ALL)})',
    ).height(10)


def states() -> table.Panel:
    """List the robots that have the component."""
    changes = f"ros_diagnostics_component_changes_total{{{_SELECTED}}}[$__range]"
    return (
        tables.joined(
            "State on each robot",
            "On which robots is this component faulty, since when, and what is its message?",
            "No robot has this component",
            {
                "A": _RANK,
                "B": f"time() - max {_BY} (component:ros_diagnostics_problem:start{{{_SELECTED}}})",
                "C": f"""
                group by (fleet, robot, group, message) (
                  ros_diagnostics_component_message_info{{{_SELECTED}}}
                )
                """,
                "D": f"max {_BY} (ros_diagnostics_component_flap_ratio{{{_SELECTED}}})",
                "E": f"sum {_BY} (increase({changes}))",
            },
            [
                tables.STATE,
                tables.FLEET,
                tables.ROBOT,
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
    """Show the component's state on each robot over time."""
    link = builders.DashboardLink("Open this robot").url(links.TO_ROBOT_OF_SERIES)
    return panels.timeline(
        "State over time",
        "Did it fail everywhere at once, or on one robot after the other?",
        panels.over_time(_RANK, "{{robot}}"),
    ).data_links([link])


# --- One key: shown for the selected robots, compared with all ---


def _value(matchers: str) -> str:
    family = f'ros_diagnostics_component_value{{{matchers}, key="$key"}}'
    return f"max by (fleet, robot, unit) ({family})"


_VALUE = _value(_SELECTED)
_MEDIAN = f"quantile(0.5, {_value(_ALL)})"
_DISTANCE = f"{_VALUE} - scalar({_MEDIAN})"
_DISTANCE_OF_ALL = f"abs({_value(_ALL)} - scalar({_MEDIAN}))"
# Iglewicz and Hoaglin's modified z-score: the distance from the median divided by the median
# absolute deviation, scaled to a standard deviation. Where more than half of the values are equal
# the mean absolute deviation is taken instead; where all are equal, 1.
_DEVIATION = f"""
scalar(
    1.4826 * quantile(0.5, {_DISTANCE_OF_ALL}) > 0
  or
    1.2533 * avg({_DISTANCE_OF_ALL}) > 0
  or
    vector(1)
)
"""
_SCORE = f"({_DISTANCE}) / {_DEVIATION}"
OUTLIER = 3.5  # standard deviations, as Iglewicz and Hoaglin recommend


def values() -> timeseries.Panel:
    """Show the key's value on each robot, and the median."""
    link = builders.DashboardLink("Open this robot").url(links.TO_ROBOT_OF_SERIES)
    return (
        panels.graph(
            "$key on every robot",
            "Which robot's value differs from the others? Dashed: the median of all robots.",
            panels.over_time(_VALUE, "{{robot}} [{{unit}}]"),
            panels.over_time(_MEDIAN, "median", "B"),
        )
        .override_by_name("median", panels.dashed(palette.UNKNOWN.colour))
        .data_links([link])
    )


def distances() -> timeseries.Panel:
    """Show the distance of each robot's value from the median, in standard deviations."""
    return (
        panels.graph(
            "Distance from the median",
            "Which robot is an outlier? The modified z-score of Iglewicz and Hoaglin: beyond 3.5 "
            "(the dashed lines) a robot is an outlier.",
            panels.over_time(_SCORE, "{{robot}}"),
        )
        .thresholds(_outlier_colours())
        .thresholds_style(panels.threshold_lines())
    )


def outliers() -> table.Panel:
    """List the robots by the distance of their present value from the median."""
    score = Column("C", "Score", width=120)
    panel = tables.joined(
        "Outliers",
        "Which robots' values are now farthest from the median? Coloured beyond a score of 3.5.",
        "No robot has this key as a number",
        {"A": _VALUE, "B": _DISTANCE, "C": _SCORE},
        [
            tables.FLEET,
            tables.ROBOT,
            Column("A", "Value"),
            Column("unit", "Unit", width=80),
            Column("B", "Distance"),
            score,
        ],
        sort="Score",
        by="fleet, robot",
    )
    background = common.TableColoredBackgroundCellOptions(
        common.TableCellBackgroundDisplayMode.BASIC
    )
    return panel.thresholds(_outlier_colours()).override_by_name(
        score.title, [dashboard.DynamicConfigValue("custom.cellOptions", background)]
    )


def _outlier_colours() -> builders.ThresholdsConfig:
    colour = palette.CRITICAL.colour
    return panels.steps((None, colour), (-OUTLIER, "transparent"), (OUTLIER, colour))
