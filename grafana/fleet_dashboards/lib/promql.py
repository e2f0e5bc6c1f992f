"""Expressions that several dashboards share.

`$fleet`, `$site`, `$robot_group` may be several or all, so they match as regular expressions;
`$robot` alone on its dashboard, `$component` and `$key` on theirs are one, and match exactly.
Recorded states (prometheus/rules) are preferred to computing them again: they are cheap to query.
"""

from __future__ import annotations


def robot_row(expr: str) -> str:
    """Give series about a whole robot the labels of a component's row: "(robot)" in group "-"."""
    row = f'label_replace({expr}, "component", "(robot)", "", "")'
    return f'label_replace({row}, "group", "-", "", "")'


def check_row(expr: str) -> str:
    """Give series about a check of fleet.yml the labels of a component's row: "(check name)"."""
    row = f'label_replace({expr}, "component", "(check $1)", "check", "(.*)")'
    row = f'label_replace({row}, "group", "-", "", "")'
    return f"max by (fleet, robot, group, component) ({row})"


def component_rank(matchers: str) -> str:
    """Return the rank of each component, OK ones included, at the time of the query.

    The recorded rank of all components is up to an evaluation interval older.
    """
    return (
        "max by (fleet, robot, group, component) ("
        f"component:ros_diagnostics_trouble:rank{{{matchers}}}"
        f" or ros_diagnostics_component_level{{{matchers}}} * 0)"
    )


def rank_of_level(level: str) -> str:
    """Turn a diagnostics level into a state's rank: STALE (3) is 2, ERROR (2) is 3."""
    return f"{level} ^ 3 % 5"


def acknowledged_faults(matchers: str) -> str:
    """Return when each acknowledged fault was acknowledged, with author and comment as labels."""
    silent = robot_row(f'robot:ros_diagnostics_fault:acknowledged{{{matchers}, state=""}}')
    many = robot_row(f'robot:ros_diagnostics_fault:acknowledged{{{matchers}, state!=""}}')
    return f"""
    component:ros_diagnostics_fault:acknowledged{{{matchers}}}
  or
    label_replace({silent}, "state", "silent", "", "")
  or
    {many}
"""


def acknowledged_rows(matchers: str) -> str:
    """Return the same for each row of a table of problems.

    A fault of many components of a robot is one fault: its acknowledgement counts for each of them.
    """
    silent = robot_row(f'robot:ros_diagnostics_fault:acknowledged{{{matchers}, state=""}}')
    return f"""
    component:ros_diagnostics_fault:acknowledged{{{matchers}}}
  or
    {silent}
  or on (fleet, robot, group, component)
      (
          component:ros_diagnostics_trouble:rank{{{matchers}}} > 0
        unless on (fleet, robot, group, component)
          component:ros_diagnostics_fault:confirmed{{{matchers}}}
      ) * 0
    + on (fleet, robot) group_left (author, comment)
      robot:ros_diagnostics_fault:acknowledged{{{matchers}, state!=""}}
"""


def author_and_comment(matchers: str) -> str:
    """Return the acknowledged rows with one label ``acknowledged``: "ann: spare part ordered"."""
    return f"""
group by (fleet, robot, group, component, acknowledged) (
  label_join(
    (
{acknowledged_rows(matchers)}
    ),
    "acknowledged", ": ", "author", "comment"
  )
)
"""
