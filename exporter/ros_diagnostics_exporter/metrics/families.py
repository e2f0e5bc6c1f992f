"""THE table of every family that the exporter serves: name, type, help, labels.

The exposition renders from it, docs/reference/metrics.md is generated from it, and the tests
compare rules and dashboards with it. Naming follows https://prometheus.io/docs/practices/naming/.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ros_diagnostics_exporter.model import Part

PREFIX = "ros_diagnostics_"

# ``exporter`` is the name of fleet.yml; without one the label is absent.
EXPORTER = ("fleet", "exporter")
ROBOT = ("fleet", "robot")
COMPONENT = (*ROBOT, "group", "component")


class Family(NamedTuple):
    """One metric family; ``labels`` in the order in which they are rendered.

    ``name`` is the full name, for a counter with its ``_total``. ``open`` families carry, beyond
    ``labels``, those that fleet.yml gives a robot. ``part`` is what ``collect[]`` calls it.
    """

    name: str
    type: str
    help: str
    labels: tuple[str, ...]
    open: bool = False
    part: Part = Part.ROBOTS


def _family(name: str, kind: str, help_: str, labels: tuple[str, ...], **more: Any) -> Family:
    return Family(PREFIX + name, kind, help_, labels, **more)


ROBOT_INFO = _family(
    "robot_info",
    "gauge",
    "1 for every known robot, with its labels; also for one that was never received. domain_id is "
    "none for what has no place in ROS, such as an access point.",
    (*ROBOT, "exporter", "ros_namespace", "domain_id", "topic", "profile", "address"),
    open=True,
    part=Part.FAULTS,
)
ROBOT_UP = _family(
    "robot_up",
    "gauge",
    "1 while messages arrive, 0 while the robot is silent or was never received. A robot of "
    "queries alone is up from its first answer on.",
    (*ROBOT, "exporter"),
    part=Part.FAULTS,
)
ROBOT_SILENT_REASON = _family(
    "robot_silent_reason",
    "gauge",
    "Why a robot is not up: the present reason is 1, earlier ones are 0 (never_seen, "
    "publisher_gone, mute, undecodable, wrong_type, incompatible_qos, unreachable, "
    "domain_unreachable, uplink_down, limit).",
    (*ROBOT, "reason"),
    part=Part.FAULTS,
)
ROBOT_STATE = _family(
    "robot_state",
    "gauge",
    "How urgent the robot is, by what is received, confirmed or not, and by its faults: -1 "
    "PENDING, 0 OK, 1 WARNING, 1.5 FLAPPING, 2 STALE, 3 UNREACHABLE, 5 SILENT, 6 CRITICAL.",
    ROBOT,
    part=Part.FAULTS,
)
ROBOT_FLAPPING = _family(
    "robot_flapping",
    "gauge",
    "1 while the robot's state is FLAPPING; part is what availability counts its time as: warning, "
    "silent or critical. Absent otherwise.",
    (*ROBOT, "part"),
    part=Part.FAULTS,
)
ROBOT_LAST_MESSAGE = _family(
    "robot_last_message_timestamp_seconds",
    "gauge",
    "When the last message was received (Unix time); 0 = never.",
    ROBOT,
)
ROBOT_STALE_AFTER = _family(
    "robot_stale_after_seconds",
    "gauge",
    "Silence after which the robot counts as silent, from the config.",
    ROBOT,
)
ROBOT_MAINTENANCE = _family(
    "robot_maintenance",
    "gauge",
    "1 during a planned downtime, of fleet.yml or a person's.",
    ROBOT,
    part=Part.FAULTS,
)
ROBOT_MESSAGES = _family("robot_messages_total", "counter", "Diagnostic arrays received.", ROBOT)
ROBOT_MESSAGE_BYTES = _family(
    "robot_message_bytes_total", "counter", "Serialized bytes of the arrays received.", ROBOT
)
ROBOT_PUBLISHERS = _family(
    "robot_publishers", "gauge", "Publishers now on the robot's topics.", ROBOT
)
ROBOT_CLOCK_OFFSET = _family(
    "robot_clock_offset_seconds",
    "gauge",
    "Receive time minus header.stamp of the last array that had one; transport delay included.",
    ROBOT,
)
ROBOT_LINK_LOST = _family(
    "robot_link_lost_ratio",
    "gauge",
    "Share of the last minute's messages that are missing, by their sequence numbers. Absent if no "
    "topic of the robot has exactly one publisher.",
    ROBOT,
)
ROBOT_LINK_DELAY = _family(
    "robot_link_delay_seconds",
    "gauge",
    "Longest delay of a message in the last minute, above the least of the last ten.",
    ROBOT,
)
ROBOT_LINK_JITTER = _family(
    "robot_link_jitter_seconds",
    "gauge",
    "Mean difference of the delays of two successive messages, as RFC 3550 computes it.",
    ROBOT,
)
ROBOT_LINK_CLOCK = _family(
    "robot_link_clock_offset_seconds",
    "gauge",
    "The smallest receive time minus send time among the last minute's messages. Above zero, the "
    "robot's clock is behind the exporter's by at most this. Below zero, it is ahead by at least "
    "this.",
    ROBOT,
)
ROBOT_WATCHED = _family(
    "robot_watch_bytes_per_second",
    "gauge",
    "Bytes per second that are received beside diagnostics, by `watch` and `topics` of fleet.yml, "
    "over the last minute. Of a topic that all robots of a domain share, the robot's share.",
    ROBOT,
)
ROBOT_EXPECTED_NODES = _family(
    "robot_expected_nodes",
    "gauge",
    "Nodes that are expected in the ROS graph, learned or by fleet.yml; whether they are there or "
    "not.",
    ROBOT,
)
ROBOT_REJECTED = _family(
    "robot_rejected_total",
    "counter",
    "Messages and parts of messages that were rejected, by reason; every reason from 0 on.",
    (*ROBOT, "reason"),
)
ROBOT_REJECTED_AT = _family(
    "robot_last_rejected_timestamp_seconds",
    "gauge",
    "When something of the robot was last rejected (Unix time), by reason; absent until then.",
    (*ROBOT, "reason"),
    open=True,
)
CHECK_COMPONENTS = _family(
    "check_components",
    "gauge",
    "Components that match the check and stand at the level (ok, warn, error, stale).",
    (*ROBOT, "check", "level"),
)
CHECK_STATE = _family(
    "check_state",
    "gauge",
    "The worst level of the components that match the check, as robot_state; 6 where they are too "
    "few.",
    (*ROBOT, "check"),
)
CHECK_EXPECTED = _family(
    "check_expected_components",
    "gauge",
    "How many components the config expects the check to find.",
    (*ROBOT, "check"),
)
CAPABILITY_STATE = _family(
    "capability_state",
    "gauge",
    "What a robot can do, by fleet.yml: 0 OK, 1 no reserve, 2 degraded, 3 lost, 4 unknown.",
    (*ROBOT, "capability"),
)
COMPONENT_LEVEL = _family(
    "component_level",
    "gauge",
    "0 OK, 1 WARN, 2 ERROR, 3 STALE, after the config's overrides; leaves only.",
    COMPONENT,
)
COMPONENT_STATE = _family(
    "component_state",
    "gauge",
    "How urgent the component is, as robot_state, where that is not OK; absent otherwise, and "
    "where a condition or shadow mode suppresses it.",
    COMPONENT,
    part=Part.FAULTS,
)
COMPONENT_SINCE = _family(
    "component_since_timestamp_seconds",
    "gauge",
    "When the current level began (Unix time).",
    COMPONENT,
)
COMPONENT_PROBLEM_SINCE = _family(
    "component_problem_since_timestamp_seconds",
    "gauge",
    "When the component left OK (Unix time); absent while it is OK.",
    COMPONENT,
)
COMPONENT_CHANGES = _family(
    "component_changes_total",
    "counter",
    "Changes of level, also those between two scrapes.",
    COMPONENT,
)
COMPONENT_FLAP_RATIO = _family(
    "component_flap_ratio",
    "gauge",
    "Weighted share of changes over the last 21 states, as Nagios computes it; absent at 0.",
    COMPONENT,
)
COMPONENT_STALE_AFTER = _family(
    "component_stale_after_seconds",
    "gauge",
    "The `stale_after` of its entry in the profile, only where it differs from the robot's.",
    COMPONENT,
)
COMPONENT_PLANNED_STALE = _family(
    "component_planned_stale",
    "gauge",
    "1 while the component is STALE as planned in fleet.yml, so that nobody is notified.",
    COMPONENT,
)
COMPONENT_MAINTENANCE = _family(
    "component_maintenance",
    "gauge",
    "1 during a planned downtime of the component alone; absent otherwise.",
    COMPONENT,
)
COMPONENT_MESSAGE = _family(
    "component_message_info",
    "gauge",
    "1 with the component's message, while it is not OK. A new message that differs only in digits "
    "does not replace it. If the component no longer reports, the message says so, with the last "
    "one.",
    (*COMPONENT, "message"),
)
COMPONENT_SUPPRESSED = _family(
    "component_suppressed",
    "gauge",
    "1 while a fault of the component does not begin because another fault says it: of a component "
    "that it depends on (depends_on), or of a capability that needs it (capability).",
    (*COMPONENT, "reason"),
)
COMPONENT_INFO = _family(
    "component_info", "gauge", "1 with the status' hardware_id.", (*COMPONENT, "hardware_id")
)
COMPONENT_VALUE = _family(
    "component_value",
    "gauge",
    "A key-value that is a number, in the unit of the driver or of fleet.yml; absent while STALE, "
    "and where it has a `metric` and no threshold.",
    (*COMPONENT, "key", "unit"),
)
COMPONENT_VALUE_THRESHOLD = _family(
    "component_value_threshold",
    "gauge",
    "The config's threshold (low, high) for a value, by severity (warning, critical).",
    (*COMPONENT, "key", "unit", "bound", "severity"),
)
GROUP_LEVEL = _family(
    "group_level",
    "gauge",
    "A parent's level as the robot's own aggregator reported it.",
    (*ROBOT, "group"),
)
GOALS = _family(
    "goals_total",
    "counter",
    "Goals of a robot's action servers by how they ended (succeeded, aborted, cancelled, "
    "preempted, unknown); `mission` is true where fleet.yml says that they are the robot's work.",
    (*ROBOT, "action", "result", "mission"),
)
GOALS_RUNNING = _family(
    "goals_running",
    "gauge",
    "Goals that have not ended; 0 while their server is not in the ROS graph.",
    (*ROBOT, "action"),
)
GOAL_DURATION = _family(
    "goal_duration_seconds",
    "histogram",
    "How long goals took whose begin and end were seen, of actions that fleet.yml names.",
    (*ROBOT, "action"),
)
INTERVENTIONS = _family(
    "interventions_total",
    "counter",
    "How often a robot left autonomous before its goal had succeeded, or was stopped there.",
    ROBOT,
)
AUTONOMOUS_SECONDS = _family(
    "autonomous_seconds_total", "counter", "Time in which a robot worked by itself.", ROBOT
)
MISSION_FAMILIES = (GOALS, GOALS_RUNNING, GOAL_DURATION, INTERVENTIONS, AUTONOMOUS_SECONDS)
SITE_RECEIVED = _family(
    "site_received_robots",
    "gauge",
    "Robots of a site that are received. Of a pair, the exporter that receives most of them "
    "counts.",
    (*EXPORTER, "site"),
    part=Part.FAULTS,
)
FLEET_COMPONENTS = _family(
    "fleet_components",
    "gauge",
    "Components of all robots that stand at the level (ok, warn, error, stale).",
    (*EXPORTER, "level"),
)
FLEET_CAPABILITY_STATE = _family(
    "fleet_capability_state",
    "gauge",
    "What the fleet can do, by fleet.yml: 0 OK, 1 no reserve, 2 degraded, 3 lost, 4 unknown.",
    (*EXPORTER, "capability"),
    part=Part.FAULTS,
)
FLEET_CAPABILITY_ROBOTS = _family(
    "fleet_capability_robots",
    "gauge",
    "Robots that the capability needs, by how well they can do their part: ok, degraded, lost, "
    "unknown, or in maintenance.",
    (*EXPORTER, "capability", "state"),
    part=Part.FAULTS,
)
DOWNTIME_END = _family(
    "downtime_end_timestamp_seconds",
    "gauge",
    "When an active downtime ends (Unix time), +Inf if it has no end. The labels have its name in "
    "fleet.yml, or the comment and name of the person who planned it, and its first robots.",
    (*EXPORTER, "downtime", "author", "site", "team", "robots"),
    part=Part.FAULTS,
)
ROBOT_DOWNTIME_END = _family(
    "robot_downtime_end_timestamp_seconds",
    "gauge",
    "When the downtime that a robot is in ends (Unix time), +Inf if it has no end; of several the "
    "last one.",
    (*ROBOT, "downtime", "author"),
    part=Part.FAULTS,
)
FLEET_FAMILIES = (
    ROBOT_INFO,
    ROBOT_UP,
    ROBOT_SILENT_REASON,
    ROBOT_LAST_MESSAGE,
    ROBOT_STALE_AFTER,
    ROBOT_STATE,
    ROBOT_FLAPPING,
    ROBOT_MAINTENANCE,
    ROBOT_MESSAGES,
    ROBOT_MESSAGE_BYTES,
    ROBOT_PUBLISHERS,
    ROBOT_CLOCK_OFFSET,
    ROBOT_LINK_LOST,
    ROBOT_LINK_DELAY,
    ROBOT_LINK_JITTER,
    ROBOT_LINK_CLOCK,
    ROBOT_WATCHED,
    ROBOT_EXPECTED_NODES,
    ROBOT_REJECTED,
    ROBOT_REJECTED_AT,
    CHECK_COMPONENTS,
    CHECK_STATE,
    CHECK_EXPECTED,
    CAPABILITY_STATE,
    COMPONENT_LEVEL,
    COMPONENT_STATE,
    COMPONENT_SINCE,
    COMPONENT_PROBLEM_SINCE,
    COMPONENT_CHANGES,
    COMPONENT_FLAP_RATIO,
    COMPONENT_STALE_AFTER,
    COMPONENT_PLANNED_STALE,
    COMPONENT_MAINTENANCE,
    COMPONENT_MESSAGE,
    COMPONENT_SUPPRESSED,
    COMPONENT_INFO,
    COMPONENT_VALUE,
    COMPONENT_VALUE_THRESHOLD,
    GROUP_LEVEL,
    *MISSION_FAMILIES,
)

FAULT = (
    *(*EXPORTER, "fault", "scope", "state", "severity", "site"),
    *("robot", "group", "component", "check", "key", "bound"),
)
FAULT_START = _family(
    "fault_start_timestamp_seconds",
    "gauge",
    "When the problem of a fault began (Unix time). The evidence has the details at its "
    "confirmation, and what the robot can no longer do. Present until the fault ends. After a "
    "restart it is absent until the fault is confirmed anew.",
    (*FAULT, "evidence"),
    open=True,
    part=Part.FAULTS,
)

FAULT_MEMBER = _family(
    "fault_member",
    "gauge",
    "1 for each robot that a silent site or a fleet's capability is about, and for each component "
    "of a robot that is one of many with a common cause, or keeps a capability from being OK.",
    (*EXPORTER, "fault", "robot", "group", "component"),
    part=Part.FAULTS,
)

FAULT_ACKNOWLEDGED = _family(
    "fault_acknowledged_timestamp_seconds",
    "gauge",
    "When a fault that lasts was acknowledged (Unix time), with the person's name and comment. "
    "Only with --alertmanager.url.",
    (*FAULT, "author", "comment"),
    open=True,
    part=Part.FAULTS,
)

FAULT_NOTIFIED = _family(
    "fault_notified_timestamp_seconds",
    "gauge",
    "When Alertmanager last sent a notification of a fault that lasts to a receiver (Unix time). "
    "If it sent none, 0 without a receiver. Only if it posts them to /api/v1/notifications.",
    (*FAULT, "receiver"),
    open=True,
)

FAULT_END = _family(
    "fault_end_timestamp_seconds",
    "gauge",
    "When a fault ended (Unix time). The reason says whether it recovered or a person removed it. "
    "The evidence has the message that ended it, when, and how long it lasted. Present for an "
    "hour, or until the fault begins again. If it has a robot and no fault, a person removed this "
    "robot.",
    (*FAULT, "reason", "evidence"),
    open=True,
    part=Part.FAULTS,
)

FAULT_FAMILIES = (
    FAULT_START,
    FAULT_MEMBER,
    FAULT_END,
    SITE_RECEIVED,
    FLEET_COMPONENTS,
    FLEET_CAPABILITY_STATE,
    FLEET_CAPABILITY_ROBOTS,
    DOWNTIME_END,
    ROBOT_DOWNTIME_END,
    FAULT_ACKNOWLEDGED,
    FAULT_NOTIFIED,
)
