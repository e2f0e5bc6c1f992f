"""Expressions of the fleet dashboard."""

from __future__ import annotations

# The robots that the filters leave: joined to what is asked of them.
CHOSEN = 'robot:ros_diagnostics:info{fleet=~"$fleet", site=~"$site", robot_group=~"$robot_group"}'
_RANK = 'robot:ros_diagnostics_state:rank{fleet=~"$fleet"}'
_COMPONENT = 'component:ros_diagnostics_state:rank{fleet=~"$fleet"}'


def _of_chosen(expr: str) -> str:
    return f"{expr}\nand on (fleet, robot)\n  {CHOSEN}"


def robots_in(rank: int) -> str:
    """How many robots stand at a rank; 0 where none does."""
    return f"count(\n{_of_chosen(f'{_RANK} == {rank}')}\n)\nor vector(0)"


SHARE_WELL = f"""
  count(
{_of_chosen(f"({_RANK} >= 0) < 2")}
  )
/
  count(
{_of_chosen(f"{_RANK} >= 0")}
  )
"""
COMPONENTS_BY_RANK = f'count_values("rank", {_COMPONENT})'
ROBOTS_BY_RANK = f'count_values("rank",\n{_of_chosen(_RANK)}\n)'

# The worst at the end of the range, so that the rows stay the same over all of it.
WORST_ROBOTS = f"""
  {_RANK}
and on (fleet, robot)
  topk(50,
      ({_RANK} @ end() ${{state:raw}})
    and on (fleet, robot)
      {CHOSEN} @ end()
  )
"""

# --- Problems: a row is a component, a check that finds too little, or a whole robot that is silent
# or was never seen. Rows of one problem have the same four labels in all queries. ---


def _robot_row(expr: str) -> str:
    row = f'label_replace({expr}, "component", "(robot)", "", "")'
    return f'label_replace({row}, "group", "-", "", "")'


def _check_row(expr: str) -> str:
    row = f'label_replace({expr}, "component", "(check $1)", "check", "(.*)")'
    row = f'label_replace({row}, "group", "-", "", "")'
    return f"max by (fleet, robot, group, component) ({row})"


_IN_TROUBLE = f"""
    (
        {_COMPONENT} > 0
      unless on (fleet, robot, group, component)
        (
            {_COMPONENT} == 2
          and on (fleet, robot, group, component)
            ros_diagnostics_component_planned_stale == 1
        )
      unless on (fleet, robot)
        {_RANK} == 4
    )
"""
_TOO_FEW = """
    (
        sum by (fleet, robot, check) (ros_diagnostics_check_components{fleet=~"$fleet"})
      < on (fleet, robot, check)
        max by (fleet, robot, check) (ros_diagnostics_check_expected_components)
    )
"""
PROBLEMS = _of_chosen(f"""
  (
{_IN_TROUBLE}
  or
    {_robot_row(f"({_RANK} > 3 or {_RANK} < 0)")}
  or
    {_check_row(f"{_TOO_FEW} * 0 + 3")}
  ) ${{state:raw}}
""")
PROBLEM_SINCE = f"""
  component:ros_diagnostics_problem:start{{fleet=~"$fleet"}} * 1000
or
  {_robot_row('robot:ros_diagnostics_silent:start{fleet=~"$fleet"}')} * 1000
"""
PROBLEM_FOR = f"""
  time() - component:ros_diagnostics_problem:start{{fleet=~"$fleet"}}
or
  time() - {_robot_row('robot:ros_diagnostics_silent:start{fleet=~"$fleet"}')}
"""
CONFIRMED = f"""
group by (fleet, robot, group, component) (
    component:ros_diagnostics_fault:confirmed{{fleet=~"$fleet"}}
  or
    {_robot_row('robot:ros_diagnostics_silent:confirmed{fleet=~"$fleet"}')}
)
"""
MESSAGES = f"""
group by (fleet, robot, group, component, message) (
    ros_diagnostics_component_message_info{{fleet=~"$fleet"}}
  or
    label_replace(
      {_robot_row('ros_diagnostics_robot_silent_reason{fleet=~"$fleet"} == 1')},
      "message", "$1", "reason", "(.*)"
    )
)
"""
PROBLEMS_IN_MAINTENANCE = """
group by (fleet, robot, group, component) (
    component:ros_diagnostics_state:rank{fleet=~"$fleet"} != 0
  and on (fleet, robot)
    ros_diagnostics_robot_maintenance == 1
)
"""

# --- Robots, a row each ---
ROBOTS = f"""
  ({_RANK} ${{state:raw}})
* on (fleet, robot) group_left (site, robot_group, kind)
  {CHOSEN}
"""
MESSAGE_AGE = """
  time()
-
  max by (fleet, robot) (
    ros_diagnostics_robot_last_message_timestamp_seconds{fleet=~"$fleet"} > 0
  )
"""
TROUBLED_COMPONENTS = f"count by (fleet, robot) ({_COMPONENT} > 0)"
MAINTENANCE = 'max by (fleet, robot) (ros_diagnostics_robot_maintenance{fleet=~"$fleet"})'
