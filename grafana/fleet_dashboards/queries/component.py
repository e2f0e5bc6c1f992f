"""Expressions of the component dashboard: one component or key on all robots."""

from __future__ import annotations

from fleet_dashboards.queries.rows import component_rank

_ALL = 'fleet=~"$fleet", component="$component"'
_COMPONENT = f'{_ALL}, robot=~"$robot"'
_ROW = "by (fleet, robot, group)"

STATE = f"max {_ROW} ({component_rank(_COMPONENT)})"
COUNT_BY_RANK = f'count_values("rank", {component_rank(_ALL)})'
PROBLEM_FOR = f"time() - max {_ROW} (component:ros_diagnostics_problem:start{{{_COMPONENT}}})"
MESSAGES = f"""
group by (fleet, robot, group, message) (
  ros_diagnostics_component_message_info{{{_COMPONENT}}}
)
"""
CHANGES = f"""
sum {_ROW} (increase(ros_diagnostics_component_changes_total{{{_COMPONENT}}}[$__range]))
"""
FLAP_RATIO = f"max {_ROW} (ros_diagnostics_component_flap_ratio{{{_COMPONENT}}})"

# --- One key on all robots: shown for the chosen ones, compared with all ---


def _value(robots: str) -> str:
    family = f'ros_diagnostics_component_value{{{robots}, key="$key"}}'
    return f"max by (fleet, robot, unit) ({family})"


VALUE = _value(_COMPONENT)
MEDIAN = f"quantile(0.5, {_value(_ALL)})"
DISTANCE = f"{VALUE} - scalar({MEDIAN})"
_DISTANCE_OF_ALL = f"abs({_value(_ALL)} - scalar({MEDIAN}))"
# Iglewicz and Hoaglin's modified z-score: distance from the median in units of the median distance,
# scaled to a standard deviation; where more than half are equal, of the mean distance. Beyond 3.5 a
# robot is the odd one out. All equal: 0.
_SPREAD = f"""
scalar(
    1.4826 * quantile(0.5, {_DISTANCE_OF_ALL}) > 0
  or
    1.2533 * avg({_DISTANCE_OF_ALL}) > 0
  or
    vector(1)
)
"""
ODDNESS = f"({DISTANCE}) / {_SPREAD}"
