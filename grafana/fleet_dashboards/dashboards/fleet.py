"""The fleet: robots by state, problems, all robots."""

from __future__ import annotations

from urllib.parse import quote

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat, statetimeline, table, timeseries
from grafana_foundation_sdk.models import common
from grafana_foundation_sdk.models.prometheus import PromQueryFormat

from fleet_dashboards.dashboards import capabilities, missions
from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.dashboard import closed_row, new_dashboard
from fleet_dashboards.lib.problems import ACKNOWLEDGED, IDENTITY, problem_rows, problem_table
from fleet_dashboards.lib.promql import (
    DEVICE,
    HELD,
    HELD_OF_ROBOT,
    answering,
    in_order,
    label,
    message_age,
    named,
    reached,
    settled,
    worst,
    worst_first,
)
from fleet_dashboards.lib.tables import Column

# The robots that the filters select; other expressions are joined to these.
_MATCHERS = 'fleet=~"$fleet", site=~"$site", robot_group=~"$robot_group"'
_SELECTED = f"robot:ros_diagnostics:info{{{_MATCHERS}}}"
_COUNT = "site_robot_group:ros_diagnostics_robots:count"
_RANK = 'robot:ros_diagnostics_state:rank{fleet=~"$fleet"}'
_CHOSEN = f"({_RANK} ${{state:raw}}) and on (fleet, robot) {_SELECTED}"


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
            variables.worst(worst(*_of_robots(), LINES)),
            variables.wall(_at_site(_SELECTED)),
        ],
        [
            robots_by_state(),
            problems(),
            wall(),
            states_of_robots(),
            health(),
            number_of_problems(),
            share_working(),
            components_by_state(),
            robots(),
            closed_row(
                "Capabilities",
                capabilities.of_robots(_CHOSEN, _PROOF),
                capabilities.of_fleet(_STATES, _PROOF),
            ),
        ],
    )


def robots_by_state() -> stat.Panel:
    """Count the robots in each state; a click filters by it."""
    counts = {state: _count(state) for state in palette.WORST_FIRST}
    number = panels.number(
        "Robots by state",
        "How many robots are in each state? CRITICAL: an error, or fewer components than "
        "expected. SILENT: nothing is received. UNKNOWN: its exporter does not answer. "
        "UNREACHABLE: its uplink fails. STALE: a component stopped reporting. FLAPPING: a "
        "component, or the robot, changes all the time. WARNING: it works, but needs attention. "
        "PENDING: declared in fleet.yml, never received. UNKNOWN, UNREACHABLE, FLAPPING and "
        "PENDING are shown while a robot is. A question mark: not known while an "
        "exporter does not answer. A click filters by the state.",
        counts[palette.CRITICAL],
    ).mappings(palette.UNKNOWN_NUMBER)
    panel = panels.on_colour(number).targets(
        [
            panels.at_end(expr, state.word, ref)
            for ref, (state, expr) in zip("ABCDEFGHI", counts.items(), strict=True)
        ]
    )
    for state in counts:
        link = {"title": f"Only {state.word}", "url": links.to_fleet(quote(f"== {state.rank}"))}
        look = [*panels.counted(state), panels.look("links", [link])]
        panel = panel.override_by_name(state.word, look)
    # On a phone a word may lose its end: to fit, those of eight tiles would have 4 pixels.
    panel = panel.text(panels.text_of(name=12))
    return panel.text_mode(common.BigValueTextMode.VALUE_AND_NAME).span(24).height(3)


# No tile where there is none.
_SELDOM = (palette.UNKNOWN, palette.UNREACHABLE, palette.FLAPPING, palette.PENDING)


def _count(state: palette.State) -> str:
    """Return the number of robots in a state; 0 only where all exporters answer, else NaN."""
    all_robots = f"sum({_COUNT}{{{_MATCHERS}}})"
    number = f'sum({_COUNT}{{{_MATCHERS}, state="{state.word.lower()}"}})'
    if state in _SELDOM:
        return f"{number} > 0 or {all_robots} * 0 / 0 unless on () ({_PROOF})"
    return f"""
      {number}
    or
      ({all_robots} * 0 and on () ({_PROOF}))
    or
      {all_robots} * 0 / 0
    """


_COMPONENT = "fleet, robot, group, component"


def _listed(handled: str) -> str:
    """Return the problems of the chosen state; ``handled`` compares 1 for what is handled.

    "== 1" leaves out what is acknowledged or planned, "== 0" leaves out nothing.
    """
    return problem_rows(
        _MATCHERS,
        of_states=_STATES,
        selected=f"and on (fleet, robot) {_SELECTED}",
        covered=f"""
    unless on (fleet, robot) {HELD}{{scope="robot", state=~"many|flapping"}}
""",
        chosen="${state:raw}",
        filters=f"""
  unless on ({IDENTITY})
    (group by ({IDENTITY}) ({ACKNOWLEDGED}) {handled})
  unless on (fleet, robot)
    (group by (fleet, robot) (ros_diagnostics_robot_maintenance == 1) {handled})
  unless on ({_COMPONENT})
    (group by ({_COMPONENT}) (ros_diagnostics_component_maintenance == 1) {handled})
""",
    )


_STATES = 'fleet=~"$fleet"'
_PROOF = reached(settled(_STATES), "$site")
_PROBLEMS = _listed("${problems:raw}")


def number_of_problems() -> stat.Panel:
    """Count the rows of the table of problems."""
    zero = f"group({_PROOF}) * 0"
    listed = f"count({_PROBLEMS}) or {zero}"
    unhandled = f"""
      count({_listed("== 1")}) and on () ({reached(answering(_STATES), "$site")})
    or
      {zero}
    or
      count({_PROBLEMS}) * 0 / 0
    """
    return (
        panels.number(
            "Number of problems",
            "How many problems are listed above, and how many of them are unhandled: neither "
            "acknowledged nor planned? A question mark: not known while an exporter does not "
            "answer.",
            listed,
        )
        .mappings(palette.UNKNOWN_NUMBER)
        .targets(
            [
                panels.at_end(listed, "listed"),
                panels.at_end(unhandled, "unhandled", "B"),
            ]
        )
        .text_mode(common.BigValueTextMode.VALUE_AND_NAME)
        .span(4)
        .height(8)
    )


def problems() -> table.Panel:
    """List what is wrong, worst first."""
    return problem_table(
        "Problems",
        "What is wrong now, where, since when, and what is the driver's message? Worst first, then "
        "the oldest. The message is that at the time of confirmation, with values and what else "
        "was wrong; of what is not confirmed yet, the present one. A silent robot is one row, and "
        "so is what has one cause on many robots. Confirmed problems have lasted for their "
        "confirm_after, and an alert fires. Handled by: who has it or was notified, or why "
        "nobody was. Unhandled, at the top, leaves out what is acknowledged or planned.",
        _PROBLEMS,
        _MATCHERS,
        of_states=_STATES,
        proof=_PROOF,
    ).height(14)


# --- The fleet as a whole ---


def share_working() -> stat.Panel:
    """Show the share of robots that work, and what became of their missions."""
    known = f'sum({_COUNT}{{{_MATCHERS}, state!="pending"}})'
    working = f"""
      (
          sum({_COUNT}{{{_MATCHERS}, state=~"ok|warning|flapping"}})
        or
          {known} * 0 and on () ({_PROOF})
        or
          {known} * 0 / 0
      )
    /
      {known}
    """
    panel = panels.number(
        "Working robots",
        "Which share of the robots, without PENDING ones, is OK or in WARNING? Not known while "
        "no exporter answers. Where robots have missions, also which share of their goals they "
        "reached in the last 24 hours, and how often somebody had to help for each hour in "
        "which they worked by themselves: a click opens them.",
        working,
        "percentunit",
    ).targets([panels.at_end(working, "working now")])
    return missions.beside(panel.mappings(palette.UNKNOWN_NUMBER).decimals(0).span(4).height(8))


LEVELS = {
    "error": palette.CRITICAL,
    "stale": palette.STALE,
    "warn": palette.WARNING,
    "ok": palette.OK,
}


def components_by_state() -> stat.Panel:
    """Count the components in each state."""
    return (
        panels.counts(
            "Components",
            "How many components are in each state? In the chosen fleets; site and group do not "
            "apply.",
            "sum by (level) (max by (fleet, exporter, level) "
            '(ros_diagnostics_fleet_components{fleet=~"$fleet"}))',
            "level",
            LEVELS,
        )
        .span(4)
        .height(8)
    )


def health() -> timeseries.Panel:
    """Show the robots by state over time, the worst at the bottom."""
    states = [(state.word, state.word.lower(), state.colour) for state in palette.WORST_FIRST]
    none = {"UNKNOWN": f" or sum({_COUNT}{{{_MATCHERS}}}) * 0"}  # in most fleets there never is one
    panel = panels.graph(
        "Health of the fleet",
        "Is it getting better or worse? Robots by state over time, the worst at the bottom.",
        *(
            panels.over_time(
                f'sum({_COUNT}{{{_MATCHERS}, state="{label}"}}){none.get(word, "")}', word, ref
            )
            for ref, (word, label, _colour) in zip("ABCDEFGHI", states, strict=True)
        ),
    )
    for word, _label, colour in states:
        panel = panel.override_by_name(word, panels.series(word, colour))
    return panels.stacked(panel).min(0).axis_soft_max(4).decimals(0)


# --- Robots ---


def wall() -> stat.Panel:
    """Show a tile for each robot in the colour of its state; a click opens the robot."""
    found = f"""
      ({_RANK} ${{state:raw}})
    * on (fleet, robot) group_left (site, at)
      ({_at_site(_SELECTED)} unless on (fleet, robot) {DEVICE})
    and on (at)
      {label("vector(0)", "at", "${wall:raw}")}
    """
    query = panels.at_end(in_order(_named_to_fit(panels.tidy(found))))
    # Each row becomes a field: its other columns are labels, for the link.
    fields = [
        {"fieldName": "Time", "handlerKey": "__ignore"},
        {"fieldName": "name", "handlerKey": "field.name"},
        {"fieldName": "Value", "handlerKey": "field.value"},
    ]
    link = builders.DashboardLink("Open this robot").url(links.TO_ROBOT_OF_SERIES)
    panel = panels.number(
        "All robots of $wall",
        "In which state is each robot? A tile for each, by name; a panel for each site. "
        "A click opens the robot. A long name is shortened. With more than "
        f"{_LONG} robots a tile has the first character of the name and its number, without one "
        "the first and the last two characters; with more than "
        f"{_SHORT} no name.",
        found,
    )
    return (
        panels.on_colour(panel.mappings(palette.state_mappings()))
        .targets([query.format(PromQueryFormat.TABLE)])
        .transformations(
            [
                tables.step("sortBy", fields={}, sort=[{"field": "order"}]),
                tables.step("rowsToFields", mappings=fields),
            ]
        )
        .text_mode(common.BigValueTextMode.NAME)
        .display_name("${__field.name}")  # without labels
        .data_links([link])
        .repeat("wall")
        .repeat_direction("v")
        .span(24)
        .height(4)
    )


def _at_site(robots: str) -> str:
    """Add a label ``at``: the robot's site, also where it has none."""
    at = label(robots, "at", "$1", "site", "(.+)")
    return label(at, "at", NO_SITE, "site", "")


NO_SITE = "no site"
_LONG = 16  # tiles that have room for names on a phone
_SHORT = 220  # and that are wider than their margins: else Grafana writes over the others


def _named_to_fit(robots: str) -> str:
    """Add a label ``name``: the robot's, shorter the more tiles there are."""
    full = label(robots, "name", "$1", "robot", "(.*)")
    # One that is long would make the text of all tiles small.
    full = label(full, "name", "$1\u2026$2", "robot", "(.{6}).{4,}(.{3})")
    start = label(robots, "name", "$1$2", "robot", "(.{1,2}).*?(.{0,2})")
    short = label(start, "name", "$1$2", "robot", "(.).*?([0-9]{1,4})")
    return f"""
      {full} and on () count({robots}) <= {_LONG}
    or on (fleet, robot)
      {short} and on () count({robots}) <= {_SHORT}
    or on (fleet, robot)
      {label(robots, "name", _NO_NAME)}
    """


_NO_NAME = "\u00a0"  # an empty one would be the value's name


def states_of_robots() -> statetimeline.Panel:
    """Show the states of the worst robots over time."""
    link = builders.DashboardLink("Open this robot").url(links.TO_ROBOT_OF_SERIES)
    # The worst are chosen at the end of the range, so that the rows stay the same over all of it.
    # Only those are read: the states of all robots over weeks would be too much for Prometheus.
    read = f'robot:ros_diagnostics_state:rank{{fleet=~"$fleet", {variables.WORST}}}'
    expr = in_order(f"max_over_time({read}[$__interval])")
    placed = worst_first(expr, *_of_robots(" @ end()"), most=LINES)
    fleets = f"group by (fleet) ({_SELECTED})"
    several = f"({label(fleets, 'of', '$1/', 'fleet', '(.*)')} and on () count({fleets}) > 1)"
    placed = f"({placed}) * on (fleet) group_left (of) ({several} or on (fleet) {fleets})"
    panel = panels.timeline(
        "States of the robots",
        "When was which robot in which state? The worst state of each step, of at least ten "
        "seconds. The 15 robots that are worst at the end of the range, of equal ones the oldest "
        "fault first: filter to see others.",
        panels.over_time(named(placed), "{{of}}{{who}}").interval("10s"),
    )
    # Without a legend, by Grafana 9's option, too: the words of the colours are at the top.
    legend = panels.legend().show_legend(False).display_mode(common.LegendDisplayMode.HIDDEN)
    then = builders.DashboardLink("The robot at that moment").url(links.TO_ROBOT_THEN)
    return panel.max_data_points(400).data_links([link, then]).legend(legend).height(12)


LINES = 15  # of a timeline: names of more are not legible


def _of_robots(at: str = "") -> tuple[str, str, str]:
    """Return ranks, begins and labels of the chosen robots; ``at`` is a modifier, "@ end()"."""
    rank = f"({_RANK}{at} ${{state:raw}}) and on (fleet, robot) {_SELECTED}{at}"
    return rank, f"min by (fleet, robot) ({HELD_OF_ROBOT}{{{_STATES}}}{at})", "fleet, robot"


_IN_TROUBLE = """
    component:ros_diagnostics_state:rank{fleet=~"$fleet"}
  unless on (fleet, robot, group, component)
    ros_diagnostics_component_planned_stale == 1
"""


def robots() -> table.Panel:
    """List all robots."""
    found = f"""
  ({_RANK} ${{state:raw}})
* on (fleet, robot) group_left (site, robot_group, kind)
  {_SELECTED}
"""
    return tables.joined(
        "Robots",
        "What is the state of each robot, and how old is its last message? Since is when its "
        "oldest confirmed fault began, also one of its site or of many robots. Lost and Delay are "
        "of its connection in the last minute: the share of messages that did not arrive, and the "
        "longest delay.",
        {
            "A": in_order(found),
            "B": message_age('fleet=~"$fleet"'),
            "C": f"""
              count by (fleet, robot) ({_IN_TROUBLE})
            or
              max by (fleet, robot) (ros_diagnostics_robot_up{{fleet=~"$fleet"}}) * 0
            """,
            "E": f'min by (fleet, robot) ({HELD_OF_ROBOT}{{fleet=~"$fleet"}}) * 1000',
            "F": 'max by (fleet, robot) (ros_diagnostics_robot_maintenance{fleet=~"$fleet"})',
            "L": f"max by (fleet, robot) (ros_diagnostics_robot_link_lost_ratio{{{_STATES}}})",
            "D": f"max by (fleet, robot) (ros_diagnostics_robot_link_delay_seconds{{{_STATES}}})",
        },
        [
            tables.STATE,
            tables.ROBOT_IN_ORDER,
            Column("site", "Site", min_width=100),
            Column("robot_group", "Group", min_width=100),
            Column("kind", "Kind", min_width=100),
            Column("E", "Since", unit=tables.TIME, width=160),
            Column("C", "Components not OK", width=160),
            Column("B", "Last message", unit=tables.DURATION, width=115),
            Column("L", "Lost", unit="percentunit", width=70),
            Column("D", "Delay", unit="s", width=80),
            tables.MAINTENANCE,
            tables.FLEET,
            tables.NAME,
        ],
        by="fleet, robot",
        empty=tables.Empty("No robot matches", _PROOF, "kind"),
        sort=("State", "Robot"),
    ).height(14)
