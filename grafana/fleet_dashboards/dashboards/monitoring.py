"""Hosts and the monitoring itself: scraped targets, exporters, Prometheus, Alertmanager."""

from __future__ import annotations

from grafana_foundation_sdk.builders import bargauge, stat, table, timeseries
from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.dashboards import hosts
from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.dashboard import closed_row, new_dashboard
from fleet_dashboards.lib.promql import label
from fleet_dashboards.lib.tables import Column

_FLEET = 'fleet=~"$fleet"'
_EXPORTER = f'job=~"ros-diagnostics(-faults)?", {_FLEET}'
_BY = "fleet, exporter, instance"
_SERVERS = 'job=~"prometheus|alertmanager"'

_TARGET = 12  # seconds; one of the buckets
FLEET = Column("fleet", "Fleet", min_width=90)
UP = palette.up_mappings()
SUCCESS = palette.words(
    {"1": ("succeeded", palette.OK.colour), "0": ("failed", palette.CRITICAL.colour)}
)


def build() -> builders.Dashboard:
    """Return the dashboard of hosts and monitoring."""
    return new_dashboard(
        links.MONITORING_UID,
        "Hosts and monitoring",
        "Does the monitoring itself work?",
        [variables.fleet()],
        [
            exporters(),
            targets(),
            domains_down(),
            "Exporters",
            messages(),
            rejected_messages(),
            exporter_scrape_time(),
            exporter_cpu(),
            exporter_memory(),
            series(),
            series_by_family(),
            "Prometheus and Alertmanager",
            rule_failures(),
            alerts_lost(),
            alertmanagers(),
            prometheus_series(),
            alertmanager_cluster(),
            configuration(),
            rule_time(),
            samples(),
            alerts(),
            notification_time(),
            server_cpu(),
            server_memory(),
            closed_row("Canary", canaries_in_time(), canary_under_way(), canary_time()),
            closed_row("Hosts", hosts.pings(), hosts.ping_time()),
            closed_row("Computers", hosts.computers(), *hosts.computers_over_time()),
        ],
    )


def targets() -> table.Panel:
    """List all that Prometheus scrapes."""
    by = "job, instance, fleet"
    return (
        tables.joined(
            "Targets",
            "Which targets are up, how long do scrapes take, and how many samples do they return?",
            {
                "A": f"max by ({by}) (up)",
                "B": f"max by ({by}) (scrape_duration_seconds)",
                "C": f"max by ({by}) (scrape_samples_scraped)",
            },
            [
                Column("A", "State", mappings=UP, width=80, background=True),
                Column("job", "Job", min_width=130),
                Column("instance", "Instance", min_width=130),
                FLEET,
                Column("B", "Duration", unit="s", width=90),
                Column("C", "Samples", width=90),
            ],
            sort=("State", "Job"),
            ascending=("State", "Job"),
            by=by,
        )
        .height(8)
        .span(18)
    )


# --- Exporters ---


def _of_exporter(function: str, metric: str) -> str:
    return f"{function} by ({_BY}) (ros_diagnostics_exporter_{metric}{{{_FLEET}}})"


def _time_of_exporter(metric: str) -> str:
    """Return the same for a time, which Grafana wants in milliseconds."""
    return f"""
max by ({_BY}) (
  ros_diagnostics_exporter_{metric}{{{_FLEET}}}
) * 1000
"""


def exporters() -> table.Panel:
    """List the exporters."""
    build = f"ros_diagnostics_exporter_build_info{{{_FLEET}}}"
    discovery = "discovery_last_run_timestamp_seconds"
    return tables.joined(
        "Exporters",
        "Which version serves each fleet, with how many robots, and did the last reload of the "
        "config and the last write of the database succeed? Acknowledgements: whether "
        "Alertmanager answers; empty without --alertmanager.url.",
        {
            "A": f"group by ({_BY}, version, ros_distro) ({build})",
            "B": _of_exporter("max", "config_last_reload_successful"),
            "C": _time_of_exporter("config_last_reload_success_timestamp_seconds"),
            "D": _of_exporter("max", "storage_last_write_successful"),
            "E": _time_of_exporter("storage_last_write_success_timestamp_seconds"),
            "F": _of_exporter("max", "robots"),
            "G": f"count by ({_BY}) (ros_diagnostics_exporter_domain_up{{{_FLEET}}} == 1)",
            "H": f"floor(time() - {_of_exporter('min', discovery)})",
            "I": _of_exporter("max", "alertmanager_up"),
        },
        [
            Column("fleet", "Fleet", min_width=90),
            Column("exporter", "Exporter", min_width=90),
            Column("instance", "Instance", min_width=130),
            Column("version", "Version", width=80),
            Column("ros_distro", "ROS", width=70),
            Column("F", "Robots", width=75),
            Column("G", "Domains", width=80),
            Column("H", "Discovery", unit=tables.DURATION, width=115),
            Column("B", "Config", mappings=SUCCESS, width=100, background=True),
            Column("C", "Config read", unit=tables.MINUTE, width=115),
            Column("D", "State file", mappings=SUCCESS, width=100, background=True),
            Column("E", "State written", unit=tables.MINUTE, width=115),
            Column("I", "Acknowledgements", mappings=UP, width=150, background=True),
        ],
        empty=tables.Empty("none answers", "vector(1)", "fleet"),
        sort=("Fleet",),
        ascending=("Fleet",),
        by=_BY,
    ).height(6)


def domains_down() -> table.Panel:
    """List the DDS domains that could not be joined."""
    domains = f"ros_diagnostics_exporter_domain_up{{{_FLEET}}}"
    return (
        tables.joined(
            "DDS domains down",
            "Which DDS domains could not be joined?",
            {"A": f"group by (fleet, domain_id) ({domains} == 0)"},
            [FLEET, Column("domain_id", "Domain")],
            sort=("Domain",),
            ascending=("Domain",),
            empty=tables.Empty("All are joined", domains, "domain_id"),
        )
        .height(8)
        .span(6)
    )


def _rate_by_fleet(counter: str) -> str:
    return f"sum by (fleet) (rate({counter}[$__rate_interval]))"


def messages() -> timeseries.Panel:
    """Show the rate of messages of each fleet."""
    received = f"ros_diagnostics_robot_messages_total{{{_FLEET}}}"
    return panels.graph(
        "Messages per second",
        "How many arrays are received per second from each fleet? One of several robots counts for "
        "each of them.",
        panels.over_time(_rate_by_fleet(received), "{{fleet}}"),
    ).min(0)


def rejected_messages() -> timeseries.Panel:
    """Show the rate of rejected messages by reason."""
    counters = (
        f"ros_diagnostics_robot_rejected_total{{{_FLEET}}}",
        f"ros_diagnostics_exporter_rejected_total{{{_FLEET}}}",
    )
    rates = "\nor\n".join(
        f"sum by (fleet, reason) (rate({each}[$__rate_interval])) > 0" for each in counters
    )
    none = label(f"sum by (fleet) (rate({counters[0]}[$__rate_interval])) * 0", "reason", "nothing")
    return (
        panels.graph(
            "Rejected messages per second",
            "What is rejected, and why?",
            panels.over_time(f"({rates})\nor on (fleet)\n  {none}", "{{fleet}}: {{reason}}"),
        )
        .min(0)
        .axis_soft_max(1)
    )


def exporter_scrape_time() -> timeseries.Panel:
    """Show how long scrapes take."""
    scrape = f"max by (job, instance) (scrape_duration_seconds{{{_EXPORTER}}})"
    rendering = _of_exporter("max", "last_scrape_duration_seconds")
    return panels.graph(
        "Scrape duration",
        "How long does a scrape of each exporter take, and how much of that is rendering?",
        panels.over_time(scrape, "{{instance}} {{job}}"),
        panels.over_time(rendering, "{{instance}} rendering", "B"),
        unit="s",
    )


def exporter_cpu() -> timeseries.Panel:
    """Show the CPU time of the exporters, and what it goes to."""
    total = _rate(f"process_cpu_seconds_total{{{_EXPORTER}}}")
    decoding = _rate(f"ros_diagnostics_exporter_decode_seconds_total{{{_FLEET}}}")
    ingest = _rate(f"ros_diagnostics_exporter_ingest_seconds_total{{{_FLEET}}}")
    return panels.graph(
        "CPU of the exporters",
        "What do the exporters spend their time on? 100 % is one core.",
        panels.over_time(total, "{{instance}}: total"),
        panels.over_time(decoding, "{{instance}}: decoding", "B"),
        panels.over_time(ingest, "{{instance}}: ingest", "C"),
        unit="percentunit",
    )


def _rate(counter: str) -> str:
    return f"max by (instance) (rate({counter}[$__rate_interval]))"


def exporter_memory() -> timeseries.Panel:
    """Show the memory of the exporters."""
    memory = f"max by (instance) (process_resident_memory_bytes{{{_EXPORTER}}})"
    return panels.graph(
        "Memory of the exporters",
        "How much memory do the exporters use, and does it grow?",
        panels.over_time(memory, "{{instance}}"),
        unit="bytes",
    ).min(0)


def series() -> timeseries.Panel:
    """Show the number of series of each exporter, and its limit."""
    return panels.graph(
        "Series of the exporters",
        "How near is each exporter to its limit of series? Dashed: the limit.",
        panels.over_time(_of_exporter("sum", "series"), "{{fleet}} {{instance}}"),
        panels.over_time(_of_exporter("max", "series_limit"), "limit of {{fleet}}", "B"),
        unit="locale",  # else Grafana writes 1 Mil
    ).override_by_regexp("/^limit of /", panels.dashed(palette.CRITICAL.colour))


def series_by_family() -> bargauge.Panel:
    """Show the number of series of each metric family."""
    return panels.bars(
        "Series by family",
        "How many series does each metric family have?",
        panels.at_end(
            f"max by (fleet, family) (ros_diagnostics_exporter_series{{{_FLEET}}})",
            "{{fleet}}: {{family}}",
        ),
    )


# --- Prometheus and Alertmanager ---


def rule_failures() -> stat.Panel:
    """Count the failed and missed evaluations of rules."""
    return _should_be_zero(
        "Rule failures",
        "How many rule evaluations failed or were missed in the time range?",
        """
          sum by (instance) (increase(prometheus_rule_evaluation_failures_total[$__range]))
        +
          sum by (instance) (increase(prometheus_rule_group_iterations_missed_total[$__range]))
        """,
    )


def alerts_lost() -> stat.Panel:
    """Count the alerts that did not reach an Alertmanager."""
    return _should_be_zero(
        "Alerts not sent",
        "How many alerts did not reach an Alertmanager in the time range?",
        """
          sum by (instance) (increase(prometheus_notifications_errors_total[$__range]))
        +
          sum by (instance) (increase(prometheus_notifications_dropped_total[$__range]))
        """,
    )


def _should_be_zero(title: str, description: str, expr: str) -> stat.Panel:
    panel = panels.number(title, description, f"round({expr})").decimals(0)
    return panels.on_colour(panel, (1, palette.CRITICAL.colour))


def alertmanagers() -> stat.Panel:
    """Count the Alertmanagers that Prometheus sends alerts to."""
    panel = panels.number(
        "Alertmanagers",
        "To how many Alertmanagers does Prometheus send alerts?",
        "max by (instance) (prometheus_notifications_alertmanagers_discovered)",
    )
    return panels.on_colour(panel, (0, palette.CRITICAL.colour), (1, palette.NOTHING))


def prometheus_series() -> stat.Panel:
    """Count the series in Prometheus' memory."""
    return panels.number(
        "Series in Prometheus",
        "How many series does Prometheus have in memory?",
        "max by (instance) (prometheus_tsdb_head_series)",
    )


def alertmanager_cluster() -> stat.Panel:
    """Count the Alertmanagers of the cluster."""
    return panels.number(
        "Alertmanager cluster",
        "How many members does the Alertmanager cluster have? 1 if it runs alone.",
        """
          max by (instance) (alertmanager_cluster_members)
        or
          max by (instance) (alertmanager_build_info)
        """,
    )


def configuration() -> stat.Panel:
    """Show whether the servers' last reload succeeded."""
    return panels.word(
        "Configuration",
        "Did the servers' last reload succeed?",
        """
          max by (job, instance) (prometheus_config_last_reload_successful)
        or
          max by (job, instance) (alertmanager_config_last_reload_successful)
        """,
        SUCCESS,
    )


def rule_time() -> timeseries.Panel:
    """Show how long each rule group takes."""
    expr = """
    max by (rule_group) (
      label_replace(
        prometheus_rule_group_last_duration_seconds, "rule_group", "$1", "rule_group", ".*;(.*)"
      )
    )
    """
    return panels.graph(
        "Rule group duration",
        "How long does each rule group take? It must stay below the evaluation interval.",
        panels.over_time(expr, "{{rule_group}}"),
        unit="s",
    )


def samples() -> timeseries.Panel:
    """Show the rate of samples that Prometheus stores."""
    stored = "prometheus_tsdb_head_samples_appended_total[$__rate_interval]"
    return panels.graph(
        "Samples stored per second",
        "How many samples does Prometheus store per second?",
        panels.over_time(f"sum by (instance) (rate({stored}))", "{{instance}}"),
    ).min(0)


def alerts() -> timeseries.Panel:
    """Show the alerts in Alertmanager by state."""
    return panels.graph(
        "Alerts in Alertmanager",
        "How many alerts are active, and how many are suppressed by a silence, an acknowledgement "
        "or a worse alert?",
        panels.over_time(
            "sum by (instance, state) (alertmanager_alerts)", "{{instance}}: {{state}}"
        ),
    )


def notification_time() -> timeseries.Panel:
    """Show how long sending a notification takes."""
    expr = """
    histogram_quantile(
      0.95,
      sum by (le, integration) (
        rate(alertmanager_notification_latency_seconds_bucket[$__rate_interval])
      )
    ) > 0
    """
    return panels.graph(
        "Notification latency",
        "How long does sending a notification take (95th percentile)?",
        panels.over_time(expr, "{{integration}}"),
        unit="s",
    ).no_value("No data of a sent notification")


# --- Canary ---


def canaries_in_time() -> stat.Panel:
    """Show the share of test notifications that came within the target."""
    within = (
        f'ros_diagnostics_canary_notification_seconds_bucket{{le="{_TARGET}.0", {_FLEET}}}[30d]'
    )
    total = f"ros_diagnostics_canary_notification_seconds_count{{{_FLEET}}}[30d]"
    panel = panels.number(
        f"Notified within {_TARGET} s, 30 days",
        f"Which share of the test notifications of the last 30 days came within {_TARGET} s? Red: "
        "below 99 %.",
        f"""
          sum by (fleet) (increase({within}))
        /
          sum by (fleet) (increase({total}))
        """,
        unit="percentunit",
    )
    none = palette.special(dashboard.SpecialValueMatch.NA_N, "none yet")
    panel = panels.on_colour(panel, (0, palette.CRITICAL.colour), (0.99, palette.NOTHING))
    return panel.mappings([none]).decimals(2).height(8).span(6)


def canary_under_way() -> stat.Panel:
    """Show for how long a test notification has been waited for."""
    start = f"ros_diagnostics_canary_start_timestamp_seconds{{{_FLEET}}}"
    panel = panels.number(
        "Canary in flight",
        "How long ago was the present test notification sent? Red: longer than a minute. Needs "
        "`canary` in fleet.yml.",
        f"""
          max by (fleet) (time() - {start})
        or
          max by (fleet) (ros_diagnostics_canary_notification_seconds_count{{{_FLEET}}}) * 0
        """,
        unit=tables.DURATION,
    )
    panel = panels.on_colour(panel, (60, palette.CRITICAL.colour))
    return panel.height(8).span(6)


def canary_time() -> timeseries.Panel:
    """Show how long test notifications take."""
    buckets = f"ros_diagnostics_canary_notification_seconds_bucket{{{_FLEET}}}[1h]"
    by_bucket = f"sum by (fleet, le) (increase({buckets}))"
    return panels.graph(
        "Time to a notification",
        "How long does a test notification take through Prometheus and Alertmanager (median "
        "and 95th percentile of an hour)?",
        panels.over_time(f"histogram_quantile(0.5, {by_bucket})", "{{fleet}}: median"),
        panels.over_time(f"histogram_quantile(0.95, {by_bucket})", "{{fleet}}: 95 %", "B"),
        unit="s",
    )


def server_cpu() -> timeseries.Panel:
    """Show the CPU time of the servers."""
    expr = f"""
    sum by (job, instance) (
      rate(process_cpu_seconds_total{{{_SERVERS}}}[$__rate_interval])
    )
    """
    return panels.graph(
        "CPU of the servers",
        "How busy are Prometheus and Alertmanager? 100 % is one core.",
        panels.over_time(expr, "{{job}} {{instance}}"),
        unit="percentunit",
    )


def server_memory() -> timeseries.Panel:
    """Show the memory of the servers."""
    expr = f"max by (job, instance) (process_resident_memory_bytes{{{_SERVERS}}})"
    return panels.graph(
        "Memory of the servers",
        "How much memory do Prometheus and Alertmanager use?",
        panels.over_time(expr, "{{job}} {{instance}}"),
        unit="bytes",
    ).min(0)
