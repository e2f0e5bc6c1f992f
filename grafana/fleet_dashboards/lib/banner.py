"""The top of every dashboard: whether the monitoring itself works, and how old the data is."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat
from grafana_foundation_sdk.models import common, dashboard

from fleet_dashboards.lib import links, palette, panels
from fleet_dashboards.lib.promql import label

_FLEET = 'fleet=~"$fleet"'
_EXPORTERS = f"exporter:ros_diagnostics_exporter:held{{{_FLEET}}}"
_HELD = "exporter:ros_diagnostics_exporter:held"
_JOBS = 'job=~"(.*/)?ros-diagnostics(-exporter|-faults)?"'
_SENT = "prometheus_notifications_errors_total"
_FAILED = 'increase(alertmanager_notifications_failed_total{{integration{}"webhook"}}[10m]) > 0'
# At a centre series have the label site. How long ago, in minutes, anything of it was recorded.
_SILENT_SITE = f"""
    floor(
        (time() - max by (site) (max_over_time(timestamp({_HELD}{{site!=""}})[1d:1m]))) / 60
    ) >= 2
"""
# How long it has not answered, in minutes; 0 also where it never did.
_SILENT_ALERTMANAGER = """
    floor((time() - max_over_time(timestamp(up{job="alertmanager"} == 1)[1d:1m])) / 60)
    and on (instance)
      up{job="alertmanager"} == 0
  or
    up{job="alertmanager"} == 0
"""
# How long it has not answered, in minutes; 0 also where that was longer ago than a day.
_AWAY = f"""
    max by (fleet) (
        (
            floor((time() - max_over_time(timestamp(up{{{_JOBS}}} == 1)[1d:1m])) / 60)
          + on (instance, job) group_right ()
            {_EXPORTERS} * 0
        or
          {_EXPORTERS} * 0
        )
      unless on (instance, job)
        up == 1
    )
"""
_ALERTED = 'ALERTS{alertname="RosDiagnosticsExporterDown", alertstate="firing"}'
_FAILING = f"sum by (instance, alertmanager) (increase({_SENT}[1m])) > 0"
_NOT_REACHED = label(_FAILING, "at", "$1", "alertmanager", "(?:https?://)?([^/]*).*")
_REACHES_NONE = f"""
    group(
        count by (instance) ({_FAILING})
      >= on (instance)
        max by (instance) (prometheus_notifications_alertmanagers_discovered)
    )
"""


def _for(minutes: str, name: str, words: str) -> str:
    """Return a series for each ``name``, in whose label its number of minutes follows the words."""
    return f"""
        label_join(
          count_values by ({name}) ("for", {minutes}), "{name}", "{words}", "{name}", "for"
        )
    """


# Expression (1: broken, 2: not known) and the text; $1 is the label's value.
_BROKEN = (
    (
        _for(f"({_AWAY}) and on (fleet) {_ALERTED}", "fleet", " has not answered for "),
        "The exporter of $1 min, its alert was sent: faults are shown as they were then",
        "fleet",
    ),
    (
        _for(f"({_AWAY}) unless on (fleet) {_ALERTED}", "fleet", " has not answered for "),
        "The exporter of $1 min, nobody is notified yet: faults are shown as they were then",
        "fleet",
    ),
    (
        f"group by (instance) (up{{{_JOBS}}} == 0) unless on (instance) {_HELD}",
        "Exporter $1 has never answered: its robots are monitored only where another has them",
        "instance",
    ),
    (
        f"""
        group by (fleet) (
            group by (fleet, exporter) (last_over_time({_HELD}{{{_FLEET}, site=""}}[1h]))
          unless on (fleet, exporter)
            {_HELD}
          and on ()
            {_HELD}
        )
        """,
        "An exporter of $1 is no longer scraped: its robots are not monitored",
        "fleet",
    ),
    (
        f"group by (fleet) (ros_diagnostics_exporter_settled{{{_FLEET}}} == 0) * 2",
        "The exporter of $1 has just started: what it has not received yet is not known",
        "fleet",
    ),
    (
        f'vector(1) unless on () ({_HELD} or last_over_time({_HELD}{{site!=""}}[1d]))',
        "No exporter is scraped, or the rules are not evaluated",
        "",
    ),
    (
        f'group(time() - timestamp({_HELD}{{site=""}}) > 60)',
        "The rules are not evaluated",
        "",
    ),
    (
        _for(_SILENT_SITE, "site", " for "),
        "Nothing received from site $1 min: its robots are as they were before",
        "site",
    ),
    (
        "max(prometheus_notifications_alertmanagers_discovered) < bool 1 == 1",
        "Prometheus has no Alertmanager: nobody is notified of new faults",
        "",
    ),
    (
        _for(_SILENT_ALERTMANAGER, "instance", " has not answered for "),
        "Alertmanager $1 min",
        "instance",
    ),
    (_REACHES_NONE, "Prometheus does not reach Alertmanager: nobody is notified of new faults", ""),
    (
        f"group by (at) ({_NOT_REACHED}) unless on () {_REACHES_NONE}",
        "Prometheus does not reach Alertmanager $1",
        "at",
    ),
    (
        f"group by (integration) ({_FAILED.format('!=')})",
        "Notifications by $1 failed within ten minutes",
        "integration",
    ),
    (
        # Most webhooks are the exporter's own record of notifications, which has the gap anyway
        # while the exporter does not answer.
        f"""
          group by (integration) ({_FAILED.format("=")}) * 2
        unless on ()
          (min_over_time(up{{{_JOBS}}}[10m]) == 0)
        """,
        "Webhooks of Alertmanager failed within ten minutes: what was notified is not known",
        "",
    ),
    (
        f'(vector(2) unless on () up{{job="alertmanager"}}) or (vector(2) unless on () {_SENT})',
        "Prometheus or Alertmanager is not scraped: whether notifications are sent is not known",
        "",
    ),
)
WORKS = "The monitoring works"
DEAD = (
    "Prometheus does not answer: nothing on this page is known, and nobody is notified; "
    "the exporter's own page says since when"
)


def _trouble() -> str:
    """Return a series for each fault of the monitoring, with its text as a label."""
    return "\nor\n".join(
        label(f"({expr})", "text", text, source, "(.*)" if source else "")
        for expr, text, source in _BROKEN
    )


def monitoring() -> stat.Panel:
    """Show what is broken in the monitoring."""
    link = builders.DashboardLink("Hosts and monitoring").url(links.TO_MONITORING)
    trouble = f"max by (text) (\n{_trouble()}\n)"
    works = label(f"(vector(0) unless on ()\n{trouble}\n)", "text", WORKS)
    return (
        panels.texts(
            "Monitoring",
            "Does the monitoring itself work: do the exporters answer, are the rules evaluated, "
            "is Alertmanager reached, and are notifications delivered? If not, do not rely on what "
            "is shown below.",
            f"{trouble}\nor\n{works}",
            "text",
            [
                *palette.words({WORKS: (WORKS, palette.NOTHING)}),
                *palette.rewritten("/(.* is not known)$/", "$1", palette.WARNING.colour),
                *palette.rewritten("/(.*)/", "$1", palette.CRITICAL.colour),
                palette.special(dashboard.SpecialValueMatch.NULL, DEAD, palette.CRITICAL.colour),
            ],
        )
        .data_links([link])
        .orientation(common.VizOrientation.HORIZONTAL)  # up to three lines, below one another
        .text(panels.text_of(value=16))
        .height(3)
        .span(20)
    )


def data_as_of() -> stat.Panel:
    """Show when the exporters were scraped last: clock and age of the page in one."""
    scraped = f"timestamp(ros_diagnostics_exporter_settled{{{_FLEET}}})"
    # Of one that does not answer there is no sample; it is held while its target exists. The time
    # is exact in the first hour.
    last = f"max_over_time({scraped}[1h:5s]) or max_over_time({scraped}[1d:1m])"
    before = f"max by (instance) ({last}) and on (instance) {_HELD}"
    return (
        panels.number(
            "Data as of",
            "How old is this page? When the exporters were last scraped; of several, the one for "
            "which that is longest ago. Times on dashboards are in Grafana's time zone, by "
            "default the browser's; notifications have UTC.",
            f"min(\n  max by (instance) ({scraped})\nor\n  ({before})\n) * 1000",
            "dateTimeAsIsoNoDateIfToday",
        )
        .no_value("not known")
        .text(panels.text_of(value=20))
        .height(3)
        .span(4)
    )
