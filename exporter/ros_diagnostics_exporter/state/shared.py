"""Several robots on one topic: which status belongs to which of them. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from ros_diagnostics_exporter.config.fleet import Robot, Shared, Source
from ros_diagnostics_exporter.ingest.tree import TreeReader
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.state.rules import shared_identity


class Splitter:
    """Parts the arrays of one shared topic by the robots that its statuses name."""

    def __init__(self, settings: Shared) -> None:
        self.settings = settings
        self._tree = TreeReader()

    def split(self, statuses: Sequence[Status]) -> tuple[dict[str, list[Status]], list[Status]]:
        """(robot -> its statuses, those that name no robot).

        What a robot gets of an aggregated array is a whole array again: for each group a header,
        then the robot's components of that group.
        """
        if self.settings.raw:
            return self._part([("", status) for status in statuses], headers=False)
        structure = self._tree.read(statuses)
        leaves = [
            (leaf.group, statuses[leaf.rows[0]]._replace(name=leaf.component))
            for leaf in structure.leaves
        ]
        return self._part(leaves, headers=True)

    def robot(self, name: str) -> Robot:
        """The settings of a robot that was found on the topic."""
        settings = self.settings
        return Robot(
            name=name,
            domain_id=settings.domain_id,
            namespace=settings.topic.rpartition("/")[0],
            topic_agg=None if settings.raw else settings.topic,
            topic_raw=settings.topic if settings.raw else None,
            source=Source.RAW if settings.raw else Source.AGG,
            profile=settings.profile,
            labels=settings.labels,
        )

    def _part(
        self, statuses: Sequence[tuple[str, Status]], *, headers: bool
    ) -> tuple[dict[str, list[Status]], list[Status]]:
        found: dict[str, dict[str, list[Status]]] = {}
        unknown: list[Status] = []
        for group, status in statuses:
            named = shared_identity(self.settings, status.hardware_id, status.name)
            if named is None:
                unknown.append(status)
                continue
            robot, component = named
            own = status._replace(name=component)
            found.setdefault(robot, {}).setdefault(group, []).append(own)
        parts = {
            robot: [
                row
                for group, own in groups.items()
                for row in (_with_header(group, own) if headers else own)
            ]
            for robot, groups in found.items()
        }
        return parts, unknown


def _with_header(group: str, statuses: Sequence[Status]) -> list[Status]:
    header = Status(0, group, "", "", tuple((each.name, each.message) for each in statuses))
    rows = [each._replace(name=f"{group}/{each.name.replace('/', ' ')}") for each in statuses]
    return [header, *rows]
