"""One robot: its components, its values, its connection."""

from __future__ import annotations

import re

from grafana_foundation_sdk.builders import dashboard as builders
from grafana_foundation_sdk.builders import stat, statetimeline, table, timeseries

from fleet_dashboards.dashboards import capabilities
from fleet_dashboards.lib import links, palette, panels, tables, variables
from fleet_dashboards.lib.annotations import Annotation
from fleet_dashboards.lib.dashboard import closed_row, new_dashboard
from fleet_dashboards.lib.problems import problem_rows, problem_table
from fleet_dashboards.lib.promql import (
    HELD_OF_ROBOT,
    component_rank,
    label,
    message_age,
    problem_began,
    promoted,
    settled,
    silent_reason,
    with_unit,
    worst_first,
)
from fleet_dashboards.lib.tables import Column

_ROBOT = variables.ONE_ROBOT
_FAULTS = variables.OF_ONE_ROBOT
_COMPONENTS = f"{_ROBOT}, {variables.COMPONENTS}"
_BY = "by (fleet, robot, group, component)"
_RANK = component_rank(_COMPONENTS)


def build() -> builders.Dashboard:
    """Return the dashboard of one robot."""
    board = new_dashboard(
        links.ROBOT_UID,
        "Robot",
        "What is wrong with this robot, and what was wrong before?",
        [variables.fleet(), variables.robot(), variables.components(), variables.unit()],
        [
            problems(),
            state(),
            since(),
            connection(),
            message_age_now(),
            clock_offset(),
            maintenance(),
            states_of_components(),
            all_components(),
            batteries(),
            temperatures(),
            closed_row(
                "Capabilities, checks and groups", capabilities.of_robot(), checks(), groups()
            ),
            "Values",
            values_without_unit(),
            promoted_values(),
            values_by_unit(),
            "Connection",
            message_age_over_time(),
            clock_offset_over_time(),
            messages_received(),
            data_received(),
            messages_lost(),
            delay(),
            publishers(),
            rejected(),
            inventory(),
        ],
    )
    return board.annotation(state_changes()).annotation(alerts_begin())


# --- Annotations: marks, not areas; Grafana queries them at least once a minute ---


def state_changes() -> Annotation:
    """Mark the minutes in which the robot's state changed."""
    return Annotation(
        "State changes",
        f"clamp_max(changes(robot:ros_diagnostics_state:rank{{{_ROBOT}}}[1m]), 1) == 1",
        palette.NEUTRAL,
        "{{robot}} changed its state",
        "See the states of the components.",
    )


def alerts_begin() -> Annotation:
    """Mark the minutes in which an alert of the robot began to fire."""
    alerts = f'ALERTS{{alertstate="firing", {_ROBOT}}}'
    return Annotation(
        "Alerts",
        f"{alerts} unless {alerts} offset 1m",
        palette.CRITICAL.colour,
        "{{alertname}}",
        "{{severity}}: {{component}}",
    )


# --- The robot as a whole ---


def state() -> stat.Panel:
    """Show the robot's state."""
    return panels.word(
        "State",
        "What is the state of the robot? Its worst component; SILENT if nothing is received.",
        f"robot:ros_diagnostics_state:rank{{{_ROBOT}}}",
        palette.state_mappings(),
    )


def since() -> stat.Panel:
    """Show when the robot's oldest confirmed fault began."""
    faults = f"{HELD_OF_ROBOT}{{{_ROBOT}}}"
    none = f"robot:ros_diagnostics_state:rank{{{_ROBOT}}} * 0"
    return panels.number(
        "Fault since",
        "Since when has the robot had a confirmed fault? When the oldest that lasts began, "
        "also one of its site or of many robots.",
        f"min by (fleet, robot) ({faults}) * 1000 or on (fleet, robot) {none}",
        tables.TIME,
    ).mappings(palette.words({"0": ("none confirmed", None)}))


def connection() -> stat.Panel:
    """Show whether messages are received, and why not."""
    receiving = label(f"ros_diagnostics_robot_up{{{_ROBOT}}} == 1", "reason", "receiving")
    return panels.texts(
        "Connection",
        "Are messages received, and if not, why? The problem above has more words.",
        f"""
          max by (reason) ({receiving})
        or
          max by (reason) ({silent_reason(_ROBOT)})
        """,
        "reason",
        palette.words({reason: (text, None) for reason, text in palette.SHORT_REASONS.items()}),
    )


_MESSAGE_AGE = message_age(_ROBOT)
_CLOCK_OFFSET = f"max by (fleet, robot) (ros_diagnostics_robot_clock_offset_seconds{{{_ROBOT}}})"


def message_age_now() -> stat.Panel:
    """Show the age of the last message."""
    never = f"ros_diagnostics_robot_last_message_timestamp_seconds{{{_ROBOT}}} == 0"
    return (
        panels.number(
            "Last message",
            "How old was the last message when the exporter was scraped?",
            f"{_MESSAGE_AGE}\nor on (fleet, robot)\n  ({never}) - 1",
            "s",
        )
        .decimals(0)
        .mappings(palette.words({"-1": ("never", None)}))
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
        "Is the robot in a planned downtime? No fault of it begins meanwhile.",
        f"max by (fleet, robot) (ros_diagnostics_robot_maintenance{{{_ROBOT}}})",
        palette.words({"1": ("planned", palette.MAINTENANCE_COLOUR), "0": ("no", palette.NOTHING)}),
    )


# --- Problems: the boxes of rqt_robot_monitor; and its tree ---


def problems() -> table.Panel:
    """List what is wrong with the robot."""
    received = f"ros_diagnostics_robot_up{{{_ROBOT}}} == 1"
    listed = problem_table(
        "Problems",
        "What is wrong with the robot, since when, and who takes care of it? Errors, warnings, "
        "stale components, values beyond their thresholds, checks that find too little. The "
        "message is that at the time of confirmation, with values and what else was wrong. A fault "
        "of its site or of many robots is listed, too.",
        problem_rows(_FAULTS, of_states=_ROBOT, members=_ROBOT),
        _FAULTS,
        of_states=_ROBOT,
        proof=f"{settled(variables.FLEET, of='fleet')} and on (fleet) {received}",
        hidden=("Robot",),
    )
    return listed.height(8)


_MESSAGES = f"""
group by (fleet, robot, group, component, message) (
  ros_diagnostics_component_message_info{{{_COMPONENTS}}}
)
"""


def states_of_components() -> statetimeline.Panel:
    """Show the states of the components over time."""
    return panels.timeline(
        "States of the components",
        "When was which component in which state? First those that are worst at the end of the "
        "range, of equal ones the oldest trouble.",
        panels.over_time(
            worst_first(
                _RANK,
                component_rank(_COMPONENTS, " @ end()"),
                problem_began(_COMPONENTS, " @ end()"),
                "fleet, robot, group, component",
            ),
            "{{component}}",
        ),
    ).data_links([builders.DashboardLink("The robot at that moment").url(links.TO_ROBOT_THEN)])


_HARDWARE = f"""
group by (fleet, robot, group, component, hardware_id) (
  ros_diagnostics_component_info{{{_COMPONENTS}}}
)
"""
_SINCE = f"ros_diagnostics_component_since_timestamp_seconds{{{_COMPONENTS}}}"
_CHANGES = f"ros_diagnostics_component_changes_total{{{_COMPONENTS}}}[$__range]"


def all_components() -> table.Panel:
    """List all components by group."""
    return tables.joined(
        "All components",
        "What is the state of each component, and what is its present message? The worst first, "
        "then by group. Changes are those of the time range.",
        {
            "A": _RANK,
            "B": f"max {_BY} ({_SINCE}) * 1000",
            "C": _MESSAGES,
            "D": _HARDWARE,
            "E": f"round(sum {_BY} (increase({_CHANGES})))",
        },
        [
            tables.STATE,
            Column("group", "Group", min_width=120),
            Column(
                "component",
                "Component",
                link=links.TO_COMPONENT_OF_FLEET,
                min_width=150,
            ),
            Column("message", "Message", min_width=250),
            Column("B", "Since", unit=tables.TIME, width=160),
            Column("E", "Changes", width=90),
            Column("hardware_id", "Hardware", min_width=120),
        ],
        sort=("State", "Group", "Component"),
        ascending=("Group", "Component"),
    ).height(12)


_FOUND = f"ros_diagnostics_check_components{{{_ROBOT}}}"
_EXPECTED = f"ros_diagnostics_check_expected_components{{{_ROBOT}}}"


def checks() -> table.Panel:
    """List the checks that fleet.yml defines."""
    return (
        tables.joined(
            "Checks",
            "What is the state of the checks of fleet.yml, and do they find as many components as "
            "expected?",
            {
                "A": f"max by (fleet, robot, check) (ros_diagnostics_check_state{{{_ROBOT}}})",
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
            empty=tables.Empty("No checks", f"ros_diagnostics_robot_up{{{_ROBOT}}}", "check"),
        )
        .height(7)
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
            {"A": f"({level} == 2) + 4 or ({level} == 3) - 1 or {level}"},  # a level's rank
            [tables.STATE, Column("group", "Group")],
            empty=tables.Empty(
                "Its messages are not aggregated", f"ros_diagnostics_robot_up{{{_ROBOT}}}", "group"
            ),
        )
        .height(7)
        .span(12)
    )


# --- Key-values, with their thresholds from fleet.yml as dashed lines. The legend ends with the
# unit, by which the axis gets Grafana's unit; values with a metric of their own have its name. ---

_BATTERY = 'component=~"(?i).*batter.*", key=~"(?i).*(level|charge|percent|soc).*"'
_CHARGE = f'{_BATTERY}, unit=~"%|"'
_OF_BATTERIES = f"{_COMPONENTS}, {_BATTERY}"


def _value(matchers: str) -> str:
    family = f"ros_diagnostics_component_value{{{_COMPONENTS}, {matchers}}}"
    return f"max by (component, key, unit) ({family})"


def _threshold(matchers: str) -> str:
    family = f"ros_diagnostics_component_value_threshold{{{_COMPONENTS}, {matchers}}}"
    return f"max by (component, key, unit, bound, severity) ({family})"


def batteries() -> timeseries.Panel:
    """Show the charge of the batteries."""
    # A metric of its own has Prometheus' unit: a ratio of 0 to 1.
    ratio = promoted(_OF_BATTERIES).replace("{", '{__name__=~".+_ratio", ', 1)
    percent = label(f"max by (component, key) ({ratio}) * 100", "unit", "%")
    return _values(
        "Batteries",
        "How full are the batteries? Dashed: the thresholds of fleet.yml.",
        f"{_value(_CHARGE)} or on (component, key) {percent}",
        _threshold(_CHARGE),
        "No data of the charge of a battery",
    ).min(0)


def temperatures() -> timeseries.Panel:
    """Show the temperatures."""
    degrees = 'unit=~"degC|degF|K"'
    celsius = promoted(_COMPONENTS).replace("{", '{__name__=~".+_celsius", ', 1)
    of_metrics = label(f"max by (component, key) ({celsius})", "unit", "degC")
    return _values(
        "Temperatures",
        "What becomes too hot? Dashed: the thresholds of fleet.yml.",
        f"{_value(degrees)} or on (component, key) {of_metrics}",
        _threshold(degrees),
        "No data of a temperature",
    )


def values_without_unit() -> timeseries.Panel:
    """Show the numbers without a unit, except for the charge of batteries."""
    without = 'unit=""'
    return _values(
        "Values without a unit",
        "How do the other numbers develop, those without a unit?",
        f"{_value(without)} unless {_value(_CHARGE)}",
        f"{_threshold(without)} unless {_threshold(_CHARGE)}",
        "No data without a unit",
    )


def promoted_values() -> timeseries.Panel:
    """Show the values that have a metric of their own."""
    query = panels.over_time(
        f"max by (component, key, __name__) ({promoted(_COMPONENTS)})",
        "{{component}}: {{key}} ({{__name__}})",
    )
    return panels.graph(
        "Values with a metric of their own",
        "How do the values develop that fleet.yml gives a metric of their own? In its unit.",
        query,
    ).no_value("No data of a value with a metric of its own (fleet.yml)")


def values_by_unit() -> timeseries.Panel:
    """Show the other values: a panel for each unit."""
    panel = _values(
        "Values in $unit",
        "How do the numbers in this unit develop? One panel for each unit.",
        _value('unit="$unit"'),
        _threshold('unit="$unit"'),
        "No data in another unit",
    )
    return panel.repeat("unit").repeat_direction("h").max_per_row(2)


def _values(
    title: str, description: str, expr: str, thresholds: str, nothing: str
) -> timeseries.Panel:
    """Show values in their units, and their thresholds dashed in the colour of the severity."""
    panel = panels.graph(
        title,
        description,
        panels.over_time(with_unit(expr), "{{component}}: {{key}}{{in_unit}}"),
        panels.over_time(
            with_unit(thresholds), "{{severity}} {{bound}}: {{component}} {{key}}{{in_unit}}", "B"
        ),
    ).no_value(nothing)
    for unit, grafana_unit in palette.UNITS.items():
        shown = re.sub("deg(?=[CF])", "°", unit)
        escaped = re.escape(shown).replace("/", r"\/")
        panel = panel.override_by_regexp(f"/ in {escaped}$/", [panels.look("unit", grafana_unit)])
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
    ).override_by_name("silent above", panels.dashed(palette.SILENT.colour))


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
        panels.over_time(f"sum by (fleet, robot) (rate({messages}))", "messages per second"),
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


def messages_lost() -> timeseries.Panel:
    """Show the share of messages that did not arrive."""
    lost = f"max by (fleet, robot) (ros_diagnostics_robot_link_lost_ratio{{{_ROBOT}}})"
    return (
        panels.graph(
            "Messages lost",
            "Which share of the last minute's messages did not arrive? By their sequence numbers; "
            "only where one publisher sends on a topic.",
            panels.over_time(lost, "lost"),
            unit="percentunit",
        )
        .no_value("No data of sequence numbers")
        .min(0)
        .axis_soft_max(0.05)
    )


def delay() -> timeseries.Panel:
    """Show the delay of the messages and its jitter."""
    longest = f"max by (fleet, robot) (ros_diagnostics_robot_link_delay_seconds{{{_ROBOT}}})"
    jitter = f"max by (fleet, robot) (ros_diagnostics_robot_link_jitter_seconds{{{_ROBOT}}})"
    return panels.graph(
        "Delay of the messages",
        "How late did messages arrive? The longest delay of the last minute, beyond the least of "
        "the last ten; and the mean difference from message to message.",
        panels.over_time(longest, "delay"),
        panels.over_time(jitter, "jitter", "B"),
        unit="s",
    ).min(0)


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
    counter = f"ros_diagnostics_robot_rejected_total{{{_ROBOT}}}"
    return (
        tables.joined(
            "Rejected",
            "What of this robot's messages was rejected during the time range, and why?",
            {"A": f"round(sum by (reason) (increase({counter}[$__range]))) > 0"},
            [Column("reason", "Reason"), Column("A", "Count")],
            empty=tables.Empty(
                "Nothing was rejected", f"ros_diagnostics_robot_up{{{_ROBOT}}}", "reason"
            ),
            sort=("Count",),
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
            {"A": f"ros_diagnostics_robot_info{{{_ROBOT}}}"},
            [Column(name, title) for name, title in titles.items()],
            sort=("Robot",),
        )
        .height(8)
        .span(12)
    )
