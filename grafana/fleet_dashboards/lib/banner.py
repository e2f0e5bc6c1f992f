"""The top of every dashboard: whether the monitoring itself works, and how old the data is."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.lib import links, palette, panels
from fleet_dashboards.lib.promql import label

_FLEET = 'fleet=~"$fleet"'
_EXPORTERS = f"exporter:ros_diagnostics_exporter:held{{{_FLEET}}}"
_SENT = "prometheus_notifications_errors_total"

# Expression (1: broken, 2: not known) and the text; $1 is the label's value.
_BROKEN = (
    (
        f"group by (fleet) ({_EXPORTERS} unless on (instance, job) up == 1)",
        "The exporter of $1 does not answer: faults are as they were before",
        "fleet",
    ),
    (
        "vector(1) unless on () exporter:ros_diagnostics_exporter:held",
        "No exporter was ever scraped, or the rules are not evaluated",
        "",
    ),
    (
        "group(time() - timestamp(exporter:ros_diagnostics_exporter:held) > 60)",
        "The rules are not evaluated",
        "",
    ),
    (
        "max(prometheus_notifications_alertmanagers_discovered) < bool 1 == 1",
        "Prometheus has no Alertmanager: no notification is sent",
        "",
    ),
    (
        'group by (instance) (up{job="alertmanager"} == 0)',
        "Alertmanager $1 does not answer",
        "instance",
    ),
    (
        f"group(increase({_SENT}[2m]) > 0)",
        "Prometheus does not reach Alertmanager: no notification is sent",
        "",
    ),
    (
        "group by (integration) (increase(alertmanager_notifications_failed_total[10m]) > 0)",
        "Notifications by $1 failed within ten minutes",
        "integration",
    ),
    (
        f'(vector(2) unless on () up{{job="alertmanager"}}) or (vector(2) unless on () {_SENT})',
        "Prometheus or Alertmanager is not scraped: whether notifications are sent is not known",
        "",
    ),
)
WORKS = "The monitoring works"
DEAD = "Prometheus does not answer: nothing on this page is known"


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
        .height(2)
        .span(18)
    )


def data_as_of() -> stat.Panel:
    """Show when the exporters were scraped last: clock and age of the page in one."""
    return (
        panels.number(
            "Data as of",
            "How old is this page? When the exporters were last scraped; of several, the one for "
            "which that is longest ago.",
            f"min(timestamp(ros_diagnostics_exporter_settled{{{_FLEET}}})) * 1000",
            "dateTimeAsIsoNoDateIfToday",
        )
        .no_value("not known")
        .height(2)
        .span(6)
    )
