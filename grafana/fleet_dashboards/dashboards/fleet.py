"""The fleet: robots by state, problems, all robots."""

from __future__ import annotations

from urllib.parse import quote

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat, statetimeline, table, timeseries
from grafana_foundation_sdk.models import common

from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.dashboard import new_dashboard
from fleet_dashboards.lib.palette import State
from fleet_dashboards.lib.promql import (
    acknowledged_rows,
    author_and_comment,
    check_row,
    robot_row,
)
from fleet_dashboards.lib.tables import Column

# The robots that the filters select; other expressions are joined to these.
_MATCHERS = 'fleet=~"$fleet", site=~"$site", robot_group=~"$robot_group"'
_SELECTED = f"robot:ros_diagnostics:info{{{_MATCHERS}}}"
_COUNT = "site_robot_group:ros_diagnostics_robots:count"
_RANK = 'robot:ros_diagnostics_state:rank{fleet=~"$fleet"}'

MAINTENANCE = palette.yes("planned", palette.MAINTENANCE_COLOUR)
CONFIRMED = palette.yes("confirmed", palette.NEUTRAL, otherwise="not yet")


def build() -> builders.Dashboard:
    """Return the home dashboard."""
    return new_dashboard(
        links.FLEET_UID,
        "Robot fleet",
        "Which robot is faulty, in which part, since when?",
        [
            variables.fleet(),
            variables.site(),
            variables.robot_group(),
            variables.state(),
            variables.problems(),
        ],
        [
            *map(robots_in, palette.WORST_FIRST),
            problems(),
            share_working(),
            components_by_state(),
            health(),
            states_of_robots(),
            robots(),
        ],
    )


# The label "state" of the recorded counts; robots behind a dead uplink are silent, too.
STATE_LABELS = {state.word: state.word.lower() for state in palette.STATES}
STATE_LABELS["UNKNOWN"] = "unknown|unreachable"
QUESTIONS = {
    "CRITICAL": "How many robots have an error, or fewer components than expected?",
    "UNKNOWN": "How many robots are silent, so that their state is not known?",
    "STALE": "How many robots have a component that stopped reporting?",
    "WARNING": "How many robots work, but need attention?",
    "OK": "How many robots are OK?",
    "PENDING": "How many robots are declared in fleet.yml, but were never received?",
}


def robots_in(state: State) -> stat.Panel:
    """Count the robots in one state; a click filters by it."""
    link = builders.DashboardLink(f"Only {state.word}").url(
        links.to_fleet(quote(f"== {state.rank}"))
    )
    return (
        panels.number(
            state.word,
            f"{QUESTIONS[state.word]} A click filters by this state.",
            f'sum({_COUNT}{{{_MATCHERS}, state=~"{STATE_LABELS[state.word]}"}})\nor vector(0)',
        )
        .color_mode(common.BigValueColorMode.BACKGROUND)
        .color_scheme(panels.by_thresholds())
        .thresholds(panels.steps((None, "transparent"), (1, state.colour)))
        .data_links([link])
    )


# --- Problems: a row is a component, a check that finds too few components, or a robot that is
# silent or pending. The rows of one problem have the same four labels in all queries. ---

_TROUBLE = 'component:ros_diagnostics_trouble:rank{fleet=~"$fleet"}'
_SHORT_CHECK = 'check:ros_diagnostics_short:start{fleet=~"$fleet"}'
_ABSENT = (
    'robot:ros_diagnostics_silent:start{fleet=~"$fleet"}'
    ' or robot:ros_diagnostics_pending:start{fleet=~"$fleet"}'
)
# Components that are not OK, without those whose being stale is planned.
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
# ${problems} is "== 1" to leave out what is acknowledged or planned: the timestamps before it are
# grouped to 1. It is "== 0" to leave out nothing.
_PROBLEMS = f"""
  (
{_IN_TROUBLE}
    unless on (fleet, robot)
      {_RANK} == 4
  or
    {robot_row(f"({_RANK} > 3 or {_RANK} < 0)")}
  or
    {check_row(f"{_SHORT_CHECK} * 0 + 3")}
  ) ${{state:raw}}
  unless on (fleet, robot, group, component)
    (
      group by (fleet, robot, group, component) ({acknowledged_rows('fleet=~"$fleet"')})
      ${{problems:raw}}
    )
  unless on (fleet, robot)
    (group by (fleet, robot) (robot:ros_diagnostics_maintenance:start) ${{problems:raw}})
and on (fleet, robot)
  {_SELECTED}
"""
_SINCE = f"""
  component:ros_diagnostics_problem:start{{fleet=~"$fleet"}} * 1000
or
  {robot_row(_ABSENT)} * 1000
or
  {check_row(_SHORT_CHECK)} * 1000
"""
_DURATION = f"""
  time() - component:ros_diagnostics_problem:start{{fleet=~"$fleet"}}
or
  time() - {robot_row(_ABSENT)}
or
  time() - {check_row(_SHORT_CHECK)}
"""
_CONFIRMED = f"""
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
_MESSAGES = f"""
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
      {check_row(_SHORT_CHECK)},
      "message", "finds fewer components than fleet.yml expects", "", ""
    )
)
"""
_IN_MAINTENANCE = f"""
group by (fleet, robot, group, component) (
  (
      component:ros_diagnostics_problem:start{{fleet=~"$fleet"}}
    or
      {robot_row(_ABSENT)}
    or
      {check_row(_SHORT_CHECK)}
  )
  and on (fleet, robot)
    robot:ros_diagnostics_maintenance:start
)
"""


def problems() -> table.Panel:
    """List what is wrong, worst first."""
    return tables.joined(
        "Problems",
        "What is wrong now, where, since when, and what is the driver's message? Worst first. A "
        "silent robot is one row. Confirmed problems have lasted for the robot's confirm_after, "
        "and an alert fires. Acknowledged shows who takes care of this fault, and the comment. "
        "Planned is maintenance from fleet.yml. Unhandled, at the top, leaves out what is "
        "acknowledged or planned.",
        "No problems",
        {
            "A": _PROBLEMS,
            "B": _SINCE,
            "C": _DURATION,
            "D": _CONFIRMED,
            "E": _MESSAGES,
            "F": _IN_MAINTENANCE,
            "G": author_and_comment('fleet=~"$fleet"'),
        },
        [
            tables.STATE,
            tables.FLEET,
            Column("robot", "Robot", link=links.TO_ROBOT, width=140),
            Column("component", "Component", link=links.TO_COMPONENT),
            Column("B", "Since", unit="dateTimeAsIsoNoDateIfToday", width=160),
            Column("C", "For", unit="dtdurations", width=160),
            Column("D", "Confirmed", mappings=CONFIRMED, width=110),
            Column("message", "Message"),
            Column("acknowledged", "Acknowledged"),
            Column("F", "Maintenance", mappings=MAINTENANCE, width=120),
        ],
    ).height(12)


# --- The fleet as a whole ---


def share_working() -> stat.Panel:
    """Show the share of robots that work."""
    return panels.number(
        "Working robots",
        "Which share of the robots, without PENDING ones, is OK or in WARNING?",
        f"""
          sum({_COUNT}{{{_MATCHERS}, state=~"ok|warning"}})
        /
          sum({_COUNT}{{{_MATCHERS}, state!="pending"}})
        """,
        "percentunit",
    ).height(8)


def components_by_state() -> stat.Panel:
    """Count the components in each state."""
    return panels.count_by_state(
        "Components",
        "How many components are in each state? In the chosen fleets; site and group do not apply.",
        'count_values("rank", component:ros_diagnostics_state:rank{fleet=~"$fleet"})',
    ).height(8)


def health() -> timeseries.Panel:
    """Show the robots by state over time."""
    panel = panels.graph(
        "Health of the fleet",
        "Is it getting better or worse? Robots by state over time.",
        panels.over_time(f"sum by (state) ({_COUNT}{{{_MATCHERS}}})", "{{state}}"),
    )
    for state in palette.STATES:
        look = panels.series(state.word, state.colour)
        panel = panel.override_by_name(state.word.lower(), look)
    look = panels.series("UNREACHABLE", palette.UNREACHABLE_COLOUR)
    return panels.stacked(panel.override_by_name("unreachable", look)).min(0).decimals(0)


# --- Robots ---


def states_of_robots() -> statetimeline.Panel:
    """Show the states of the worst robots over time."""
    link = builders.DashboardLink("Open this robot").url(links.TO_ROBOT_OF_SERIES)
    # The worst are chosen at the end of the range, so that the rows stay the same over all of it.
    # Every point queries all robots: hence the series of one value a minute, and few points.
    expr = f"""
      robot:ros_diagnostics_state:max1m{{fleet=~"$fleet"}}
    and on (fleet, robot)
      topk(50,
          ({_RANK} @ end() ${{state:raw}})
        and on (fleet, robot)
          {_SELECTED} @ end()
      )
    """
    panel = panels.timeline(
        "States of the robots",
        "When was which robot in which state? The worst state of each minute, half a minute late. "
        "At most 50 robots, the worst at the end of the range: filter to see others.",
        panels.over_time(expr, "{{robot}}"),
    )
    return panel.max_data_points(400).data_links([link])


# A message received during the scrape may have a timestamp after time(): hence clamp_min.
_MESSAGE_AGE = """
clamp_min(
    time()
  -
    max by (fleet, robot) (
      ros_diagnostics_robot_last_message_timestamp_seconds{fleet=~"$fleet"} > 0
    ),
  0
)
"""


def robots() -> table.Panel:
    """List all robots."""
    return tables.joined(
        "Robots",
        "What is the state of each robot, and how old is its last message?",
        "No robot matches the filters",
        {
            "A": f"""
              ({_RANK} ${{state:raw}})
            * on (fleet, robot) group_left (site, robot_group, kind)
              {_SELECTED}
            """,
            "B": _MESSAGE_AGE,
            "C": f"count by (fleet, robot) (\n{_IN_TROUBLE}\n)",
            "D": 'max by (fleet, robot) (ros_diagnostics_robot_maintenance{fleet=~"$fleet"})',
            "E": 'robot:ros_diagnostics_state:since{fleet=~"$fleet"} * 1000',
        },
        [
            tables.STATE,
            tables.FLEET,
            tables.ROBOT,
            Column("site", "Site"),
            Column("robot_group", "Group"),
            Column("kind", "Kind"),
            Column("E", "Since", unit="dateTimeAsIsoNoDateIfToday", width=160),
            Column("C", "Components not OK", width=170),
            Column("B", "Last message", unit="dtdurations", width=160),
            Column("D", "Maintenance", mappings=MAINTENANCE, width=120),
        ],
        by="fleet, robot",
    ).height(14)
