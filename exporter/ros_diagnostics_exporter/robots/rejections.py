"""What is rejected and why: counted every time, logged once; and why a robot is silent.

docs/metrics.md explains each reason to operators; a test compares the two.
"""

from __future__ import annotations

import logging
from collections import Counter, OrderedDict
from collections.abc import Callable, Iterable, Sequence
from typing import Literal, TypeVar, get_args

from ros_diagnostics_exporter.model import Instant, Status, Topic, place

log = logging.getLogger(__name__)

SilentReason = Literal[
    "never_seen",
    "publisher_gone",
    "mute",
    "undecodable",
    "wrong_type",
    "incompatible_qos",
    "unreachable",
    "domain_unreachable",
    "uplink_down",
]
# The silent reason of robots that are rejected by a limit: nothing else is known about them.
OVER_LIMIT = "limit"
SeriesLimitReason = Literal["series_limit", "robot_series_limit"]
RejectionReason = Literal[
    "undecodable",
    "bad_level",
    "duplicate_component",
    "component_limit",
    "value_limit",
    "series_limit",
    "robot_series_limit",
    "label_length",
    "unit_changed",
    "rate",
]
REASONS: tuple[RejectionReason, ...] = get_args(RejectionReason)
LOG_TEXTS: dict[RejectionReason, str] = {
    "undecodable": "a message is no DiagnosticArray",
    "bad_level": "a level above 3 counts as ERROR",
    "duplicate_component": "nodes, or one array, publish a component twice: the worse counts",
    "component_limit": "components or groups beyond limits.components are rejected",
    "value_limit": "values of a component beyond limits.values are rejected",
    "series_limit": "limits.series is reached, new series are rejected",
    "robot_series_limit": "values beyond limits.robot_series are rejected",
    "label_length": "a text is too long and is truncated",
    "unit_changed": "a value in another unit than at first is rejected",
    "rate": "messages beyond a topic's share are dropped",
}
# Of what belongs to no known robot.
FleetRejectionReason = Literal[
    "no_robot",
    "duplicate_robot",
    "robot_limit",
    "new_robots",
    "series_limit",
    "label_length",
    "rate",
    "wrong_type",
]
_ROBOT_LOG_TEXTS: dict[FleetRejectionReason, str] = {
    "duplicate_robot": "that name is taken",
    "robot_limit": "the limit of robots is reached",
    "new_robots": "too many new ones are found, it is found later",
    "series_limit": "the limit of series is reached",
}

Reject = Callable[[RejectionReason, str], None]  # takes the reason and the name of what is rejected
Key = TypeVar("Key")

MAX_REJECTED = 10_000  # rejected robots that are known, so that each is counted once
MAX_OVER_LIMIT = 1_000  # of them, the latest that a limit rejects: these have a series each
MAX_LINES = 100  # log lines about rejected robots, a minute
MINUTE = 60.0


class FleetRejections:
    """What belongs to no known robot. ``over_limit``: robots rejected by a limit, latest last."""

    def __init__(self) -> None:
        self.counts = Counter[str](dict.fromkeys(get_args(FleetRejectionReason), 0))
        self.over_limit: OrderedDict[str, None] = OrderedDict()
        self._robots: OrderedDict[tuple[Topic, str], None] = OrderedDict()
        self._logged: set[tuple[Topic, FleetRejectionReason]] = set()  # of shared topics
        self._lines_since = float("-inf")
        self._lines = 0

    def reset(self) -> None:
        """Log everything again, after a new config. The counts stay."""
        self._robots.clear()
        self._logged.clear()
        self.over_limit.clear()
        self._lines_since = float("-inf")

    def reject_robot(
        self, topic: Topic, name: str, reason: FleetRejectionReason, now: Instant, why: str = ""
    ) -> None:
        """Reject a robot: it is counted and logged once, with ``why`` or the reason's own text.

        Beyond MAX_REJECTED robots the oldest are counted again, so that a new one always counts;
        beyond MAX_LINES a minute they are only counted.
        """
        if (topic, name) in self._robots:
            return
        _put(self._robots, (topic, name), MAX_REJECTED)
        self.counts[reason] += 1
        if reason in {"robot_limit", "series_limit"}:
            _put(self.over_limit, name, MAX_OVER_LIMIT)
        if self._may_log(now):
            log.warning(
                "robot %r on topic %s in %s is rejected: %s. Change fleet.yml: another "
                "name, an exclude pattern, or higher limits",
                name,
                topic.name,
                place(topic.domain_id),
                why or _ROBOT_LOG_TEXTS[reason],
            )

    def accept_robot(self, topics: Iterable[Topic], name: str) -> None:
        """Note that a robot is no longer rejected."""
        self.over_limit.pop(name, None)
        for topic in topics:
            self._robots.pop((topic, name), None)

    def _may_log(self, now: Instant) -> bool:
        if now.mono - self._lines_since >= MINUTE:
            self._lines_since, self._lines = now.mono, 0
        self._lines += 1
        if self._lines == MAX_LINES + 1:
            log.warning(
                "more than %d robots were rejected within a minute: further ones are counted in "
                "exporter_rejected_total, and logged again a minute after the first",
                MAX_LINES,
            )
        return self._lines <= MAX_LINES

    def reject_long_text(self, topic: Topic) -> None:
        """Count a text on a shared topic that was truncated."""
        self.counts["label_length"] += 1
        if self._is_first(topic, "label_length"):
            log.warning(
                "a text on the shared topic %s in %s is too long and is truncated; logged "
                "once, counted in exporter_rejected_total as label_length",
                topic.name,
                place(topic.domain_id),
            )

    def reject_statuses(self, topic: Topic, statuses: Sequence[Status]) -> None:
        """Count statuses of a shared topic that name no robot."""
        self.counts["no_robot"] += len(statuses)
        if self._is_first(topic, "no_robot"):
            log.warning(
                "a status on the shared topic %s in %s names no robot: name %.80r, "
                "hardware_id %.80r; logged once, counted in exporter_rejected_total as no_robot. "
                "Change `by` or `pattern` of fleet.yml, or mend the driver",
                topic.name,
                place(topic.domain_id),
                statuses[0].name,
                statuses[0].hardware_id,
            )

    def _is_first(self, topic: Topic, reason: FleetRejectionReason) -> bool:
        if (topic, reason) in self._logged:
            return False
        self._logged.add((topic, reason))
        return True


def _put(known: OrderedDict[Key, None], key: Key, limit: int) -> None:
    """Add a key as the latest; beyond ``limit`` keys the oldest is removed."""
    known[key] = None
    known.move_to_end(key)
    if len(known) > limit:
        known.popitem(last=False)
