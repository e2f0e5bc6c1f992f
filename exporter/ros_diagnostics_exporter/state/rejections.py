"""What belongs to no known robot and is not taken in: counted, and each thing said once."""

from __future__ import annotations

import logging
from collections import Counter, OrderedDict
from collections.abc import Iterable, Sequence
from typing import TypeVar

from ros_diagnostics_exporter.model import Instant, Status
from ros_diagnostics_exporter.state.network import Topic
from ros_diagnostics_exporter.state.reasons import FleetRejection

log = logging.getLogger(__name__)

Key = TypeVar("Key")

MOST_REJECTED = 10_000  # robots that are known to be rejected, so that each is counted once
MOST_SHUT_OUT = 1_000  # of them, the latest that the limits keep out: these have a series each
MOST_LINES = 100  # about rejected robots, a minute
MINUTE = 60.0
_WHY: dict[FleetRejection, str] = {
    "duplicate_robot": "that name is taken",
    "robot_limit": "the limit of robots is reached",
    "series_limit": "the limit of series is reached",
}


class Refusals:
    """The fleet's rejections; ``shut_out`` are robots that the limits keep out, the latest last."""

    def __init__(self) -> None:
        self.rejected: Counter[str] = Counter()
        self.shut_out: OrderedDict[str, None] = OrderedDict()
        self._robots: OrderedDict[tuple[Topic, str], None] = OrderedDict()
        self._said: set[tuple[Topic, FleetRejection]] = set()  # of shared topics
        self._lines_since = float("-inf")
        self._lines = 0

    def start_over(self) -> None:
        """Say again what there is to say: the config is another. What was counted stays."""
        self._robots.clear()
        self._said.clear()
        self.shut_out.clear()
        self._lines_since = float("-inf")

    def robot(self, topic: Topic, name: str, reason: FleetRejection, now: Instant) -> None:
        """Reject a robot: it is counted and logged once.

        Where more are rejected than can be known, the oldest are counted again, so that a newcomer
        always counts; and of more than ``MOST_LINES`` a minute only the number is known.
        """
        if (topic, name) in self._robots:
            return
        _put(self._robots, (topic, name), MOST_REJECTED)
        self.rejected[reason] += 1
        if reason != "duplicate_robot":
            _put(self.shut_out, name, MOST_SHUT_OUT)
        if self._may_log(now):
            log.warning(
                "robot %r on topic %s in domain %d is not taken in: %s. Change fleet.yml: another "
                "name, an exclude pattern, or higher limits",
                name,
                topic.name,
                topic.domain_id,
                _WHY[reason],
            )

    def admitted(self, topics: Iterable[Topic], name: str) -> None:
        """Note that a robot is rejected no longer."""
        self.shut_out.pop(name, None)
        for topic in topics:
            self._robots.pop((topic, name), None)

    def _may_log(self, now: Instant) -> bool:
        if now.mono - self._lines_since >= MINUTE:
            self._lines_since, self._lines = now.mono, 0
        self._lines += 1
        if self._lines == MOST_LINES + 1:
            log.warning(
                "more than %d robots were rejected within a minute: further ones are counted in "
                "exporter_rejected_total, and logged again a minute after the first",
                MOST_LINES,
            )
        return self._lines <= MOST_LINES

    def long(self, topic: Topic) -> None:
        """Refuse the end of a text on a shared topic."""
        self.rejected["label_length"] += 1
        if self._first(topic, "label_length"):
            log.warning(
                "a text on the shared topic %s in domain %d is too long and is cut; said once, "
                "counted in exporter_rejected_total as label_length",
                topic.name,
                topic.domain_id,
            )

    def unknown(self, topic: Topic, statuses: Sequence[Status]) -> None:
        """Refuse statuses of a shared topic that name no robot."""
        self.rejected["no_robot"] += len(statuses)
        if self._first(topic, "no_robot"):
            log.warning(
                "a status on the shared topic %s in domain %d names no robot: name %.80r, "
                "hardware_id %.80r; said once, counted in exporter_rejected_total as no_robot. "
                "Change by or pattern in fleet.yml, or mend the driver",
                topic.name,
                topic.domain_id,
                statuses[0].name,
                statuses[0].hardware_id,
            )

    def _first(self, topic: Topic, reason: FleetRejection) -> bool:
        if (topic, reason) in self._said:
            return False
        self._said.add((topic, reason))
        return True


def _put(known: OrderedDict[Key, None], key: Key, most: int) -> None:
    """Add a key as the latest; of more than ``most`` the oldest goes."""
    known[key] = None
    known.move_to_end(key)
    if len(known) > most:
        known.popitem(last=False)
