"""One robot: what rqt_robot_monitor shows, and the past of it."""

from __future__ import annotations

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat, statetimeline, table

from fleet_dashboards.dashboards import robot_connection, robot_values
from fleet_dashboards.lib import annotations as marks
from fleet_dashboards.lib import dashboard as frame
from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.tables import Column
from fleet_dashboards.queries import robot as queries

COMPONENT = Column("component", "Component", link=links.TO_COMPONENT_OF_FLEET)
MESSAGE = Column("message", "Message")
FOR = Column("B", "For", unit="dtdurations", width=150)
THIRD = panels.WIDTH // 3


def build() -> builders.Dashboard:
    """The dashboard of one robot."""
    board = frame.board(
        links.ROBOT_UID,
        "Robot",
        "What is wrong with this robot, and what was?",
        [variables.fleet(), variables.robot(), variables.components(), variables.unit()],
        [
            state(),
            silent_for(),
            silence_reason(),
            message_age(),
            clock_offset(),
            maintenance(),
            errors(),
            warnings(),
            not_heard(),
            states_of_components(),
            robot_values.battery(),
            robot_values.temperature(),
            tree(),
            checks(),
            groups(),
            "Values",
            robot_values.bare_values(),
            robot_values.other_values(),
            "Connection",
            robot_connection.age_over_time(),
            robot_connection.offset_over_time(),
            robot_connection.receipt(),
            robot_connection.bytes_received(),
            robot_connection.publishers(),
            robot_connection.rejected(),
            robot_connection.inventory(),
        ],
    )
    return board.annotation(marks.state_changes()).annotation(marks.told())


def state() -> stat.Panel:
    """The robot's state."""
    return panels.word(
        "State",
        "How is the robot now? As bad as its worst component; UNKNOWN while it is silent.",
        queries.STATE,
        palette.state_mappings(),
    )


def silent_for() -> stat.Panel:
    """The length of the present silence."""
    return panels.number(
        "Silent for",
        "For how long has nothing been heard? Empty while messages arrive.",
        queries.SILENT_FOR,
        "dtdurations",
    )


def silence_reason() -> stat.Panel:
    """The reason of a silence."""
    return panels.name(
        "Why silent",
        "Why is the robot not heard: was it never seen, is its publisher gone or mute? Empty while "
        "messages arrive.",
        queries.SILENCE_REASON,
        "reason",
    )


def message_age() -> stat.Panel:
    """The age of what is shown."""
    return panels.number(
        "Last message",
        "How old is the last message, and so everything that is shown here?",
        queries.MESSAGE_AGE,
        "dtdurations",
    )


def clock_offset() -> stat.Panel:
    """The robot's clock."""
    return panels.number(
        "Clock offset",
        "How far behind the server's clock is the robot's? The time that the message was under way "
        "is part of it.",
        queries.CLOCK_OFFSET,
        "s",
    )


def maintenance() -> stat.Panel:
    """Planned downtime."""
    return panels.word(
        "Maintenance",
        "Is this a downtime that fleet.yml plans? Nothing is told during it.",
        queries.MAINTENANCE,
        palette.yes("planned", palette.MAINTENANCE_COLOUR, otherwise="no"),
    )


def errors() -> table.Panel:
    """The first box of rqt_robot_monitor."""
    return _box(
        "Errors",
        "Which components have an error, and what do they say?",
        "No errors",
        queries.ERRORS,
    )


def warnings() -> table.Panel:
    """The second box."""
    return _box(
        "Warnings", "Which components warn, and what do they say?", "No warnings", queries.WARNINGS
    )


def not_heard() -> table.Panel:
    """The third box."""
    return _box(
        "Stale",
        "Which components stopped reporting, alone or because their robot is silent?",
        "All report",
        queries.NOT_HEARD,
    )


def _box(title: str, description: str, empty: str, expr: str) -> table.Panel:
    answers = {"A": expr, "B": queries.PROBLEM_FOR, "C": queries.MESSAGES}
    box = tables.listing(
        title, description, empty, answers, [COMPONENT, MESSAGE, FOR], sort="For", descending=True
    )
    return box.height(8).span(THIRD)


def states_of_components() -> statetimeline.Panel:
    """The timeline of rqt_robot_monitor, for each component and any range."""
    return panels.timeline(
        "States of the components",
        "When was which component in which state?",
        panels.over_time(queries.TREE, "{{component}}"),
    )


def tree() -> table.Panel:
    """All components by group: the tree of rqt_robot_monitor."""
    return tables.listing(
        "All components",
        "How is each component, group by group? Before is what it was before it stopped reporting; "
        "changes are those of the time range.",
        "No component was heard yet",
        {
            "A": queries.TREE,
            "B": queries.LEVEL_SINCE,
            "C": queries.MESSAGES,
            "D": queries.HARDWARE,
            "E": queries.LEVEL_BEFORE,
            "F": queries.CHANGES,
            "G": queries.ACKNOWLEDGED,
        },
        [
            Column("group", "Group"),
            COMPONENT,
            tables.STATE,
            Column("B", "Since", unit="dateTimeAsIsoNoDateIfToday", width=160),
            MESSAGE,
            Column("acknowledged", "Acknowledged"),
            Column("E", "Before", mappings=palette.state_mappings(), width=110),
            Column("F", "Changes", width=90),
            Column("hardware_id", "Hardware"),
        ],
        sort="Group",
        descending=False,
    ).height(14)


def checks() -> table.Panel:
    """The checks that fleet.yml defines: the services of the thesis."""
    return (
        tables.listing(
            "Checks",
            "How do the checks of fleet.yml stand, and do they find as many components as they "
            "should?",
            "No checks",
            {"A": queries.CHECKS, "B": queries.CHECK_FOUND, "C": queries.CHECK_EXPECTED},
            [
                tables.STATE,
                Column("check", "Check"),
                Column("B", "Found", width=90),
                Column("C", "Expected", width=100),
            ],
            by="fleet, robot, check",
        )
        .height(8)
        .span(12)
    )


def groups() -> table.Panel:
    """What the robot's own aggregator says of its groups."""
    return (
        tables.listing(
            "Groups as the robot's aggregator reports them",
            "What does the robot's own aggregator make of it? Its roll-up differs between "
            "versions, so nothing else here is computed from it.",
            "Its messages are not aggregated",
            {"A": queries.GROUPS},
            [tables.STATE, Column("group", "Group")],
        )
        .height(8)
        .span(12)
    )
