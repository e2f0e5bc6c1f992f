"""Expressions of the robot dashboard."""

from __future__ import annotations

from fleet_dashboards.queries.rows import component_rank, who_and_why

_ROBOT = 'fleet=~"$fleet", robot="$robot"'
_CHOSEN = f'{_ROBOT}, component=~"$component"'
_ROW = "by (fleet, robot, group, component)"
_RANK = component_rank(_CHOSEN)

STATE = f"robot:ros_diagnostics_state:rank{{{_ROBOT}}}"
SILENT_FOR = f"""
time() - (
  robot:ros_diagnostics_silent:start{{{_ROBOT}}}
or
  robot:ros_diagnostics_pending:start{{{_ROBOT}}}
)
"""
SILENCE_REASON = f"""
max by (reason) (ros_diagnostics_robot_silent_reason{{{_ROBOT}}} == 1)
"""
# Received while it was scraped, a message may seem to come from the future.
MESSAGE_AGE = f"""
clamp_min(
    time()
  -
    max by (fleet, robot) (ros_diagnostics_robot_last_message_timestamp_seconds{{{_ROBOT}}} > 0),
  0
)
"""
STALE_AFTER = f"max by (fleet, robot) (ros_diagnostics_robot_stale_after_seconds{{{_ROBOT}}})"
CLOCK_OFFSET = f"max by (fleet, robot) (ros_diagnostics_robot_clock_offset_seconds{{{_ROBOT}}})"
MAINTENANCE = f"max by (fleet, robot) (ros_diagnostics_robot_maintenance{{{_ROBOT}}})"

# --- Components ---
ERRORS = f"{_RANK} == 3"
WARNINGS = f"{_RANK} == 1"
NOT_HEARD = f"""
  {_RANK} == 2
or
  {_RANK} == 4
"""
TREE = _RANK
PROBLEM_FOR = f"time() - component:ros_diagnostics_problem:start{{{_CHOSEN}}}"
MESSAGES = f"""
group by (fleet, robot, group, component, message) (
  ros_diagnostics_component_message_info{{{_CHOSEN}}}
)
"""
LEVEL_BEFORE = f"""
max {_ROW} (ros_diagnostics_component_level_before_stale{{{_CHOSEN}}}) ^ 3 % 5
"""
HARDWARE = f"""
group by (fleet, robot, group, component, hardware_id) (
  ros_diagnostics_component_info{{{_CHOSEN}}}
)
"""
LEVEL_SINCE = f"""
max {_ROW} (ros_diagnostics_component_since_timestamp_seconds{{{_CHOSEN}}}) * 1000
"""
CHANGES = f"""
sum {_ROW} (increase(ros_diagnostics_component_changes_total{{{_CHOSEN}}}[$__range]))
"""
ACKNOWLEDGED = who_and_why(_ROBOT)
GROUPS = f"max by (group) (ros_diagnostics_group_level{{{_ROBOT}}}) ^ 3 % 5"
CHECKS = f"check:ros_diagnostics_state:rank{{{_ROBOT}}}"
CHECK_FOUND = f"""
sum by (fleet, robot, check) (ros_diagnostics_check_components{{{_ROBOT}}})
"""
CHECK_EXPECTED = f"""
max by (fleet, robot, check) (ros_diagnostics_check_expected_components{{{_ROBOT}}})
"""

# --- Key-values and their thresholds from fleet.yml ---
_CHARGE = 'component=~"(?i).*batter.*", key=~"(?i).*(level|charge|percent|soc).*", unit=~"%|"'
_TEMPERATURE = 'unit=~"degC|degF|K"'
_OTHER = 'unit="$unit"'
_BARE = 'unit=""'


def _values(which: str) -> str:
    family = f"ros_diagnostics_component_value{{{_CHOSEN}, {which}}}"
    return f"max by (component, key, unit) ({family})"


def _thresholds(which: str) -> str:
    family = f"ros_diagnostics_component_value_threshold{{{_CHOSEN}, {which}}}"
    return f"max by (component, key, unit, bound, severity) ({family})"


BATTERY = _values(_CHARGE)
BATTERY_THRESHOLDS = _thresholds(_CHARGE)
TEMPERATURE = _values(_TEMPERATURE)
TEMPERATURE_THRESHOLDS = _thresholds(_TEMPERATURE)
OTHER_VALUES = _values(_OTHER)
OTHER_THRESHOLDS = _thresholds(_OTHER)
BARE_VALUES = f"{_values(_BARE)} unless {BATTERY}"
BARE_THRESHOLDS = f"{_thresholds(_BARE)} unless {BATTERY_THRESHOLDS}"

# --- The connection ---
MESSAGE_RATE = f"""
sum by (fleet, robot) (rate(ros_diagnostics_robot_messages_total{{{_ROBOT}}}[$__rate_interval]))
"""
BYTE_RATE = f"""
sum by (fleet, robot) (
  rate(ros_diagnostics_robot_message_bytes_total{{{_ROBOT}}}[$__rate_interval])
)
"""
REJECTED = f"""
sum by (reason) (increase(ros_diagnostics_robot_rejected_total{{{_ROBOT}}}[$__range])) > 0
"""
PUBLISHERS = f"max by (fleet, robot) (ros_diagnostics_robot_publishers{{{_ROBOT}}})"
INVENTORY = f"ros_diagnostics_robot_info{{{_ROBOT}}}"

# --- Annotations: 1 while it lasts. They are asked at least once a minute. ---
STATE_CHANGES = f"""
clamp_max(changes(robot:ros_diagnostics_state:rank{{{_ROBOT}}}[1m]), 1) == 1
"""
TOLD = f'ALERTS{{alertstate="firing", {_ROBOT}}}'
