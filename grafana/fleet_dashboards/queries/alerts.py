"""Expressions of the dashboard of alerts and reports."""

from __future__ import annotations

from fleet_dashboards.queries.rows import acknowledged_faults, robot_row

_FLEET = 'fleet=~"$fleet"'
# The Watchdog fires always, to prove that alerts arrive: it says nothing of robots.
_ALERTS = f'{_FLEET}, alertname!="RosDiagnosticsWatchdog"'
_ROW = "by (alertname, severity, fleet, robot, component)"


def firing(severity: str) -> str:
    """How many alerts of a severity fire; 0 where none does."""
    series = f'ALERTS{{alertstate="firing", severity="{severity}", {_ALERTS}}}'
    return f"count({series})\nor vector(0)"


SUPPRESSED = 'max(sum by (instance) (alertmanager_alerts{state="suppressed"}))'
SILENCES = 'max(sum by (instance) (alertmanager_silences{state="active"}))'

ACKNOWLEDGED = f"({acknowledged_faults(_FLEET)}) * 1000"
ACKNOWLEDGED_COUNT = f"count({acknowledged_faults(_FLEET)})\nor vector(0)"
ACKNOWLEDGED_FAULT = f"""
max by (fleet, robot, group, component) (
    component:ros_diagnostics_fault:confirmed{{{_FLEET}}}
  or
    {robot_row(f"robot:ros_diagnostics_fault:confirmed{{{_FLEET}}}")}
) * 1000
"""

FIRING = f'group {_ROW} (ALERTS{{alertstate="firing", {_ALERTS}}})'
# The address under which the site serves its runbooks, beside every alert.
FIRING_WITH_RUNBOOK = f"""
  {FIRING}
* on () group_left (runbooks_url)
  ros_diagnostics:site:info
"""
_BEGAN = f"""
min {_ROW} (
    ALERTS_FOR_STATE{{{_ALERTS}}}
  and ignoring (alertstate)
    ALERTS{{alertstate="firing", {_ALERTS}}}
)
"""
FIRING_SINCE = f"{_BEGAN} * 1000"
FIRING_FOR = f"time() - {_BEGAN}"

# --- History ---
FIRING_BY_NAME = f'count by (alertname) (ALERTS{{alertstate="firing", {_ALERTS}}})'
_FIRED = f'ALERTS{{alertstate="firing", {_ALERTS}}}'
# ALERTS_FOR_STATE is when it began: every other value is another time.
TIMES_FIRED = f"""
sum {_ROW} (
    1 + changes(ALERTS_FOR_STATE{{{_ALERTS}}}[$__range])
  and
    max without (alertstate) (max_over_time({_FIRED}[$__range]))
)
"""
LAST_FIRED = f"""
max {_ROW} (max_over_time(timestamp({_FIRED})[$__range:1m])) * 1000
"""

# --- Notifications; summed over a cluster's members, of which one sends each ---
SENT = """
sum by (integration) (increase(alertmanager_notifications_total[$__rate_interval])) > 0
"""
FAILED = """
sum by (integration) (increase(alertmanager_notifications_failed_total[$__rate_interval])) > 0
"""
SENT_IN_RANGE = """
sum by (integration) (increase(alertmanager_notifications_total[$__range])) > 0
"""
# Alertmanager counts for every way that it knows; only those in use are worth a zero.
FAILED_IN_RANGE = f"""
  sum by (integration) (increase(alertmanager_notifications_failed_total[$__range]))
and
  {SENT_IN_RANGE.strip()}
"""

# --- Flapping ---
_COMPONENT = "by (fleet, robot, group, component)"
FLAPPING = f"max {_COMPONENT} (ros_diagnostics_component_flap_ratio{{{_FLEET}}}) > 0.1"
FLAPPING_SINCE = f"component:ros_diagnostics_flapping:start{{{_FLEET}}} * 1000"
# Not over the range: that would be a rate over every component of the fleet.
CHANGES = f"max {_COMPONENT} (ros_diagnostics_component_changes_total{{{_FLEET}}})"


# --- Availability. The parts of any range sum to 100 %: what is neither available nor not (planned
# maintenance, not yet heard, nobody looked) is a part of its own. ---


def _shares(record: str, by: str) -> str:
    """Share of every part, and as part "available" that of ok and warning in what was judged."""
    seconds = f"{record}:ros_diagnostics_part_seconds:sum5m"

    def total(matchers: str, labels: str) -> str:
        series = f"{seconds}{{{_FLEET}{matchers}}}"
        return f"sum by ({labels}) (sum_over_time({series}[$__range]))"

    well = ', part=~"ok|warning"'
    judged = ', part!~"maintenance|undetermined|pending"'
    return f"""
  {total("", f"{by}, part")}
/ on ({by}) group_left ()
  {total("", by)}
or
  label_replace(
      {total(well, by)}
    / on ({by})
      {total(judged, by)},
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
BY_ROBOT = f"""
{_shares("robot", "fleet, robot")}
or
  label_replace({_FAULTS}, "part", "faults", "", "")
or
  label_replace({_LONGEST}, "part", "longest", "", "")
"""
BY_GROUP = _shares("robot_group", "fleet, robot_group")
BY_FLEET = _shares("fleet", "fleet")
OVER_TIME = f"""
  sum by (part) (fleet:ros_diagnostics_part_seconds:sum5m{{{_FLEET}}})
/ on () group_left ()
  sum (fleet:ros_diagnostics_part_seconds:sum5m{{{_FLEET}}})
"""
