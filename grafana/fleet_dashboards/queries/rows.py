"""What is common to the tables of problems: a row for a robot, a check, an acknowledged fault."""

from __future__ import annotations


def robot_row(expr: str) -> str:
    """A row for a whole robot, beside those of components."""
    row = f'label_replace({expr}, "component", "(robot)", "", "")'
    return f'label_replace({row}, "group", "-", "", "")'


def check_row(expr: str) -> str:
    """A row for a check of fleet.yml."""
    row = f'label_replace({expr}, "component", "(check $1)", "check", "(.*)")'
    row = f'label_replace({row}, "group", "-", "", "")'
    return f"max by (fleet, robot, group, component) ({row})"


def acknowledged(matchers: str) -> str:
    """The rows that somebody takes care of; who and with which words, and since when."""
    silent = robot_row(f"robot:ros_diagnostics_silent:acknowledged{{{matchers}}}")
    return f"""
    component:ros_diagnostics_fault:acknowledged{{{matchers}}}
  or
    label_replace({silent}, "state", "silent", "", "")
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
