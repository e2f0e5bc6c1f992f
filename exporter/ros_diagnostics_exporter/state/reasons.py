"""The words for why nothing is heard of a robot, and why something was not taken in.

docs/metrics.md explains each of them to operators; a test compares the two.
"""

from __future__ import annotations

from typing import Literal

Silence = Literal[
    "never_seen", "publisher_gone", "mute", "undecodable", "wrong_type", "domain_unreachable"
]
# Of a robot that the limits keep out nothing else is known.
SHUT_OUT = "limit"
Rejection = Literal[
    "undecodable",
    "bad_level",
    "component_limit",
    "value_limit",
    "series_limit",
    "robot_series_limit",
    "label_length",
    "unit_changed",
    "rate",
]
# What is said of them in the log.
TOLD: dict[Rejection, str] = {
    "undecodable": "a message is no DiagnosticArray",
    "bad_level": "a level above 3 counts as ERROR",
    "component_limit": "more components or groups than limits.components are left out",
    "value_limit": "more values of a component than limits.values are left out",
    "series_limit": "limits.series is reached, what is new is left out",
    "robot_series_limit": "more values than limits.robot_series are left out",
    "label_length": "a text is too long and is cut",
    "unit_changed": "a value in another unit than at first is left out",
    "rate": "messages beyond a topic's share are dropped",
}
# Of what belongs to no known robot.
FleetRejection = Literal[
    "no_robot", "duplicate_robot", "robot_limit", "series_limit", "label_length", "rate"
]
