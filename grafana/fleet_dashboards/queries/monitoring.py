"""Expressions of the monitoring dashboard: hosts, exporters, Prometheus, Alertmanager."""

from __future__ import annotations

_FLEET = 'fleet=~"$fleet"'
_EXPORTER = f'job="ros-diagnostics", {_FLEET}'
_TARGET = "by (job, instance, fleet)"

# --- Everything that is scraped ---
UP = f"max {_TARGET} (up)"
SCRAPE_DURATION = f"max {_TARGET} (scrape_duration_seconds)"
SCRAPE_SAMPLES = f"max {_TARGET} (scrape_samples_scraped)"

# --- Pings of robots and of what they are connected through ---
_PROBED = "by (job, instance, fleet, robot, uplink)"
HOSTS = f'max {_PROBED} (probe_success{{job=~"ros-diagnostics-.*", {_FLEET}}})'
HOST_LATENCY = f'max {_PROBED} (probe_duration_seconds{{job=~"ros-diagnostics-.*", {_FLEET}}})'

# --- Exporters ---
BUILD = f"ros_diagnostics_exporter_build_info{{{_FLEET}}}"
CONFIG_OK = f"max by (fleet) (ros_diagnostics_exporter_config_last_reload_successful{{{_FLEET}}})"
CONFIG_TIME = f"""
max by (fleet) (
  ros_diagnostics_exporter_config_last_reload_success_timestamp_seconds{{{_FLEET}}}
) * 1000
"""
STORAGE_OK = f"""
max by (fleet) (ros_diagnostics_exporter_storage_last_write_successful{{{_FLEET}}})
"""
STORAGE_TIME = f"""
max by (fleet) (
  ros_diagnostics_exporter_storage_last_write_success_timestamp_seconds{{{_FLEET}}}
) * 1000
"""
ALERTMANAGER_UP = f"max by (fleet) (ros_diagnostics_exporter_alertmanager_up{{{_FLEET}}})"
DOMAINS_DOWN = f"""
group by (fleet, domain_id) (ros_diagnostics_exporter_domain_up{{{_FLEET}}} == 0)
"""
DOMAINS = f"count by (fleet) (ros_diagnostics_exporter_domain_up{{{_FLEET}}} == 1)"
ROBOTS = f"max by (fleet) (ros_diagnostics_exporter_robots{{{_FLEET}}})"
DISCOVERY_AGE = f"""
  time()
-
  min by (fleet) (ros_diagnostics_exporter_discovery_last_run_timestamp_seconds{{{_FLEET}}})
"""
SERIES = f"sum by (fleet) (ros_diagnostics_exporter_series{{{_FLEET}}})"
SERIES_LIMIT = f"max by (fleet) (ros_diagnostics_exporter_series_limit{{{_FLEET}}})"
SERIES_BY_FAMILY = f"""
max by (fleet, family) (ros_diagnostics_exporter_series{{{_FLEET}}})
"""
MESSAGES = f"""
sum by (fleet) (rate(ros_diagnostics_robot_messages_total{{{_FLEET}}}[$__rate_interval]))
"""
REJECTED = f"""
  sum by (fleet, reason) (
    rate(ros_diagnostics_robot_rejected_total{{{_FLEET}}}[$__rate_interval])
  ) > 0
or
  sum by (fleet, reason) (
    rate(ros_diagnostics_exporter_rejected_total{{{_FLEET}}}[$__rate_interval])
  ) > 0
"""
RENDER_TIME = f"max by (fleet) (ros_diagnostics_exporter_last_scrape_duration_seconds{{{_FLEET}}})"
EXPORTER_SCRAPE_TIME = f"max by (fleet) (scrape_duration_seconds{{{_EXPORTER}}})"
DECODE = f"""
sum by (fleet) (rate(ros_diagnostics_exporter_decode_seconds_total{{{_FLEET}}}[$__rate_interval]))
"""
INGEST = f"""
sum by (fleet) (rate(ros_diagnostics_exporter_ingest_seconds_total{{{_FLEET}}}[$__rate_interval]))
"""
CPU = f"sum by (fleet) (rate(process_cpu_seconds_total{{{_EXPORTER}}}[$__rate_interval]))"
MEMORY = f"max by (fleet) (process_resident_memory_bytes{{{_EXPORTER}}})"

# --- Prometheus ---
RULE_TIME = """
max by (rule_group) (
  label_replace(
    prometheus_rule_group_last_duration_seconds, "rule_group", "$1", "rule_group", ".*;(.*)"
  )
)
"""
RULE_FAILURES = """
  sum by (instance) (increase(prometheus_rule_evaluation_failures_total[$__range]))
+
  sum by (instance) (increase(prometheus_rule_group_iterations_missed_total[$__range]))
"""
NOT_NOTIFIED = """
  sum by (instance) (increase(prometheus_notifications_errors_total[$__range]))
+
  sum by (instance) (increase(prometheus_notifications_dropped_total[$__range]))
"""
ALERTMANAGERS = "max by (instance) (prometheus_notifications_alertmanagers_discovered)"
PROMETHEUS_SERIES = "max by (instance) (prometheus_tsdb_head_series)"
PROMETHEUS_SAMPLES = """
sum by (instance) (rate(prometheus_tsdb_head_samples_appended_total[$__rate_interval]))
"""
SERVER_MEMORY = """
max by (job, instance) (process_resident_memory_bytes{job=~"prometheus|alertmanager"})
"""
SERVER_CPU = """
sum by (job, instance) (
  rate(process_cpu_seconds_total{job=~"prometheus|alertmanager"}[$__rate_interval])
)
"""
RELOADED = """
  max by (job, instance) (prometheus_config_last_reload_successful)
or
  max by (job, instance) (alertmanager_config_last_reload_successful)
"""

# --- Alertmanager ---
ALERTS_KNOWN = "sum by (instance, state) (alertmanager_alerts)"
NOTIFICATION_LATENCY = """
histogram_quantile(
  0.95,
  sum by (le, integration) (
    rate(alertmanager_notification_latency_seconds_bucket[$__rate_interval])
  )
) > 0
"""
CLUSTER_MEMBERS = "max by (instance) (alertmanager_cluster_members)"
