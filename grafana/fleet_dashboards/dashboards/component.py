"""One component, or one of its values, on all robots."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat, statetimeline, table, timeseries

from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.dashboard import new_dashboard
from fleet_dashboards.lib.promql import (
    HELD,
    component_rank,
    in_order,
    named,
    problem_began,
    values,
    with_unit,
    worst_first,
)
from fleet_dashboards.lib.tables import Column

_ALL = f"{variables.FLEET}, {variables.COMPONENT}"
_SELECTED = f"{_ALL}, {variables.ROBOTS}"
_BY = "by (fleet, robot, group)"
_NO_NUMBER = "No data: no number of this key"
_RANK = f"max {_BY} ({component_rank(_SELECTED)})"


def build() -> builders.Dashboard:
    """Return the dashboard of one component."""
    return new_dashboard(
        links.COMPONENT_UID,
        "Component across the fleet",
        "Is one robot faulty, or all of them?",
        [variables.fleet(), variables.component(), variables.robots(), variables.key()],
        [
            robots_by_state(),
            states(),
            states_over_time(),
            "Value: $key",
            value_on_every_robot(),
            distances(),
            outliers(),
        ],
    )


RANKS = {str(state.rank): state for state in palette.WORST_FIRST if state.rank >= 0}


def robots_by_state() -> stat.Panel:
    """Count the robots by the component's state."""
    return panels.counts(
        "Robots by state of the component",
        "On how many robots of the chosen fleets is this component in each state?",
        f'count_values("rank", {component_rank(_ALL)})',
        "rank",
        RANKS,
    ).height(10)


def states() -> table.Panel:
    """List the robots that have the component."""
    changes = f"ros_diagnostics_component_changes_total{{{_SELECTED}}}[$__range]"
    since = f"""
      (
          max {_BY} ({HELD}{{{_SELECTED}, scope=~"component|flapping"}})
        or
          max {_BY} (ros_diagnostics_component_problem_since_timestamp_seconds{{{_SELECTED}}})
      )
    """
    return (
        tables.joined(
            "State on each robot",
            "On which robots is this component faulty, since when, and what is its message?",
            {
                "A": in_order(_RANK),
                "B": f"{since} * 1000",
                "C": f"""
                group by (fleet, robot, group, message) (
                  ros_diagnostics_component_message_info{{{_SELECTED}}}
                )
                """,
                "D": f"max {_BY} (ros_diagnostics_component_flap_ratio{{{_SELECTED}}})",
                "E": f"round(sum {_BY} (increase({changes})))",
            },
            [
                tables.STATE,
                tables.ROBOT_IN_ORDER,
                Column("message", "Message", min_width=200),
                Column("B", "Since", unit=tables.MINUTE, width=105),
                Column("D", "Flapping", unit="percentunit", width=85),
                Column("E", "Changes", width=85),
                tables.FLEET,
                tables.NAME,
            ],
            by="fleet, robot, group",
            sort=("State", "Robot"),
        )
        .height(10)
        .span(16)
    )


LINES = 15  # of a graph: names of more are not legible


def states_over_time() -> statetimeline.Panel:
    """Show the component's state on each robot over time."""
    link = builders.DashboardLink("Open this robot").url(links.TO_ROBOT_OF_SERIES)
    at = " @ end()"
    rank = f"max {_BY} ({component_rank(_SELECTED, at)})"
    began = f"max {_BY} ({problem_began(_SELECTED, at)})"
    placed = worst_first(in_order(_RANK), rank, began, "fleet, robot, group", most=LINES)
    return panels.timeline(
        "State over time",
        "Did it fail everywhere at once, or on one robot after the other? The "
        f"{LINES} robots on which it is worst at the end of the range, of equal ones the oldest "
        "trouble first: filter to see others.",
        panels.over_time(named(placed), "{{who}}"),
    ).data_links([link])


# --- One key: shown for the selected robots, compared with all ---


def _value(matchers: str, at: str = "") -> str:
    return f"max by (fleet, robot, unit) ({values(f'{matchers}, {variables.KEY}', at)})"


_VALUE = _value(_SELECTED)
_MEDIAN = f"quantile(0.5, {_value(_ALL)})"


def _distance(matchers: str, at: str = "") -> str:
    return f"({_value(matchers, at)} - scalar(quantile(0.5, {_value(_ALL, at)})))"


def _score(at: str = "") -> str:
    """Return Iglewicz and Hoaglin's modified z-score.

    It is the distance from the median divided by the median absolute deviation, scaled to a
    standard deviation. Where more than half of the values are equal the mean absolute deviation is
    taken instead; where all are equal, 1.
    """
    of_all = f"abs({_distance(_ALL, at)})"
    return f"""
  {_distance(_SELECTED, at)}
/
  scalar(
      1.4826 * quantile(0.5, {of_all}) > 0
    or
      1.2533 * avg({of_all}) > 0
    or
      vector(1)
  )
"""


OUTLIER = 3.5  # standard deviations, as Iglewicz and Hoaglin recommend


def _farthest() -> str:
    return f"on (fleet, robot, unit)\n  topk({LINES}, abs({_score(' @ end()')}))"


def value_on_every_robot() -> timeseries.Panel:
    """Show the key's value on each robot, and the median."""
    link = builders.DashboardLink("Open this robot").url(links.TO_ROBOT_OF_SERIES)
    return (
        panels.graph(
            "$key on every robot",
            "Which robot's value differs from the others? Dashed: the median of all robots; "
            f"lines: the {LINES} that are farthest from it at the end of the range.",
            panels.over_time(with_unit(f"{_VALUE} and {_farthest()}"), "{{robot}}{{in_unit}}"),
            panels.over_time(_MEDIAN, "median", "B"),
        )
        .override_by_name("median", panels.dashed(palette.UNDETERMINED_COLOUR))
        .data_links([link])
        .no_value(_NO_NUMBER)
    )


def distances() -> timeseries.Panel:
    """Show the distance of each robot's value from the median, in standard deviations."""
    farthest = f"{_score()}\nand {_farthest()}"
    limit = f"group({_value(_ALL)}) * {OUTLIER}"
    panel = panels.graph(
        "Distance from the median",
        f"Which robot is an outlier, to either side? The {LINES} farthest, by the modified "
        "z-score of Iglewicz and Hoaglin: beyond 3.5 (the dashed lines) a robot is an outlier.",
        panels.over_time(farthest, "{{robot}}"),
        # Lines of their own: Grafana 9.0 draws no dashed thresholds.
        panels.over_time(limit, "outlier above", "B"),
        panels.over_time(f"-({limit})", "outlier below", "C"),
    ).no_value(_NO_NUMBER)
    return panel.override_by_regexp(
        "/^outlier (above|below)$/", panels.dashed(palette.CRITICAL.colour)
    )


def outliers() -> table.Panel:
    """List the robots by the distance of their present value from the median."""
    score = Column("C", "Score", width=120, background=True)
    panel = tables.joined(
        "Outliers",
        "Which robots' values are now farthest from the median, to either side? Coloured beyond a "
        "score of 3.5.",
        {"A": _VALUE, "B": _distance(_SELECTED), "C": f"abs({_score()})"},
        [
            tables.ROBOT,
            Column("A", "Value"),
            Column("unit", "Unit", mappings=palette.rewritten("/^deg([CF])$/", "°$1"), width=80),
            Column("B", "Distance"),
            score,
            tables.FLEET,
        ],
        sort=("Score",),
        by="fleet, robot",
        empty=_NO_NUMBER,
    )
    colours = panels.steps((None, palette.NOTHING), (OUTLIER, palette.CRITICAL.colour)).build()
    cell = {"thresholds": colours, "decimals": 1}
    return panel.override_by_name(score.title, [panels.look(*each) for each in cell.items()])
