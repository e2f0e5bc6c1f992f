"""Prometheus and Alertmanager: do they keep up, and does what they tell arrive?"""

from __future__ import annotations

from grafana_foundation_sdk.builders import stat, timeseries

from fleet_dashboards.lib import palette, panels
from fleet_dashboards.queries import monitoring as queries


def rule_failures() -> stat.Panel:
    """Rules that failed or came too late."""
    return _count_that_should_be_zero(
        "Rule failures",
        "Did a rule fail or come too late during the time range? Then states are missing.",
        queries.RULE_FAILURES,
    )


def not_notified() -> stat.Panel:
    """Alerts that did not reach an Alertmanager."""
    return _count_that_should_be_zero(
        "Alerts lost",
        "How many alerts did not reach an Alertmanager during the time range?",
        queries.NOT_NOTIFIED,
    )


def _count_that_should_be_zero(title: str, description: str, expr: str) -> stat.Panel:
    colours = panels.steps((None, palette.OK.colour), (0.5, palette.CRITICAL.colour))
    panel = panels.number(title, description, expr).decimals(0)
    return panel.color_scheme(panels.by_thresholds()).thresholds(colours)


def alertmanagers() -> stat.Panel:
    """Alertmanagers that Prometheus sends to."""
    colours = panels.steps((None, palette.CRITICAL.colour), (1, palette.OK.colour))
    return (
        panels.number(
            "Alertmanagers",
            "To how many Alertmanagers does Prometheus send?",
            queries.ALERTMANAGERS,
        )
        .color_scheme(panels.by_thresholds())
        .thresholds(colours)
    )


def prometheus_series() -> stat.Panel:
    """Series in memory."""
    return panels.number(
        "Series in Prometheus", "How many series does Prometheus hold?", queries.PROMETHEUS_SERIES
    )


def cluster_members() -> stat.Panel:
    """The high-availability cluster."""
    return panels.number(
        "Alertmanager cluster",
        "How many Alertmanagers see one another? One that runs alone has no cluster.",
        queries.CLUSTER_MEMBERS,
    )


def reloaded() -> stat.Panel:
    """Whether the servers' configuration is the one on disk."""
    return panels.word(
        "Configuration",
        "Did the servers' last reload work?",
        queries.RELOADED,
        palette.worked_mappings(),
    )


def rule_time() -> timeseries.Panel:
    """Time of the rules."""
    return panels.graph(
        "Time of the rules",
        "How long does each group of rules take? It must stay below the evaluation interval.",
        panels.over_time(queries.RULE_TIME, "{{rule_group}}"),
        unit="s",
    )


def samples() -> timeseries.Panel:
    """Samples stored."""
    return panels.graph(
        "Samples stored",
        "How many samples does Prometheus store in a second?",
        panels.over_time(queries.PROMETHEUS_SAMPLES, "{{instance}}"),
        unit="cps",
    )


def alerts_known() -> timeseries.Panel:
    """Alerts in Alertmanager."""
    return panels.graph(
        "Alerts in Alertmanager",
        "How many alerts are active, how many suppressed by a silence, an acknowledgement or a "
        "worse alert?",
        panels.over_time(queries.ALERTS_KNOWN, "{{instance}}: {{state}}"),
    )


def latency() -> timeseries.Panel:
    """Time of a notification."""
    return panels.graph(
        "Time of a notification",
        "How long does handing over a notification take (95 %)?",
        panels.over_time(queries.NOTIFICATION_LATENCY, "{{integration}}"),
        unit="s",
    )


def server_cpu() -> timeseries.Panel:
    """CPU of the servers."""
    return panels.graph(
        "CPU of the servers",
        "How busy are Prometheus and Alertmanager? 100 % is one core.",
        panels.over_time(queries.SERVER_CPU, "{{job}} {{instance}}"),
        unit="percentunit",
    )


def server_memory() -> timeseries.Panel:
    """Memory of the servers."""
    return panels.graph(
        "Memory of the servers",
        "How much memory do Prometheus and Alertmanager take?",
        panels.over_time(queries.SERVER_MEMORY, "{{job}} {{instance}}"),
        unit="bytes",
    )
