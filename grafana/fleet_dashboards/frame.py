"""What all dashboards have in common: time, refresh, links to one another, data source."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards import links, variables


def board(uid: str, title: str, question: str) -> builders.Dashboard:
    """An empty dashboard; ``question`` is what it answers as a whole."""
    return (
        builders.Dashboard(title)
        .uid(uid)
        .description(question)
        .tags([links.TAG])
        .timezone("browser")
        .time("now-6h", "now")
        .refresh("30s")
        .tooltip(dashboard.DashboardCursorSync.CROSSHAIR)
        .readonly()
        .link(_others())
        .with_variable(variables.datasource())
    )


def _others() -> builders.DashboardLink:
    return (
        builders.DashboardLink("ROS diagnostics")
        .type(dashboard.DashboardLinkType.DASHBOARDS)
        .tags([links.TAG])
        .as_dropdown(True)
        .include_vars(True)
        .keep_time(True)
    )
