"""What belongs to no known robot and is not taken in: counted, and each thing said once."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Sequence

from ros_diagnostics_exporter.diagnostics import Status
from ros_diagnostics_exporter.state.network import Topic
from ros_diagnostics_exporter.state.reasons import FleetRejection

log = logging.getLogger(__name__)

MOST_REFUSALS = 1_000  # robots remembered, so that each is said and counted once


class Refusals:
    """The fleet's refusals; ``shut_out`` are robots for which the limits leave no room."""

    def __init__(self) -> None:
        self.rejected: Counter[str] = Counter()
        self.shut_out: set[str] = set()
        self._robots: set[tuple[Topic, str]] = set()
        self._said: set[tuple[Topic, FleetRejection]] = set()  # of shared topics

    def start_over(self) -> None:
        """Say again what there is to say: the config is another. What was counted stays."""
        self._robots.clear()
        self._said.clear()
        self.shut_out.clear()

    def robot(self, topic: Topic, name: str, reason: FleetRejection, why: str) -> bool:
        """Refuse a robot; False if that is known, or more are known than are remembered."""
        if (topic, name) in self._robots or len(self._robots) >= MOST_REFUSALS:
            return False
        self._robots.add((topic, name))
        self.rejected[reason] += 1
        log.warning(
            "robot %r on topic %s in domain %d is not taken in: %s. Change fleet.yml: another "
            "name, an exclude pattern, or higher limits",
            name,
            topic.name,
            topic.domain_id,
            why,
        )
        return True

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
