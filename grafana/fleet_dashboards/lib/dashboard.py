"""What all dashboards have in common: time range, refresh, links to one another, data source."""

from __future__ import annotations

from collections.abc import Sequence

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.cog import builder
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.lib import banner, links, panels, variables

REVISION = 2  # one more with each release that changes them: who imports by hand compares it
Content = builder.Builder[dashboard.Panel] | str | builders.Row  # a text starts a new row


def new_dashboard(
    uid: str,
    title: str,
    question: str,
    variables_shown: Sequence[builder.Builder[dashboard.VariableModel]],
    content: Sequence[Content],
) -> builders.Dashboard:
    """Return a dashboard; ``question`` is its description. The banner is at its top."""
    board = (
        builders.Dashboard(title)
        .uid(uid)
        .revision(REVISION)
        .description(question)
        .tags([links.TAG])
        .timezone("")  # that of the person, the organization or the server
        .time("now-1h", "now")
        .refresh("10s")
        .tooltip(dashboard.DashboardCursorSync.CROSSHAIR)
        .editable()
        .link(_others())
        .with_variable(variables.datasource())
    )
    for variable in variables_shown:
        board = board.with_variable(variable)
    for each in (panels.now(banner.monitoring()), panels.now(banner.data_as_of()), *content):
        if isinstance(each, str):
            board = board.with_row(builders.Row(each))
        elif isinstance(each, builders.Row):
            board = board.with_row(each)
        else:
            board = board.with_panel(each)
    return board


def closed_row(title: str, *content: builder.Builder[dashboard.Panel]) -> builders.Row:
    """Return a row of what not everybody needs: it is a line until somebody opens it."""
    row = builders.Row(title).collapsed(True)
    for panel in content:
        row = row.with_panel(panel)
    return row


def _others() -> builders.DashboardLink:
    return (
        builders.DashboardLink("ROS diagnostics")
        .type(dashboard.DashboardLinkType.DASHBOARDS)
        .tags([links.TAG])
        .as_dropdown(True)
        .include_vars(True)
        .keep_time(True)
    )
