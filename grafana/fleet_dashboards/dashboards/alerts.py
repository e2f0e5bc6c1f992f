"""Alerts and reports: firing alerts, notifications, availability of the robots."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat, table, timeseries
from grafana_foundation_sdk.models import common

from fleet_dashboards.dashboards.capabilities import availability
from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.dashboard import closed_row, new_dashboard
from fleet_dashboards.lib.problems import ACKNOWLEDGED, IDENTITY
from fleet_dashboards.lib.promql import DEVICE, HELD, HELD_OF_ROBOT, label, reached, settled
from fleet_dashboards.lib.tables import Column

_FLEET = 'fleet=~"$fleet"'
# Watchdog and canary fire to show that alerts arrive: they are about no robot. Unacknowledged
# repeats another alert, and is only suppressed by an acknowledgement: it goes on firing.
_ALERTS = f'{_FLEET}, alertname!~"RosDiagnostics(Watchdog|Canary|Unacknowledged)"'
_FIRES = f'alertstate="firing", {_ALERTS}'
_FIRING = f"ALERTS{{{_FIRES}}}"
_ALERT = "alertname, severity, fleet, site, robot, component, check, key"
# Where alerts are evaluated, so that none is good news.
_EVALUATED = "exporter:ros_diagnostics_exporter:held"
_COMPONENT = "by (fleet, robot, group, component)"

COMPONENT = (
    tables.ROBOT,
    Column("component", "Component", link=links.TO_COMPONENT, min_width=130),
)
_COLOURED = palette.words({word: (word, colour) for word, colour in palette.SEVERITIES.items()})
SEVERITY = Column("severity", "Severity", mappings=_COLOURED, width=100, background=True)
# The same as a number: Grafana sorts by what is shown only, and texts by their letters.
SEVERITY_RANKS = {severity: rank for rank, severity in enumerate(reversed(palette.SEVERITIES), 1)}
SEVERITY_RANK = SEVERITY._replace(
    field="A",
    mappings=palette.words(
        {
            "0": ("other", None),
            **{
                str(rank): (severity, palette.SEVERITIES[severity])
                for severity, rank in SEVERITY_RANKS.items()
            },
        }
    ),
)


def build() -> builders.Dashboard:
    """Return the dashboard of alerts and of reports about a time range."""
    return (
        new_dashboard(
            links.ALERTS_UID,
            "Alerts and reports",
            "Which alerts fire, were notifications sent, and how available were the robots?",
            [variables.fleet()],
            [
                firing_alerts(),
                *map(firing_by_severity, QUESTIONS),
                suppressed(),
                silences(),
                acknowledged_count(),
                firing_over_time(),
                fired(),
                closed_row("Acknowledged and flapping", acknowledged(), flapping()),
                "Notifications",
                notifications_over_time(),
                notifications(),
                failed_notifications(),
                "Availability in the time range",
                availability_of_robots(),
                availability(_FLEET),
                availability_of_groups(),
                availability_of_fleets(),
                availability_over_time(),
            ],
        )
        .time("now-24h", "now")
        .refresh("1m")
    )


QUESTIONS = {
    "critical": "What needs attention now",
    "warning": "What needs attention today",
    "info": "What is for information only",
}


def firing_by_severity(severity: str) -> stat.Panel:
    """Count the firing alerts of one severity."""
    alerts = f'ALERTS{{alertstate="firing", severity="{severity}", {_ALERTS}}}'
    panel = panels.number(
        severity.capitalize(),
        f"{QUESTIONS[severity]}? Firing alerts of this severity.",
        f"count({alerts})\nor on ()\n  group({_EVALUATED}) * 0",
    )
    return panels.on_colour(panel, (1, palette.SEVERITIES[severity]))


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
        f"""
          count(group by ({IDENTITY}) ({ACKNOWLEDGED}{{{_FLEET}}}))
        or on ()
          group({_EVALUATED}) * 0
        """,
    )


# --- Firing alerts and acknowledged faults ---

# When Prometheus was restarted, most alerts become active anew; faults do not begin anew.
_ACTIVE_SINCE = f"""
min by ({_ALERT}) (
    {_FIRING} * 0
  + on (fault) group_left ()
    max by (fault) ({HELD}{{fault!=""}})
  or
    ALERTS_FOR_STATE{{{_ALERTS}}}
  and ignoring (alertstate)
    {_FIRING}
)
"""


def _by_severity() -> str:
    """Return a series for each firing alert; the worse its severity, the greater its value."""
    ordered = [
        f'group by ({_ALERT}) (ALERTS{{severity="{severity}", {_FIRES}}}) * {rank}'
        for severity, rank in SEVERITY_RANKS.items()
    ]
    return "\nor\n".join([*ordered, f"group by ({_ALERT}) ({_FIRING}) * 0"])


_NAMED = f'label_join({HELD}{{fault!=""}}, "named", "", "check", "key")'
_TEXT = label(
    f'label_join({_NAMED}, "text", ": ", "named", "evidence")',
    *("message", "$1", "text", "(?s:(?:: )?(.*))"),
)
# Without the letters that all of them begin with.
_SHORT = palette.rewritten("/^RosDiagnostics(.+)$/", "$1")
_NAME = Column("alertname", "Alert", mappings=_SHORT, width=190)
_NOTIFIED = "ros_diagnostics_fault_notified_timestamp_seconds > 0"


def _of_fault(name: str, faults: str) -> str:
    """Return each firing alert with the label ``name`` of its fault, one of several."""
    named = f"topk by (fault) (1, group by (fault, {name}) ({faults}))"
    firing = f"({_FIRING} * on (fault) group_left ({name}) {named})"
    return f"topk by ({_ALERT}) (1, group by ({_ALERT}, {name}) {firing})"


def _of_downtime() -> str:
    """Return each alert of a downtime with its comment, one of several, as its message."""
    comments = label(f'ALERTS{{{_FIRES}, downtime!=""}}', "message", "$1", "downtime", "(.*)")
    return f"topk by ({_ALERT}) (1, group by ({_ALERT}, message) ({comments}))"


def firing_alerts() -> table.Panel:
    """List the firing alerts."""
    return tables.joined(
        "Firing alerts",
        "Which alerts fire, where, since when, and who was notified last? The worst first. Since "
        "is when the trouble began, of what is no fault of a robot when the alert became active. "
        "What is escalated because nobody acknowledged it is not listed twice.",
        {
            "A": _by_severity(),
            "B": f"{_ACTIVE_SINCE} * 1000",
            "C": f"{_of_fault('message', _TEXT)}\nor\n{_of_downtime()}",
            "D": _of_fault("receiver", _NOTIFIED),
            "E": f"""
              max by ({_ALERT}) (
                {_FIRING} * 0 + on (fault) group_left () max by (fault) ({_NOTIFIED})
              ) * 1000
            """,
        },
        [
            SEVERITY_RANK,
            tables.ROBOT._replace(min_width=0, width=115),
            Column("message", "Message", min_width=200),
            Column("component", "Component", link=links.TO_COMPONENT, width=115),
            Column("B", "Since", unit=tables.MINUTE, width=105),
            Column("receiver", "Notified", width=90),
            Column("E", "At", unit=tables.MINUTE, width=105),
            _NAME,
            tables.FLEET._replace(hidden=True),
        ],
        empty=tables.Empty("No alert fires", _EVALUATED, "alertname"),
        sort=("Severity", "Since"),
        by=_ALERT,
    )


def acknowledged() -> table.Panel:
    """List the acknowledged faults, with author and comment."""
    named = f'label_join({ACKNOWLEDGED}{{{_FLEET}}}, "fault", " ", "check", "key", "state")'
    return tables.joined(
        "Acknowledged",
        "Who acknowledged which fault, when, and with which comment? Only present faults. "
        "Acknowledge with ros-diagnostics ack; the exporter needs --alertmanager.url.",
        {
            "A": f"max by ({IDENTITY}, fault, author, comment) ({named}) * 1000",
            "B": f"max by ({IDENTITY}) ({HELD}{{{_FLEET}}}) * 1000",
        },
        [
            Column("fault", "Fault", width=150),
            *COMPONENT,
            Column("B", "Since", unit=tables.TIME, width=160),
            Column("A", "Acknowledged", unit=tables.TIME, width=160),
            Column("author", "By", width=130),
            Column("comment", "Comment", min_width=250),
            tables.FLEET,
        ],
        empty=tables.Empty("No present fault is acknowledged", _EVALUATED, "comment"),
        sort=("Acknowledged",),
        by=IDENTITY,
    ).height(8)


# --- Alerts of the time range ---


def firing_over_time() -> timeseries.Panel:
    """Show the number of firing alerts over time, in the colours of their severities."""
    alerts = f"count by (severity, alertname) ({_FIRING})"
    none = f"group({_EVALUATED}) * 0"
    panel = panels.graph(
        "Firing over time",
        "Which alerts fired when, and how many of each?",
        panels.over_time(f"{alerts}\nor on ()\n  {none}", "{{severity}}: {{alertname}}"),
    ).override_by_name(": ", panels.series("none", palette.OK.colour))
    for severity, colour in palette.SEVERITIES.items():
        panel = panel.override_by_regexp(f"/^{severity}: /", [panels.fixed_colour(colour)])
    return panels.stacked(panel).min(0).axis_soft_max(4).decimals(0).span(24).height(8)


# Of a fault each other start is another time, which a restart of Prometheus is not; of other alerts
# each other time at which they became active, ALERTS_FOR_STATE.
_TIMES_FIRED = f"""
sum by ({_ALERT}) (
    max without (alertstate) (max_over_time({_FIRING}[$__range]))
  * on (fault) group_left ()
    sum by (fault) (1 + changes({HELD}{{fault!=""}}[$__range]))
  or
    1 + changes(ALERTS_FOR_STATE{{fault="", {_ALERTS}}}[$__range])
  and
    max without (alertstate) (max_over_time({_FIRING}[$__range]))
)
"""
_LAST_BEGAN = f"""
max by ({_ALERT}) (
    max without (alertstate) (max_over_time({_FIRING}[$__range])) * 0
  + on (fault) group_left ()
    max by (fault) (max_over_time({HELD}{{fault!=""}}[$__range]))
  or
    max_over_time(ALERTS_FOR_STATE{{fault="", {_ALERTS}}}[$__range])
  and
    max without (alertstate) (max_over_time({_FIRING}[$__range]))
) * 1000
"""


def fired() -> table.Panel:
    """List the alerts that fired in the time range, most often first."""
    return tables.joined(
        "Fired in the time range",
        "Which alerts fired, how often, and when did the last one begin? Most often first.",
        {"A": _TIMES_FIRED, "B": _LAST_BEGAN},
        [
            Column("A", "Times", width=90),
            SEVERITY,
            _NAME,
            *COMPONENT,
            Column("B", "Last began", unit=tables.TIME, width=160),
            tables.FLEET,
        ],
        empty=tables.Empty("No alert fired", _EVALUATED, "alertname"),
        sort=("Times",),
        by=_ALERT,
    ).height(10)


# --- Notifications, summed over the Alertmanagers of a cluster: one of them sends each ---


def _notifications(kind: str, window: str) -> str:
    counter = f"alertmanager_notifications{kind}_total[{window}]"
    return f"round(sum by (integration) (increase({counter})))"


def notifications_over_time() -> timeseries.Panel:
    """Show the notifications over time, and those that failed."""
    sent = f"{_notifications('', '$__rate_interval')} > 0"
    failed = f"{_notifications('_failed', '$__rate_interval')} > 0"
    return (
        panels.graph(
            "Notifications over time",
            "How many notifications were sent by each integration, and how many failed?",
            panels.over_time(sent, "{{integration}}: attempts"),
            panels.over_time(failed, "{{integration}}: failed", "B"),
        )
        .override_by_regexp("/: failed$/", panels.dashed(palette.CRITICAL.colour))
        .min(0)
    )


def notifications() -> stat.Panel:
    """Count the notifications of the time range."""
    return _by_integration(
        "Notifications",
        "How many notifications were sent or attempted in the time range?",
        f"{_notifications('', '$__range')} > 0",
    )


def failed_notifications() -> stat.Panel:
    """Count the failed notifications of the time range."""
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
    return panels.on_colour(panel, (1, palette.CRITICAL.colour))


def _by_integration(title: str, description: str, expr: str) -> stat.Panel:
    expr = f"""
      (
        {expr}
      )
    or on ()
      group(alertmanager_notifications_total) * 0
    """
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
        {
            # It begins above one ratio and ends below another: the fault, not a ratio, says so.
            "B": f'max {_COMPONENT} ({HELD}{{{_FLEET},scope="flapping", state="flapping"}}) * 1000',
            "A": f"max {_COMPONENT} (ros_diagnostics_component_flap_ratio{{{_FLEET}}})",
            # Not increase() over the range: that would read the range of every component.
            "C": f"max {_COMPONENT} (ros_diagnostics_component_changes_total{{{_FLEET}}})",
        },
        [
            Column("A", "Flap ratio", unit="percentunit", width=110),
            *COMPONENT,
            Column("B", "Flapping since", unit=tables.TIME, width=160),
            Column("C", "Changes", width=100),
            tables.FLEET,
            Column("note", "Note", min_width=300),
        ],
        empty=tables.Empty("No component is flapping", reached(settled(_FLEET)), "note"),
        sort=("Flap ratio",),
    ).height(8)


# --- Availability: the share of the time range that was spent in each part. The parts sum to 100 %:
# the states, and what belongs to none (maintenance, pending, time without an exporter). ---

PARTS = {
    "ok": palette.OK.colour,
    "warning": palette.WARNING.colour,
    "stale": palette.STALE.colour,
    "critical": palette.CRITICAL.colour,
    "silent": palette.SILENT.colour,
    "unreachable": palette.UNREACHABLE.colour,
    "maintenance": palette.MAINTENANCE_COLOUR,
    "pending": palette.PENDING.colour,
    "undetermined": palette.UNDETERMINED_COLOUR,
}
FLEET = Column("fleet", "Fleet")
SHARES = (
    Column("available", "Available", unit="percentunit", width=110),
    *(
        Column(part, "OK" if part == "ok" else part.capitalize(), unit="percentunit", width=120)
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


# A fault's value is its start: each other start is another time.
_FAULTS = f"""
  sum by (fleet, robot) (
    max by (fleet, robot, fault) (
      1 + changes({HELD_OF_ROBOT}{{{_FLEET}, severity="critical"}}[$__range])
    ) unless on (fleet, robot) {DEVICE}
  )
"""
_LONGEST = f"""
  max by (fleet, robot) (
    max_over_time(robot:ros_diagnostics_down:seconds{{{_FLEET}}}[$__range])
    unless on (fleet, robot) {DEVICE}
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
        f"How reliable was each robot? {SUMS} Faults counts faults of severity critical, silence "
        "and faults of many robots included; longest is the longest time with such a fault. To "
        "download: menu of the panel, Inspect, Data, Download CSV.",
        _BY_ROBOT,
        [
            FLEET,
            tables.ROBOT,
            *SHARES,
            Column("faults", "Faults", width=80),
            Column("longest", "Longest", unit=tables.DURATION, width=115),
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
    return tables.pivot(title, description, expr, columns, label="part", sort="Available")


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
