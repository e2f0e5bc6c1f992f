"""Alerts and reports: firing alerts, notifications, availability of the robots."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat, table, timeseries
from grafana_foundation_sdk.models import common

from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.dashboard import new_dashboard
from fleet_dashboards.lib.promql import acknowledged_faults, robot_row
from fleet_dashboards.lib.tables import Column

_FLEET = 'fleet=~"$fleet"'
# The Watchdog always fires, to show that alerts arrive: it is about no robot.
_ALERTS = f'{_FLEET}, alertname!="RosDiagnosticsWatchdog"'
_FIRING = f'ALERTS{{alertstate="firing", {_ALERTS}}}'
_ALERT = "alertname, severity, fleet, robot, component"
_COMPONENT = "by (fleet, robot, group, component)"

COMPONENT = (
    tables.FLEET,
    tables.ROBOT,
    Column("component", "Component", link=links.TO_COMPONENT),
)
ALERT = (
    Column("severity", "Severity", mappings=palette.severity_mappings(), width=100),
    *COMPONENT,
)


def build() -> builders.Dashboard:
    """Return the dashboard of alerts and of reports about a time range."""
    return new_dashboard(
        links.ALERTS_UID,
        "Alerts and reports",
        "Which alerts fire, were notifications sent, and how available were the robots?",
        [variables.fleet()],
        [
            *map(firing_by_severity, SEVERITIES),
            suppressed(),
            silences(),
            acknowledged_count(),
            firing_alerts(),
            acknowledged(),
            firing_over_time(),
            fired(),
            "Notifications",
            notifications_over_time(),
            notifications(),
            failed_notifications(),
            flapping(),
            "Availability in the time range",
            availability_of_robots(),
            availability_of_groups(),
            availability_of_fleets(),
            availability_over_time(),
        ],
    ).time("now-24h", "now")


SEVERITIES = {
    "critical": (palette.CRITICAL.colour, "What needs attention now"),
    "warning": (palette.WARNING.colour, "What needs attention today"),
    "info": (palette.NEUTRAL, "What is for information only"),
}


def firing_by_severity(severity: str) -> stat.Panel:
    """Count the firing alerts of one severity."""
    colour, question = SEVERITIES[severity]
    alerts = f'ALERTS{{alertstate="firing", severity="{severity}", {_ALERTS}}}'
    return (
        panels.number(
            f"Firing: {severity}",
            f"{question}? Firing alerts of this severity.",
            f"count({alerts})\nor vector(0)",
        )
        .color_mode(common.BigValueColorMode.BACKGROUND)
        .color_scheme(panels.by_thresholds())
        .thresholds(panels.steps((None, "transparent"), (1, colour)))
    )


def suppressed() -> stat.Panel:
    """Count the alerts that Alertmanager suppresses."""
    return panels.number(
        "Suppressed",
        "For how many firing alerts is no notification sent, because of a silence, an "
        "acknowledgement or a worse alert of the same fault?",
        'max(sum by (instance) (alertmanager_alerts{state="suppressed"}))',
    )


def silences() -> stat.Panel:
    """Count the active silences; a click opens Grafana's list of them."""
    url = "/alerting/silences?alertmanager=ROS%20diagnostics%20Alertmanager"
    return panels.number(
        "Silences",
        "How many silences and acknowledgements are active? A click lists them.",
        'max(sum by (instance) (alertmanager_silences{state="active"}))',
    ).data_links([builders.DashboardLink("List the silences").url(url)])


def acknowledged_count() -> stat.Panel:
    """Count the acknowledged faults."""
    return panels.number(
        "Acknowledged faults",
        "How many of the present faults are acknowledged?",
        f"count({acknowledged_faults(_FLEET)})\nor vector(0)",
    )


# --- Firing alerts and acknowledged faults ---

_ACTIVE_SINCE = f"""
min by ({_ALERT}) (
    ALERTS_FOR_STATE{{{_ALERTS}}}
  and ignoring (alertstate)
    {_FIRING}
)
"""
# The address at which the site serves its runbooks is joined to each alert.
_WITH_RUNBOOKS = f"""
  group by ({_ALERT}) ({_FIRING})
* on () group_left (runbooks_url)
  ros_diagnostics:site:info
"""


def firing_alerts() -> table.Panel:
    """List the firing alerts."""
    runbook = "${__data.fields.Runbooks}/${__data.fields.Alert}.md"
    return tables.joined(
        "Firing alerts",
        "Which alerts fire, where, and since when? A click on the alert opens its runbook. Since "
        "is when the alert became active, which is confirm_after later than the fault.",
        "No alert fires",
        {
            "A": _WITH_RUNBOOKS,
            "B": f"{_ACTIVE_SINCE} * 1000",
            "C": f"time() - {_ACTIVE_SINCE}",
        },
        [
            Column("alertname", "Alert", link=runbook),
            *ALERT,
            Column("B", "Since", unit="dateTimeAsIsoNoDateIfToday", width=160),
            Column("C", "For", unit="dtdurations", width=160),
            Column("runbooks_url", "Runbooks", hidden=True),
        ],
        sort="Since",
        by=_ALERT,
    )


_FAULT_SINCE = f"""
max {_COMPONENT} (
    component:ros_diagnostics_fault:confirmed{{{_FLEET}}}
  or
    {robot_row(f"robot:ros_diagnostics_fault:confirmed{{{_FLEET}}}")}
) * 1000
"""


def acknowledged() -> table.Panel:
    """List the acknowledged faults, with author and comment."""
    return tables.joined(
        "Acknowledged",
        "Who acknowledged which fault, when, and with which comment? Only present faults. "
        "Acknowledge with ros-diagnostics-ack; the exporter needs --alertmanager.url.",
        "No present fault is acknowledged",
        {"A": f"({acknowledged_faults(_FLEET)}) * 1000", "B": _FAULT_SINCE},
        [
            *COMPONENT,
            Column("state", "Fault", width=100),
            Column("B", "Faulty since", unit="dateTimeAsIsoNoDateIfToday", width=160),
            Column("A", "Acknowledged", unit="dateTimeAsIsoNoDateIfToday", width=160),
            Column("author", "By", width=140),
            Column("comment", "Comment"),
        ],
        sort="Acknowledged",
    ).height(8)


# --- Alerts of the time range ---


def firing_over_time() -> timeseries.Panel:
    """Show the number of firing alerts over time, by name."""
    panel = panels.graph(
        "Firing over time",
        "Which alerts fired when, and how many of each?",
        panels.over_time(f"count by (alertname) ({_FIRING})", "{{alertname}}"),
    )
    return panels.stacked(panel).min(0).decimals(0).span(12).height(10)


# ALERTS_FOR_STATE is the time at which the alert became active: each other value is another time.
_TIMES_FIRED = f"""
sum by ({_ALERT}) (
    1 + changes(ALERTS_FOR_STATE{{{_ALERTS}}}[$__range])
  and
    max without (alertstate) (max_over_time({_FIRING}[$__range]))
)
"""
_LAST_FIRED = f"""
max by ({_ALERT}) (max_over_time(timestamp({_FIRING})[$__range:1m])) * 1000
"""


def fired() -> table.Panel:
    """List the alerts that fired in the time range, most often first."""
    return (
        tables.joined(
            "Fired in the time range",
            "Which alerts fired, how often, and when last? Most often first.",
            "No alert fired",
            {"A": _TIMES_FIRED, "B": _LAST_FIRED},
            [
                Column("alertname", "Alert"),
                *ALERT,
                Column("A", "Times", width=80),
                Column("B", "Last", unit="dateTimeAsIso", width=160),
            ],
            sort="Times",
            by=_ALERT,
        )
        .span(12)
        .height(10)
    )


# --- Notifications, summed over the Alertmanagers of a cluster: one of them sends each ---


def _notifications(kind: str, window: str) -> str:
    counter = f"alertmanager_notifications{kind}_total[{window}]"
    return f"sum by (integration) (increase({counter}))"


def notifications_over_time() -> timeseries.Panel:
    """Show the notifications over time, and those that failed."""
    sent = f"{_notifications('', '$__rate_interval')} > 0"
    failed = f"{_notifications('_failed', '$__rate_interval')} > 0"
    return panels.graph(
        "Notifications over time",
        "How many notifications were sent by each integration, and how many failed?",
        panels.over_time(sent, "{{integration}}: attempts"),
        panels.over_time(failed, "{{integration}}: failed", "B"),
    ).override_by_regexp("/: failed$/", panels.dashed(palette.CRITICAL.colour))


def notifications() -> stat.Panel:
    """Count the notifications of the time range."""
    return _by_integration(
        "Notifications",
        "How many notifications were sent or attempted in the time range?",
        f"{_notifications('', '$__range')} > 0",
    )


def failed_notifications() -> stat.Panel:
    """Count the failed notifications of the time range."""
    colours = panels.steps((None, palette.OK.colour), (0.5, palette.CRITICAL.colour))
    # Alertmanager has a counter for every integration; only those in use show a zero.
    panel = _by_integration(
        "Failed notifications",
        "How many attempts failed in the time range? Alertmanager retries.",
        f"""
          {_notifications("_failed", "$__range")}
        and
          {_notifications("", "$__range")} > 0
        """,
    )
    return panel.color_scheme(panels.by_thresholds()).thresholds(colours)


def _by_integration(title: str, description: str, expr: str) -> stat.Panel:
    panel = panels.number(title, description, expr).decimals(0)
    panel = panel.targets([panels.at_end(expr, "{{integration}}")])
    return panel.text_mode(common.BigValueTextMode.VALUE_AND_NAME).height(8).span(6)


def flapping() -> table.Panel:
    """List the flapping components."""
    return tables.joined(
        "Flapping",
        "Which components change their level so often that no alert fires for single changes? The "
        "ratio is Nagios' weighted share of changes over the last 21 states; changes count since "
        "the exporter started.",
        "No component is flapping",
        {
            "A": f"max {_COMPONENT} (ros_diagnostics_component_flap_ratio{{{_FLEET}}}) > 0.1",
            "B": f"component:ros_diagnostics_flapping:start{{{_FLEET}}} * 1000",
            # Not increase() over the range: that would read the range of every component.
            "C": f"max {_COMPONENT} (ros_diagnostics_component_changes_total{{{_FLEET}}})",
        },
        [
            *COMPONENT,
            Column("A", "Flap ratio", unit="percentunit", width=110),
            Column("B", "Flapping since", unit="dateTimeAsIso", width=160),
            Column("C", "Changes", width=100),
        ],
        sort="Flap ratio",
    ).height(8)


# --- Availability: the share of the time range that was spent in each part. The parts sum to 100 %:
# the states, and what belongs to none (maintenance, pending, time without an exporter). ---

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
SHARES = (
    Column("available", "Available", unit="percentunit", width=100),
    *(
        Column(part, "OK" if part == "ok" else part.capitalize(), unit="percentunit", width=110)
        for part in PARTS
    ),
)
SUMS = (
    "Available is the share of OK and WARNING in the time without maintenance, pending and "
    "undetermined. The other columns sum to 100 %."
)


def _shares(record: str, by: str) -> str:
    """Return the share of each part, and as part "available" that of ok and warning.

    The latter is a share of the time in which the robot had a state.
    """
    seconds = f"{record}:ros_diagnostics_part_seconds:sum5m"

    def total(matchers: str, labels: str) -> str:
        series = f"{seconds}{{{_FLEET}{matchers}}}"
        return f"sum by ({labels}) (sum_over_time({series}[$__range]))"

    available = ', part=~"ok|warning"'
    with_state = ', part!~"maintenance|undetermined|pending"'
    return f"""
  {total("", f"{by}, part")}
/ on ({by}) group_left ()
  {total("", by)}
or
  label_replace(
      {total(available, by)}
    / on ({by})
      {total(with_state, by)},
    "part", "available", "", ""
  )
"""


_FAULTS = f"""
  sum by (fleet, robot) (
      1 + changes(component:ros_diagnostics_fault:confirmed{{{_FLEET}, state="critical"}}[$__range])
    or
      1 + changes(robot:ros_diagnostics_silent:confirmed{{{_FLEET}}}[$__range])
  )
"""
_LONGEST = f"""
  max by (fleet, robot) (
    max_over_time(robot:ros_diagnostics_down:seconds{{{_FLEET}}}[$__range])
  )
"""
_BY_ROBOT = f"""
{_shares("robot", "fleet, robot")}
or
  label_replace({_FAULTS}, "part", "faults", "", "")
or
  label_replace({_LONGEST}, "part", "longest", "", "")
"""


def availability_of_robots() -> table.Panel:
    """Show the shares of each robot, its faults and the longest of them."""
    return _availability(
        "Availability of the robots",
        f"How reliable was each robot? {SUMS} Faults counts confirmed CRITICAL faults and times of "
        "silence; longest is the longest time in CRITICAL or UNKNOWN, including maintenance. To "
        "download: menu of the panel, Inspect, Data, Download CSV.",
        _BY_ROBOT,
        [
            FLEET,
            tables.ROBOT,
            *SHARES,
            Column("faults", "Faults", width=80),
            Column("longest", "Longest", unit="dtdurations", width=150),
        ],
    ).height(12)


def availability_of_groups() -> table.Panel:
    """Show the shares of each group of robots."""
    return _availability(
        "Availability of the groups",
        f"How reliable was each group of robots? {SUMS}",
        _shares("robot_group", "fleet, robot_group"),
        [FLEET, Column("robot_group", "Group"), *SHARES],
    ).height(8)


def availability_of_fleets() -> table.Panel:
    """Show the shares of each fleet."""
    return _availability(
        "Availability of the fleets",
        f"How reliable was each fleet? {SUMS}",
        _shares("fleet", "fleet"),
        [FLEET, *SHARES],
    ).height(6)


def _availability(title: str, description: str, expr: str, columns: list[Column]) -> table.Panel:
    empty = "No data in this range"
    return tables.pivot(title, description, empty, expr, columns, label="part", sort="Available")


def availability_over_time() -> timeseries.Panel:
    """Show the shares of the chosen fleets over time."""
    panel = panels.graph(
        "Availability over time",
        "When were the robots available, and in which state were they otherwise?",
        panels.over_time(
            f"""
              sum by (part) (fleet:ros_diagnostics_part_seconds:sum5m{{{_FLEET}}})
            / on () group_left ()
              sum (fleet:ros_diagnostics_part_seconds:sum5m{{{_FLEET}}})
            """,
            "{{part}}",
        ),
        unit="percentunit",
    )
    for part, colour in PARTS.items():
        panel = panel.override_by_name(part, panels.series(part, colour))
    return panels.stacked(panel).min(0).max(1).span(panels.WIDTH)
