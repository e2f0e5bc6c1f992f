"""One robot: its components, its values, its connection."""

from __future__ import annotations

import re

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat, statetimeline, table, timeseries
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.annotations import Annotation
from fleet_dashboards.lib.dashboard import new_dashboard
from fleet_dashboards.lib.promql import author_and_comment, component_rank, rank_of_level
from fleet_dashboards.lib.tables import Column

_ROBOT = 'fleet=~"$fleet", robot="$robot"'
_COMPONENTS = f'{_ROBOT}, component=~"$component"'
_BY = "by (fleet, robot, group, component)"
_RANK = component_rank(_COMPONENTS)

COMPONENT = Column("component", "Component", link=links.TO_COMPONENT_OF_FLEET)
MESSAGE = Column("message", "Message")


def build() -> builders.Dashboard:
    """Return the dashboard of one robot."""
    board = new_dashboard(
        links.ROBOT_UID,
        "Robot",
        "What is wrong with this robot, and what was wrong before?",
        [variables.fleet(), variables.robot(), variables.components(), variables.unit()],
        [
            state(),
            silent_for(),
            silent_reason(),
            message_age(),
            clock_offset(),
            maintenance(),
            errors(),
            warnings(),
            stale(),
            states_of_components(),
            batteries(),
            temperatures(),
            all_components(),
            checks(),
            groups(),
            "Values",
            values_without_unit(),
            values_by_unit(),
            "Connection",
            message_age_over_time(),
            clock_offset_over_time(),
            messages_received(),
            data_received(),
            publishers(),
            rejected(),
            inventory(),
        ],
    )
    return board.annotation(state_changes()).annotation(firing_alerts())


# --- Annotations: 1 while it lasts; Grafana queries them at least once a minute ---


def state_changes() -> Annotation:
    """Mark the minutes in which the robot's state changed."""
    return Annotation(
        "State changes",
        f"clamp_max(changes(robot:ros_diagnostics_state:rank{{{_ROBOT}}}[1m]), 1) == 1",
        palette.NEUTRAL,
        "{{robot}} changed its state",
        "See the states of the components.",
    )


def firing_alerts() -> Annotation:
    """Mark the times at which an alert of the robot fired."""
    return Annotation(
        "Firing alerts",
        f'ALERTS{{alertstate="firing", {_ROBOT}}}',
        palette.CRITICAL.colour,
        "{{alertname}}",
        "{{severity}}: {{component}}",
    )


# --- The robot as a whole ---


def state() -> stat.Panel:
    """Show the robot's state."""
    return panels.word(
        "State",
        "What is the state of the robot? That of its worst component; UNKNOWN while it is silent.",
        f"robot:ros_diagnostics_state:rank{{{_ROBOT}}}",
        palette.state_mappings(),
    )


def silent_for() -> stat.Panel:
    """Show for how long the robot has been silent."""
    return panels.number(
        "Silent for",
        "For how long has the robot been silent? Empty while messages are received.",
        f"""
        time() - (
          robot:ros_diagnostics_silent:start{{{_ROBOT}}}
        or
          robot:ros_diagnostics_pending:start{{{_ROBOT}}}
        )
        """,
        "dtdurations",
    )


def silent_reason() -> stat.Panel:
    """Show why the robot is silent."""
    return panels.name(
        "Why silent",
        "Why is the robot silent: was it never seen, is its publisher gone, or does the publisher "
        "send nothing? Empty while messages are received.",
        f"max by (reason) (ros_diagnostics_robot_silent_reason{{{_ROBOT}}} == 1)",
        "reason",
    )


# A message received during the scrape may have a timestamp after time(): hence clamp_min.
_MESSAGE_AGE = f"""
clamp_min(
    time()
  -
    max by (fleet, robot) (ros_diagnostics_robot_last_message_timestamp_seconds{{{_ROBOT}}} > 0),
  0
)
"""
_CLOCK_OFFSET = f"max by (fleet, robot) (ros_diagnostics_robot_clock_offset_seconds{{{_ROBOT}}})"


def message_age() -> stat.Panel:
    """Show the age of the last message."""
    return panels.number(
        "Last message",
        "How old is the last message, and with it the data on this page?",
        _MESSAGE_AGE,
        "dtdurations",
    )


def clock_offset() -> stat.Panel:
    """Show how far the robot's clock is off."""
    return panels.number(
        "Clock offset",
        "How far is the robot's clock behind the exporter's? This includes the latency of the "
        "message.",
        _CLOCK_OFFSET,
        "s",
    )


def maintenance() -> stat.Panel:
    """Show whether the robot is in planned maintenance."""
    return panels.word(
        "Maintenance",
        "Is the robot in maintenance planned in fleet.yml? No notification of its faults is sent "
        "meanwhile.",
        f"max by (fleet, robot) (ros_diagnostics_robot_maintenance{{{_ROBOT}}})",
        palette.yes("planned", palette.MAINTENANCE_COLOUR, otherwise="no"),
    )


# --- Components: the three boxes and the tree of rqt_robot_monitor ---

_MESSAGES = f"""
group by (fleet, robot, group, component, message) (
  ros_diagnostics_component_message_info{{{_COMPONENTS}}}
)
"""


def errors() -> table.Panel:
    """List the components with an error."""
    return _box(
        "Errors",
        "Which components have an error, and what are their messages?",
        "No errors",
        f"{_RANK} == 3",
    )


def warnings() -> table.Panel:
    """List the components with a warning."""
    return _box(
        "Warnings",
        "Which components have a warning, and what are their messages?",
        "No warnings",
        f"{_RANK} == 1",
    )


def stale() -> table.Panel:
    """List the components that stopped reporting."""
    return _box(
        "Stale",
        "Which components stopped reporting, alone or because the robot is silent?",
        "No stale components",
        f"""
          {_RANK} == 2
        or
          {_RANK} == 4
        """,
    )


def _box(title: str, description: str, empty: str, expr: str) -> table.Panel:
    return (
        tables.joined(
            title,
            description,
            empty,
            {
                "A": expr,
                "B": f"time() - component:ros_diagnostics_problem:start{{{_COMPONENTS}}}",
                "C": _MESSAGES,
            },
            [COMPONENT, MESSAGE, Column("B", "For", unit="dtdurations", width=150)],
            sort="For",
        )
        .height(8)
        .span(panels.WIDTH // 3)
    )


def states_of_components() -> statetimeline.Panel:
    """Show the states of the components over time."""
    return panels.timeline(
        "States of the components",
        "When was which component in which state?",
        panels.over_time(_RANK, "{{component}}"),
    )


_HARDWARE = f"""
group by (fleet, robot, group, component, hardware_id) (
  ros_diagnostics_component_info{{{_COMPONENTS}}}
)
"""
_SINCE = f"ros_diagnostics_component_since_timestamp_seconds{{{_COMPONENTS}}}"
_BEFORE = f"ros_diagnostics_component_level_before_stale{{{_COMPONENTS}}}"
_CHANGES = f"ros_diagnostics_component_changes_total{{{_COMPONENTS}}}[$__range]"


def all_components() -> table.Panel:
    """List all components by group."""
    return tables.joined(
        "All components",
        "What is the state of each component, by group? Before is the state before it stopped "
        "reporting; changes are those of the time range.",
        "No component was received yet",
        {
            "A": _RANK,
            "B": f"max {_BY} ({_SINCE}) * 1000",
            "C": _MESSAGES,
            "D": _HARDWARE,
            "E": rank_of_level(f"max {_BY} ({_BEFORE})"),
            "F": f"sum {_BY} (increase({_CHANGES}))",
            "G": author_and_comment(_ROBOT),
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


_FOUND = f"ros_diagnostics_check_components{{{_ROBOT}}}"
_EXPECTED = f"ros_diagnostics_check_expected_components{{{_ROBOT}}}"


def checks() -> table.Panel:
    """List the checks that fleet.yml defines."""
    return (
        tables.joined(
            "Checks",
            "What is the state of the checks of fleet.yml, and do they find as many components as "
            "expected?",
            "No checks",
            {
                "A": f"check:ros_diagnostics_state:rank{{{_ROBOT}}}",
                "B": f"sum by (fleet, robot, check) ({_FOUND})",
                "C": f"max by (fleet, robot, check) ({_EXPECTED})",
            },
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
    """List the groups of the robot's own aggregator."""
    level = f"max by (group) (ros_diagnostics_group_level{{{_ROBOT}}})"
    return (
        tables.joined(
            "Groups as the robot's aggregator reports them",
            "Which state does the robot's own aggregator give each group? Its roll-up differs "
            "between versions, so nothing else here is computed from it.",
            "Its messages are not aggregated",
            {"A": rank_of_level(level)},
            [tables.STATE, Column("group", "Group")],
        )
        .height(8)
        .span(12)
    )


# --- Key-values, with their thresholds from fleet.yml as dashed lines ---

_CHARGE = 'component=~"(?i).*batter.*", key=~"(?i).*(level|charge|percent|soc).*", unit=~"%|"'


def _value(matchers: str) -> str:
    family = f"ros_diagnostics_component_value{{{_COMPONENTS}, {matchers}}}"
    return f"max by (component, key, unit) ({family})"


def _threshold(matchers: str) -> str:
    family = f"ros_diagnostics_component_value_threshold{{{_COMPONENTS}, {matchers}}}"
    return f"max by (component, key, unit, bound, severity) ({family})"


def batteries() -> timeseries.Panel:
    """Show the charge of the batteries."""
    return _values(
        "Batteries",
        "How full are the batteries? Dashed: the thresholds of fleet.yml.",
        _value(_CHARGE),
        _threshold(_CHARGE),
    ).min(0)


def temperatures() -> timeseries.Panel:
    """Show the temperatures."""
    degrees = 'unit=~"degC|degF|K"'
    return _values(
        "Temperatures",
        "What becomes too hot? Dashed: the thresholds of fleet.yml.",
        _value(degrees),
        _threshold(degrees),
    )


def values_without_unit() -> timeseries.Panel:
    """Show the numbers without a unit, except for the charge of batteries."""
    without = 'unit=""'
    return _values(
        "Values without a unit",
        "How do the other numbers develop, those without a unit?",
        f"{_value(without)} unless {_value(_CHARGE)}",
        f"{_threshold(without)} unless {_threshold(_CHARGE)}",
    )


def values_by_unit() -> timeseries.Panel:
    """Show the other values: a panel for each unit."""
    panel = _values(
        "Values in $unit",
        "How do the numbers in this unit develop? One panel for each unit.",
        _value('unit="$unit"'),
        _threshold('unit="$unit"'),
    )
    return panel.repeat("unit").repeat_direction("h").max_per_row(2)


def _values(title: str, description: str, expr: str, thresholds: str) -> timeseries.Panel:
    """Show values in their units, and their thresholds dashed in the colour of the severity."""
    panel = panels.graph(
        title,
        description,
        panels.over_time(expr, "{{component}}: {{key}} [{{unit}}]"),
        panels.over_time(
            thresholds, "{{severity}} {{bound}}: {{component}} {{key}} [{{unit}}]", "B"
        ),
    )
    for unit, grafana_unit in palette.UNITS.items():
        regexp = rf"/ \[{re.escape(unit).replace('/', chr(92) + '/')}\]$/"
        panel = panel.override_by_regexp(
            regexp, [dashboard.DynamicConfigValue("unit", grafana_unit)]
        )
    for severity, state in (("warning", palette.WARNING), ("critical", palette.CRITICAL)):
        panel = panel.override_by_regexp(f"/^{severity} (low|high): /", panels.dashed(state.colour))
    return panel


# --- The connection ---


def message_age_over_time() -> timeseries.Panel:
    """Show the age of the last message over time."""
    limit = f"max by (fleet, robot) (ros_diagnostics_robot_stale_after_seconds{{{_ROBOT}}})"
    return panels.graph(
        "Age of the last message",
        "Did the connection have gaps, and how long? Above the dashed line the robot is silent.",
        panels.over_time(_MESSAGE_AGE, "age"),
        panels.over_time(limit, "silent above", "B"),
        unit="s",
    ).override_by_name("silent above", panels.dashed(palette.UNKNOWN.colour))


def clock_offset_over_time() -> timeseries.Panel:
    """Show the offset of the robot's clock over time."""
    return panels.graph(
        "Clock offset over time",
        "Does the robot's clock drift or step?",
        panels.over_time(_CLOCK_OFFSET, "offset"),
        unit="s",
    )


def messages_received() -> timeseries.Panel:
    """Show the rate of messages."""
    messages = f"ros_diagnostics_robot_messages_total{{{_ROBOT}}}[$__rate_interval]"
    return panels.graph(
        "Messages received",
        "How many arrays are received per second?",
        panels.over_time(f"sum by (fleet, robot) (rate({messages}))", "messages"),
        unit="cps",
    )


def data_received() -> timeseries.Panel:
    """Show the rate of bytes."""
    expr = f"""
    sum by (fleet, robot) (
      rate(ros_diagnostics_robot_message_bytes_total{{{_ROBOT}}}[$__rate_interval])
    )
    """
    return panels.graph(
        "Data received",
        "How much network bandwidth do this robot's diagnostics use?",
        panels.over_time(expr, "bytes"),
        unit="Bps",
    )


def publishers() -> stat.Panel:
    """Count the publishers that DDS has matched."""
    return panels.number(
        "Publishers",
        "How many publishers on this robot's topics does DDS see now? None: the program has "
        "ended, or the network is down. Some, but the robot is silent: the program hangs.",
        f"max by (fleet, robot) (ros_diagnostics_robot_publishers{{{_ROBOT}}})",
    ).height(8)


def rejected() -> table.Panel:
    """List what was rejected, by reason."""
    rejections = f"ros_diagnostics_robot_rejected_total{{{_ROBOT}}}[$__range]"
    return (
        tables.joined(
            "Rejected",
            "What of this robot's messages was rejected during the time range, and why?",
            "Nothing was rejected",
            {"A": f"sum by (reason) (increase({rejections})) > 0"},
            [Column("reason", "Reason"), Column("A", "Count")],
            sort="Count",
        )
        .height(8)
        .span(8)
    )


def inventory() -> table.Panel:
    """Show the robot's labels, network and profile."""
    titles = {
        "fleet": "Fleet",
        "robot": "Robot",
        "site": "Site",
        "robot_group": "Robot group",
        "kind": "Kind",
        "team": "Team",
        "uplink": "Uplink",
        "address": "Address",
        "domain_id": "Domain",
        "ros_namespace": "Namespace",
        "topic": "Topic",
        "profile": "Profile",
    }
    return (
        tables.joined(
            "Inventory",
            "What are the labels, the network and the profile of this robot?",
            "No such robot",
            {"A": f"ros_diagnostics_robot_info{{{_ROBOT}}}"},
            [Column(label, title) for label, title in titles.items()],
            sort="Robot",
        )
        .height(8)
        .span(12)
    )
