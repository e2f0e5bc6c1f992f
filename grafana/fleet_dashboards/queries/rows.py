"""What is common to the tables of problems: a row for a robot, a check, an acknowledged fault."""

from __future__ import annotations


def robot_row(expr: str) -> str:
    """A row for a whole robot, beside those of components."""
    row = f'label_replace({expr}, "component", "(robot)", "", "")'
    return f'label_replace({row}, "group", "-", "", "")'


def component_rank(selector: str) -> str:
    """The rank of each chosen component as of now; recorded is that of all, a bit later."""
    return (
        "max by (fleet, robot, group, component) ("
        f"component:ros_diagnostics_trouble:rank{{{selector}}}"
        f" or ros_diagnostics_component_level{{{selector}}} * 0)"
    )


def check_row(expr: str) -> str:
    """A row for a check of fleet.yml."""
    row = f'label_replace({expr}, "component", "(check $1)", "check", "(.*)")'
    row = f'label_replace({row}, "group", "-", "", "")'
    return f"max by (fleet, robot, group, component) ({row})"


def acknowledged_faults(matchers: str) -> str:
    """The faults that somebody takes care of; who and with which words, and since when."""
    silent = robot_row(f'robot:ros_diagnostics_fault:acknowledged{{{matchers}, state=""}}')
    many = robot_row(f'robot:ros_diagnostics_fault:acknowledged{{{matchers}, state!=""}}')
    return f"""
    component:ros_diagnostics_fault:acknowledged{{{matchers}}}
  or
    label_replace({silent}, "state", "silent", "", "")
  or
    {many}
"""


def acknowledged(matchers: str) -> str:
    """The rows of problems that these are: all components of a robot acknowledged as one, too."""
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


def who_and_why(matchers: str) -> str:
    """The same as one label, ``acknowledged``: "ann: spare part ordered"."""
    return f"""
group by (fleet, robot, group, component, acknowledged) (
  label_join(
    (
{acknowledged(matchers)}
    ),
    "acknowledged", ": ", "author", "comment"
  )
)
"""
