"""The fleet: tactical overview, problems, list of robots."""

from __future__ import annotations

from urllib.parse import quote

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat, statetimeline, table, timeseries
from grafana_foundation_sdk.models import common

from fleet_dashboards.lib import dashboard as frame
from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.palette import State
from fleet_dashboards.lib.tables import Column
from fleet_dashboards.queries import fleet as queries

POINTS = 400
MAINTENANCE = palette.yes("planned", palette.MAINTENANCE_COLOUR)

# How the recorded states call them; robots behind a dead uplink are silent, too.
BY_STATE = {state.word: state.word.lower() for state in palette.STATES}
BY_STATE["UNKNOWN"] = "unknown|unreachable"

QUESTIONS = {
    "CRITICAL": "How many robots have an error, or lack a component that they should have?",
    "UNKNOWN": "How many robots are silent, so that nobody knows how they are?",
    "STALE": "How many robots have a component that stopped reporting?",
    "WARNING": "How many robots work, but should be looked at?",
    "OK": "How many robots are well?",
    "PENDING": "How many robots are declared and were never heard?",
}


def build() -> builders.Dashboard:
    """The dashboard that opens first."""
    return frame.board(
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
            share_well(),
            components_by_state(),
            health(),
            states_of_robots(),
            robots(),
        ],
    )


def robots_in(state: State) -> stat.Panel:
    """The count of robots in one state; a click shows only those."""
    description = f"{QUESTIONS[state.word]} A click filters by this state."
    link = builders.DashboardLink(f"Only {state.word}").url(
        links.to_fleet(quote(f"== {state.rank}"))
    )
    return (
        panels.number(state.word, description, queries.robots_in(BY_STATE[state.word]))
        .color_mode(common.BigValueColorMode.BACKGROUND)
        .color_scheme(panels.by_thresholds())
        .thresholds(panels.steps((None, "transparent"), (1, state.colour)))
        .data_links([link])
    )


def problems() -> table.Panel:
    """What is wrong, worst first: the list of the thesis' figure 16."""
    return tables.listing(
        "Problems",
        "What is wrong now, where, since when, and what does the driver say? Worst first. A silent "
        "robot is one row. Confirmed is what has lasted for the robot's confirm_after and is told; "
        "the rest may yet pass. Acknowledged says who takes care of just this fault, and with "
        "which words. Planned stands for maintenance from fleet.yml. Unhandled, at the top, leaves "
        "out what is acknowledged or planned.",
        "No problems",
        {
            "A": queries.PROBLEMS,
            "B": queries.PROBLEM_SINCE,
            "C": queries.PROBLEM_FOR,
            "D": queries.CONFIRMED,
            "E": queries.MESSAGES,
            "F": queries.PROBLEMS_IN_MAINTENANCE,
            "G": queries.ACKNOWLEDGED,
        },
        [
            tables.STATE,
            Column("fleet", "Fleet", width=110),
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


CONFIRMED = palette.yes("confirmed", palette.NEUTRAL, otherwise="not yet")


def share_well() -> stat.Panel:
    """The share of robots that work."""
    return panels.number(
        "Robots that work",
        "Which share of the robots that were ever heard is OK or in WARNING?",
        queries.SHARE_WELL,
        "percentunit",
    ).height(8)


def components_by_state() -> stat.Panel:
    """The count of components by state, of all chosen fleets."""
    panel = panels.number(
        "Components",
        "How many components stand in each state? Of the chosen fleets, whatever site and group.",
        queries.COMPONENTS_BY_RANK,
    ).targets([panels.at_end(queries.COMPONENTS_BY_RANK, "{{rank}}")])
    panel = panel.text_mode(common.BigValueTextMode.VALUE_AND_NAME)
    return by_rank(panel).height(8).span(8)


def health() -> timeseries.Panel:
    """Robots by state over time."""
    panel = panels.graph(
        "Health of the fleet",
        "Is it getting better or worse? Robots by state over time.",
        panels.over_time(queries.ROBOTS_BY_STATE, "{{state}}"),
    )
    for state in palette.STATES:
        look = panels.series(state.word, state.colour)
        panel = panel.override_by_name(state.word.lower(), look)
    look = panels.series("UNREACHABLE", palette.UNREACHABLE_COLOUR)
    return panels.stacked(panel.override_by_name("unreachable", look)).min(0).decimals(0)


def states_of_robots() -> statetimeline.Panel:
    """A bar for each robot."""
    link = builders.DashboardLink("Open this robot").url(links.TO_ROBOT_OF_SERIES)
    panel = panels.timeline(
        "States of the robots",
        "When was which robot in which state? The worst of each minute, half a minute late. Of "
        "more than 50 robots, the 50 that are worst at the end of the range: filter to see others.",
        panels.over_time(queries.WORST_ROBOTS, "{{robot}}"),
    )
    # Every point costs a look at all robots; more of them than this nobody sees apart.
    return panel.max_data_points(POINTS).data_links([link])


def robots() -> table.Panel:
    """Every robot, a row each: Nagios' host list."""
    return tables.listing(
        "Robots",
        "How is each robot, and when was it last heard?",
        "No robot is left by the filters",
        {
            "A": queries.ROBOTS,
            "B": queries.MESSAGE_AGE,
            "C": queries.TROUBLED_COMPONENTS,
            "D": queries.MAINTENANCE,
            "E": queries.ROBOT_SINCE,
        },
        [
            tables.STATE,
            Column("fleet", "Fleet", width=110),
            Column("robot", "Robot", link=links.TO_ROBOT),
            Column("site", "Site"),
            Column("robot_group", "Group"),
            Column("kind", "Kind"),
            Column("E", "Since", unit="dateTimeAsIsoNoDateIfToday", width=160),
            Column("C", "Components in trouble", width=170),
            Column("B", "Last message", unit="dtdurations", width=160),
            Column("D", "Maintenance", mappings=MAINTENANCE, width=120),
        ],
        by="fleet, robot",
    ).height(14)


def by_rank(panel: stat.Panel) -> stat.Panel:
    """Name and colour the series that are called by a rank."""
    for state in palette.STATES:
        panel = panel.override_by_name(str(state.rank), panels.series(state.word, state.colour))
    return panel
