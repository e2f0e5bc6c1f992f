"""Missions, for shift leaders: do robots reach their goals, and how often must somebody help?"""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat, table, timeseries
from grafana_foundation_sdk.models import common

from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.dashboard import new_dashboard
from fleet_dashboards.lib.promql import in_order
from fleet_dashboards.lib.tables import Column

_CHOSEN = f"{variables.FLEET}, {variables.ROBOTS}"
_GOALS = "action:ros_diagnostics_goals:increase5m"
_INTERVENTIONS = "robot:ros_diagnostics_interventions:increase5m"
_AUTONOMOUS = "robot:ros_diagnostics_autonomous_seconds:increase5m"
_RESULTS = {  # the colours of what was reached, of what was not, and of what nobody knows
    "succeeded": palette.OK.colour,
    "aborted": palette.CRITICAL.colour,
    "cancelled": palette.STALE.colour,
    "preempted": palette.NEUTRAL,
    "unknown": palette.UNKNOWN.colour,
}


def build() -> builders.Dashboard:
    """Return the dashboard of the goals and interventions in the time range."""
    return (
        new_dashboard(
            links.MISSIONS_UID,
            "Missions",
            "Did the robots do their work in the time range: how many of their goals succeeded, "
            "and how often did somebody have to help?",
            [variables.fleet(), variables.robots()],
            [success(), unknown(), per_hour(), between(), robots(), over_time(), actions()],
        )
        .time("now-24h", "now")
        .refresh("5m")
    )


def _sum(by: str, series: str, result: str = "") -> str:
    chosen = f'{_CHOSEN}, result=~"{result}"' if result else _CHOSEN
    return f"sum by ({by}) (sum_over_time({series}{{{chosen}}}[$__range]))"


def _success(by: str) -> str:
    decided = _sum(by, _GOALS, "succeeded|aborted")
    return f"{_sum(by, _GOALS, 'succeeded')} / ({decided} > 0)"


def _hours(by: str) -> str:
    return f"({_sum(by, _AUTONOMOUS)} / 3600)"


_NO_GOALS = "No data of goals"
_NO_MODES = "No data of modes (fleet.yml)"


def _number(
    title: str, description: str, expr: str, unit: str, decimals: int, *, without: str
) -> stat.Panel:
    """Show a number of each fleet; ``without`` is also shown while Prometheus is dead."""
    panel = panels.number(title, description, "vector(0)", unit).no_value(without)
    panel = panel.targets([panels.at_end(expr, "{{fleet}}")]).decimals(decimals)
    return panel.text_mode(common.BigValueTextMode.VALUE_AND_NAME).span(6)


def success() -> stat.Panel:
    """Show which share of the goals succeeded."""
    return _number(
        "Success",
        "Which share of their goals did robots reach? Of those that succeeded or were aborted.",
        _success("fleet"),
        "percentunit",
        1,
        without=_NO_GOALS,
    )


def beside(panel: stat.Panel, refs: str = "BC") -> stat.Panel:
    """Add to a panel what became of the goals of a day; nothing where there are no missions."""
    success, helped = (
        f"fleet:ros_diagnostics_{each}:ratio1d{{{variables.FLEET}}}"
        for each in ("goal_success", "interventions_per_hour")
    )
    link = {"title": "Open the missions", "url": links.TO_MISSIONS}
    per_hour = [panels.look("unit", "none"), panels.look("decimals", 2)]
    return (
        panel.with_target(panels.at_end(success, "goals reached of {{fleet}}", refs[0]))
        .with_target(panels.at_end(helped, "interventions per hour of {{fleet}}", refs[1]))
        .override_by_regexp("/^goals|^interventions/", [panels.look("links", [link])])
        .override_by_regexp("/^interventions/", per_hour)
        .text_mode(common.BigValueTextMode.AUTO)
    )


def unknown() -> stat.Panel:
    """Show of which share nobody knows how it ended."""
    return _number(
        "Unknown",
        "Of which share of goals does nobody know how they ended? The robot was out of reach, or "
        "its action server was restarted. Without goals that others replaced.",
        f"{_sum('fleet', _GOALS, 'unknown')} / "
        f"({_sum('fleet', _GOALS, 'succeeded|aborted|cancelled|unknown')} > 0)",
        "percentunit",
        1,
        without=_NO_GOALS,
    )


def per_hour() -> stat.Panel:
    """Show how often somebody had to help."""
    return _number(
        "Interventions per hour",
        "How often did somebody have to help, for each hour in which a robot worked by itself?",
        f"{_sum('fleet', _INTERVENTIONS)} / ({_hours('fleet')} > 0)",
        "none",
        2,
        without=_NO_MODES,
    )


def between() -> stat.Panel:
    """Show for how long robots worked until somebody had to help."""
    return _number(
        "Hours between interventions",
        "For how many hours did a robot work by itself until somebody had to help?",
        f"{_hours('fleet')} / ({_sum('fleet', _INTERVENTIONS)} > 0)",
        "none",
        1,
        without="No data of interventions",
    )


def robots() -> table.Panel:
    """List the robots, the worst first."""
    by = "fleet, robot"
    return tables.joined(
        "Robots",
        "Which robots reach the fewest of their goals? The worst first.",
        {
            "A": in_order(_success(by)),
            "B": _sum(by, _GOALS, "succeeded"),
            "C": _sum(by, _GOALS, "aborted"),
            "D": _sum(by, _GOALS, "cancelled"),
            "E": _sum(by, _GOALS, "unknown"),
            "F": _sum(by, _INTERVENTIONS),
            "G": _hours(by),
        },
        [
            tables.ROBOT_IN_ORDER,
            Column("A", "Success", "percentunit", width=95, decimals=1),
            Column("B", "Succeeded", width=100, decimals=0),
            Column("C", "Aborted", width=85, decimals=0),
            Column("D", "Cancelled", width=95, decimals=0),
            Column("E", "Unknown", width=90, decimals=0),
            Column("F", "Interventions", width=115, decimals=0),
            Column("G", "Hours by itself", width=125, decimals=1),
            tables.FLEET,
            tables.NAME,
        ],
        by=by,
        sort=("Success", "Robot"),
        ascending=("Success", "Robot"),
    ).height(8)


def over_time() -> timeseries.Panel:
    """Show the goals by result over time."""
    panel = panels.graph(
        "Goals by result",
        "How many goals of the chosen robots ended in which way, in each five minutes?",
        panels.over_time(f"sum by (result) ({_GOALS}{{{_CHOSEN}}})", "{{result}}"),
    )
    for result, colour in _RESULTS.items():
        panel = panel.override_by_name(result, [panels.fixed_colour(colour)])
    return panels.stacked(panel).height(10)


def actions() -> table.Panel:
    """List the actions, the worst first."""
    by = "fleet, action"
    return tables.joined(
        "Actions",
        "Which actions fail? The worst first.",
        {
            "A": _success(by),
            "B": _sum(by, _GOALS, "succeeded"),
            "C": _sum(by, _GOALS, "aborted"),
            "D": _sum(by, _GOALS, "unknown"),
        },
        [
            Column("action", "Action", min_width=180),
            Column("A", "Success", "percentunit", width=95, decimals=1),
            Column("B", "Succeeded", width=100, decimals=0),
            Column("C", "Aborted", width=85, decimals=0),
            Column("D", "Unknown", width=90, decimals=0),
            tables.FLEET,
        ],
        by=by,
        sort=("Success", "Action"),
        ascending=("Success", "Action"),
    ).span(12)
