"""Expressions of the fleet dashboard."""

from __future__ import annotations

from fleet_dashboards.queries.rows import acknowledged, check_row, robot_row, who_and_why

_LABELS = 'fleet=~"$fleet", site=~"$site", robot_group=~"$robot_group"'
# The robots that the filters leave: joined to what is asked of them.
CHOSEN = f"robot:ros_diagnostics:info{{{_LABELS}}}"
_RANK = 'robot:ros_diagnostics_state:rank{fleet=~"$fleet"}'
_COMPONENT = 'component:ros_diagnostics_state:rank{fleet=~"$fleet"}'
_ROBOTS = "site_robot_group:ros_diagnostics_robots:count"
_TROUBLE = 'component:ros_diagnostics_trouble:rank{fleet=~"$fleet"}'


def _of_chosen(expr: str) -> str:
    return f"{expr}\nand on (fleet, robot)\n  {CHOSEN}"


def robots_in(states: str) -> str:
    """How many robots are in a state (or several, parted by |); 0 where none is."""
    return f'sum({_ROBOTS}{{{_LABELS}, state=~"{states}"}})\nor vector(0)'


SHARE_WELL = f"""
  sum({_ROBOTS}{{{_LABELS}, state=~"ok|warning"}})
/
  sum({_ROBOTS}{{{_LABELS}, state!="pending"}})
"""
COMPONENTS_BY_RANK = f'count_values("rank", {_COMPONENT})'
ROBOTS_BY_STATE = f"sum by (state) ({_ROBOTS}{{{_LABELS}}})"

# The worst at the end of the range, so that the rows stay the same over all of it. Their past is
# the thinned one: it is read of all robots, for each point.
WORST_ROBOTS = f"""
  robot:ros_diagnostics_state:max1m{{fleet=~"$fleet"}}
and on (fleet, robot)
  topk(50,
      ({_RANK} @ end() ${{state:raw}})
    and on (fleet, robot)
      {CHOSEN} @ end()
  )
"""

# --- Problems: a row is a component, a check that finds too little, or a whole robot that is silent
# or was never seen. Rows of one problem have the same four labels in all queries. ---


_IN_TROUBLE = f"""
    (
        {_TROUBLE} > 0
      unless on (fleet, robot, group, component)
        (
            {_TROUBLE} == 2
          and on (fleet, robot, group, component)
            ros_diagnostics_component_planned_stale == 1
        )
    )
"""
# Silent or PENDING, each with a clock of its own.
_UNHEARD = (
    'robot:ros_diagnostics_silent:start{fleet=~"$fleet"}'
    ' or robot:ros_diagnostics_pending:start{fleet=~"$fleet"}'
)
_SHORT = 'check:ros_diagnostics_short:start{fleet=~"$fleet"}'
# What is acknowledged or planned is left out where the variable says "== 1", and is not ("== 0").
PROBLEMS = _of_chosen(f"""
  (
{_IN_TROUBLE}
    unless on (fleet, robot)
      {_RANK} == 4
  or
    {robot_row(f"({_RANK} > 3 or {_RANK} < 0)")}
  or
    {check_row(f"{_SHORT} * 0 + 3")}
  ) ${{state:raw}}
  unless on (fleet, robot, group, component)
    (
      group by (fleet, robot, group, component) ({acknowledged('fleet=~"$fleet"')})
      ${{problems:raw}}
    )
  unless on (fleet, robot)
    (group by (fleet, robot) (robot:ros_diagnostics_maintenance:start) ${{problems:raw}})
""")
PROBLEM_SINCE = f"""
  component:ros_diagnostics_problem:start{{fleet=~"$fleet"}} * 1000
or
  {robot_row(_UNHEARD)} * 1000
or
  {check_row(_SHORT)} * 1000
"""
PROBLEM_FOR = f"""
  time() - component:ros_diagnostics_problem:start{{fleet=~"$fleet"}}
or
  time() - {robot_row(_UNHEARD)}
or
  time() - {check_row(_SHORT)}
"""
CONFIRMED = f"""
group by (fleet, robot, group, component) (
    component:ros_diagnostics_fault:confirmed{{fleet=~"$fleet"}}
  or
    ({_TROUBLE} > 0 and on (fleet, robot) robot:ros_diagnostics_many:confirmed)
  or
    ({_TROUBLE} > 0 and on (fleet, component) fleet_component:ros_diagnostics_common:confirmed)
  or
    {robot_row('robot:ros_diagnostics_silent:confirmed{fleet=~"$fleet"}')}
  or
    {check_row('check:ros_diagnostics_short:confirmed{fleet=~"$fleet"}')}
)
"""
MESSAGES = f"""
group by (fleet, robot, group, component, message) (
    ros_diagnostics_component_message_info{{fleet=~"$fleet"}}
  or
    label_replace(
      {robot_row('robot:ros_diagnostics_unreachable:info{fleet=~"$fleet"}')},
      "message", "unreachable: its uplink does not answer", "", ""
    )
  or on (fleet, robot, group, component)
    label_replace(
      {robot_row('ros_diagnostics_robot_silent_reason{fleet=~"$fleet"} == 1')},
      "message", "$1", "reason", "(.*)"
    )
  or on (fleet, robot, group, component)
    label_replace(
      {check_row(_SHORT)},
      "message", "finds fewer components than fleet.yml expects", "", ""
    )
)
"""
PROBLEMS_IN_MAINTENANCE = f"""
group by (fleet, robot, group, component) (
  (
      component:ros_diagnostics_problem:start{{fleet=~"$fleet"}}
    or
      {robot_row(_UNHEARD)}
    or
      {check_row(_SHORT)}
  )
  and on (fleet, robot)
    robot:ros_diagnostics_maintenance:start
)
"""
ACKNOWLEDGED = who_and_why('fleet=~"$fleet"')

# --- Robots, a row each ---
ROBOTS = f"""
  ({_RANK} ${{state:raw}})
* on (fleet, robot) group_left (site, robot_group, kind)
  {CHOSEN}
"""
ROBOT_SINCE = 'robot:ros_diagnostics_state:since{fleet=~"$fleet"} * 1000'
# Received while it was scraped, a message may seem to come from the future.
MESSAGE_AGE = """
clamp_min(
    time()
  -
    max by (fleet, robot) (
      ros_diagnostics_robot_last_message_timestamp_seconds{fleet=~"$fleet"} > 0
    ),
  0
)
"""
TROUBLED_COMPONENTS = f"count by (fleet, robot) (\n{_IN_TROUBLE}\n)"
MAINTENANCE = 'max by (fleet, robot) (ros_diagnostics_robot_maintenance{fleet=~"$fleet"})'
