"""Alerts and reports: what fires, what was told, and how available the robots were."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat, table, timeseries
from grafana_foundation_sdk.models import common

from fleet_dashboards.dashboards import availability
from fleet_dashboards.lib import dashboard as frame
from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.tables import Column
from fleet_dashboards.queries import alerts as queries

SEVERITIES = {
    "critical": (palette.CRITICAL.colour, "What must somebody look after now"),
    "warning": (palette.WARNING.colour, "What must somebody look after today"),
    "info": (palette.NEUTRAL, "What is only to be known"),
}
ALERT = Column("alertname", "Alert", link="${__data.fields.Runbooks}/${__data.fields.Alert}.md")
# Grafana's own list, from the data source that is provisioned for Alertmanager.
SILENCES_PAGE = "/alerting/silences?alertmanager=ROS%20diagnostics%20Alertmanager"
WHERE = (
    Column("severity", "Severity", mappings=palette.severity_mappings(), width=100),
    Column("fleet", "Fleet", width=110),
    Column("robot", "Robot", link=links.TO_ROBOT),
    Column("component", "Component", link=links.TO_COMPONENT),
)


def build() -> builders.Dashboard:
    """The dashboard of alerts and of reports about a time range."""
    return frame.board(
        links.ALERTS_UID,
        "Alerts and reports",
        "What was told to whom, and how well did it all run?",
        [variables.fleet()],
        [
            *map(firing, SEVERITIES),
            suppressed(),
            silences(),
            acknowledged_faults(),
            alerts(),
            acknowledged(),
            history(),
            fired(),
            "Notifications",
            notifications(),
            sent(),
            failed(),
            flapping(),
            "Availability in the time range",
            availability.by_robot(),
            availability.by_group(),
            availability.by_fleet(),
            availability.over_time(),
        ],
    ).time("now-24h", "now")


def firing(severity: str) -> stat.Panel:
    """The count of alerts of one severity."""
    colour, question = SEVERITIES[severity]
    return (
        panels.number(
            f"Firing: {severity}",
            f"{question}? Alerts of this severity that fire now.",
            queries.firing(severity),
        )
        .color_mode(common.BigValueColorMode.BACKGROUND)
        .color_scheme(panels.by_thresholds())
        .thresholds(panels.steps((None, "transparent"), (1, colour)))
    )


def suppressed() -> stat.Panel:
    """Alerts that Alertmanager keeps to itself."""
    return panels.number(
        "Suppressed",
        "How many alerts fire and are not told, because of a silence, an acknowledgement or a "
        "worse alert of the same fault?",
        queries.SUPPRESSED,
    )


def silences() -> stat.Panel:
    """Silences and acknowledgements now."""
    link = builders.DashboardLink("Look at them").url(SILENCES_PAGE)
    return panels.number(
        "Silences",
        "How many silences and acknowledgements are in force? A click lists them.",
        queries.SILENCES,
    ).data_links([link])


def acknowledged_faults() -> stat.Panel:
    """Faults that somebody looks after."""
    return panels.number(
        "Acknowledged faults",
        "How many of the present faults are acknowledged?",
        queries.ACKNOWLEDGED_COUNT,
    )


def acknowledged() -> table.Panel:
    """Who takes care of what: Nagios' comments."""
    return tables.listing(
        "Acknowledged",
        "Who takes care of which fault, since when, and with which words? Only faults that go on; "
        "made with ros-diagnostics-ack, read by an exporter with --alertmanager.url.",
        "Nobody has acknowledged a fault that goes on",
        {"A": queries.ACKNOWLEDGED, "B": queries.ACKNOWLEDGED_FAULT},
        [
            *WHERE[1:],
            Column("state", "Fault", width=100),
            Column("B", "Faulty since", unit="dateTimeAsIsoNoDateIfToday", width=160),
            Column("A", "Acknowledged", unit="dateTimeAsIsoNoDateIfToday", width=160),
            Column("author", "By", width=140),
            Column("comment", "Words"),
        ],
        sort="Acknowledged",
    ).height(8)


def alerts() -> table.Panel:
    """What fires."""
    return tables.listing(
        "Firing alerts",
        "What fires, where, and since when? A click on the alert opens its runbook. Since is when "
        "the alert began, which is confirm_after later than the fault.",
        "Nothing fires",
        {"A": queries.FIRING_WITH_RUNBOOK, "B": queries.FIRING_SINCE, "C": queries.FIRING_FOR},
        [
            ALERT,
            *WHERE,
            Column("B", "Since", unit="dateTimeAsIsoNoDateIfToday", width=160),
            Column("C", "For", unit="dtdurations", width=160),
            Column("runbooks_url", "Runbooks", hidden=True),
        ],
        sort="Since",
        by="alertname, severity, fleet, robot, component",
    )


def history() -> timeseries.Panel:
    """Firing alerts over time."""
    panel = panels.graph(
        "Firing over time",
        "When were there how many alerts, and of which kind?",
        panels.over_time(queries.FIRING_BY_NAME, "{{alertname}}"),
    )
    return panels.stacked(panel).min(0).decimals(0).span(12).height(10)


def fired() -> table.Panel:
    """What fired in the time range, often first: Nagios' alert summary."""
    return (
        tables.listing(
            "Fired in the time range",
            "What fired, how often, and when last? Most often first.",
            "Nothing fired",
            {"A": queries.TIMES_FIRED, "B": queries.LAST_FIRED},
            [
                Column("alertname", "Alert"),
                *WHERE,
                Column("A", "Times", width=80),
                Column("B", "Last", unit="dateTimeAsIso", width=160),
            ],
            sort="Times",
            by="alertname, severity, fleet, robot, component",
        )
        .span(12)
        .height(10)
    )


def notifications() -> timeseries.Panel:
    """Notifications over time."""
    return panels.graph(
        "Notifications over time",
        "When was how much told, by which way, and when did that fail?",
        panels.over_time(queries.SENT, "{{integration}}: sent or tried"),
        panels.over_time(queries.FAILED, "{{integration}}: failed", "B"),
    ).override_by_regexp("/: failed$/", panels.dashed(palette.CRITICAL.colour))


def sent() -> stat.Panel:
    """Notifications in the time range."""
    return _by_integration(
        "Notifications",
        "How many notifications were handed over or tried in the time range?",
        queries.SENT_IN_RANGE,
    )


def failed() -> stat.Panel:
    """Failed ones."""
    colours = panels.steps((None, palette.OK.colour), (0.5, palette.CRITICAL.colour))
    panel = _by_integration(
        "Failed notifications",
        "How many attempts to notify failed in the time range? Alertmanager tries again.",
        queries.FAILED_IN_RANGE,
    )
    return panel.color_scheme(panels.by_thresholds()).thresholds(colours)


def _by_integration(title: str, description: str, expr: str) -> stat.Panel:
    panel = panels.number(title, description, expr).decimals(0)
    panel = panel.targets([panels.at_end(expr, "{{integration}}")])
    return panel.text_mode(common.BigValueTextMode.VALUE_AND_NAME).height(8).span(6)


def flapping() -> table.Panel:
    """Components that come and go."""
    return tables.listing(
        "Flapping",
        "Which components change their level so often that single changes are not told? The ratio "
        "is Nagios' weighted share of changes over the last 21 states; changes count since the "
        "exporter started.",
        "Nothing flaps",
        {"A": queries.FLAPPING, "B": queries.FLAPPING_SINCE, "C": queries.CHANGES},
        [
            *WHERE[1:],
            Column("A", "Flap ratio", unit="percentunit", width=110),
            Column("B", "Flapping since", unit="dateTimeAsIso", width=160),
            Column("C", "Changes", width=100),
        ],
        sort="Flap ratio",
    ).height(8)
