"""What all dashboards have in common: time, refresh, links to one another, data source."""

from __future__ import annotations

from collections.abc import Sequence

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.cog import builder
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.lib import links, variables

Content = builder.Builder[dashboard.Panel] | str  # a text begins a row of panels under it


def board(
    uid: str,
    title: str,
    question: str,
    variables_shown: Sequence[builder.Builder[dashboard.VariableModel]],
    content: Sequence[Content],
) -> builders.Dashboard:
    """A dashboard; ``question`` is what it answers as a whole."""
    made = (
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
    for variable in variables_shown:
        made = made.with_variable(variable)
    for each in content:
        made = made.with_row(builders.Row(each)) if isinstance(each, str) else made.with_panel(each)
    return made


def _others() -> builders.DashboardLink:
    return (
        builders.DashboardLink("ROS diagnostics")
        .type(dashboard.DashboardLinkType.DASHBOARDS)
        .tags([links.TAG])
        .as_dropdown(True)
        .include_vars(True)
        .keep_time(True)
    )
