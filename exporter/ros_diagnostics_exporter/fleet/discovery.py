"""From a topic, or from a status on a topic that robots share, to the robot. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from ros_diagnostics_exporter.config.fleet import Discovery, Robot, Shared, Source, topics_of
from ros_diagnostics_exporter.config.patterns import ROBOT
from ros_diagnostics_exporter.config.scalars import is_name
from ros_diagnostics_exporter.model import Domain, Status
from ros_diagnostics_exporter.robots.rules import SEARCHED
from ros_diagnostics_exporter.robots.tree import TreeReader

# -- a topic of its own ----------------------------------------------------------------------


def robot_name(discovery: Discovery, topic: str, domain_id: Domain) -> str | None:
    """The name of the robot of a topic; None where the discovery does not want it."""
    name = _matched(discovery, topic, domain_id)
    if name is None:
        return None
    return name if _is_included(discovery, name) and not _is_excluded(discovery, name) else None


def takes(discovery: Discovery, topic: str, domain_id: Domain) -> bool:
    """Whether a discovery wants a topic, or leaves its robot out by ``exclude``."""
    name = _matched(discovery, topic, domain_id)
    return name is not None and (_is_excluded(discovery, name) or _is_included(discovery, name))


def leaves_out(discovery: Discovery, topic: str, domain_id: Domain) -> bool:
    """Whether a discovery leaves the robot of a topic out by ``exclude``."""
    name = _matched(discovery, topic, domain_id)
    return name is not None and _is_excluded(discovery, name)


def _matched(discovery: Discovery, topic: str, domain_id: Domain) -> str | None:
    """The name that a discovery gives the robot of a topic, wanted or not; None without a match."""
    match = discovery.pattern.fullmatch(topic)
    if match is None or domain_id not in discovery.domain_ids:
        return None
    return _fill(discovery.name, match.groupdict().get("robot") or "", domain_id)


def found_robot(discovery: Discovery, name: str, topic: str, domain_id: Domain) -> Robot:
    """The settings of the robot of this name behind a topic, its other topic included."""
    aggregate, raw = topics_of(topic, discovery.source)
    address, is_none = discovery.address, discovery.source is Source.NONE
    return Robot(
        name=name,
        domain_id=domain_id,
        namespace=namespace_of(discovery, topic),
        topic=topic if is_none else None,
        topic_agg=aggregate,
        topic_raw=raw,
        source=discovery.source,
        profile=discovery.profile,
        address=None if address is None else _fill(address, name, domain_id),
        labels=discovery.labels,
    )


def namespace_of(discovery: Discovery, topic: str) -> str:
    """The namespace of the robot behind a topic; of any topic of it, what ends with its name."""
    if discovery.source is Source.NONE:
        parts = discovery.template.split("/")
        count = next((at for at, part in enumerate(parts) if ROBOT in part), None)
        if count is not None:
            return "/".join(topic.split("/")[: count + 1])
    return topic.rpartition("/")[0]


def end_of_topic(discovery: Discovery) -> str:
    """The end of the names of any topics that a discovery looks for; "" of one of diagnostics."""
    if discovery.source is not Source.NONE:
        return ""
    _before, _robot, after = discovery.template.rpartition(ROBOT)
    return after.partition("/")[2]


def _is_included(discovery: Discovery, name: str) -> bool:
    included = discovery.include
    return not included or any(pattern.fullmatch(name) for pattern in included)


def _is_excluded(discovery: Discovery, name: str) -> bool:
    return any(pattern.fullmatch(name) for pattern in discovery.exclude)


def _fill(template: str, robot: str, domain_id: Domain) -> str:
    return template.replace("{robot}", robot).replace("{domain_id}", str(domain_id))


# -- a shared topic --------------------------------------------------------------------------


class SharedTopic:
    """Splits the arrays of one shared topic by the robots that its statuses name."""

    def __init__(self, settings: Shared) -> None:
        self.settings = settings
        self._tree = TreeReader()

    def split(self, statuses: Sequence[Status]) -> tuple[dict[str, list[Status]], list[Status]]:
        """(robot -> its statuses, those that name no robot).

        What a robot gets of an aggregated array is a whole array again: for each group a header,
        then the robot's components of that group.
        """
        if self.settings.raw:
            return self._split([("", status) for status in statuses], headers=False)
        structure = self._tree.read(statuses)
        leaves = [
            (leaf.group, statuses[leaf.rows[0]]._replace(name=leaf.component))
            for leaf in structure.leaves
        ]
        return self._split(leaves, headers=True)

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

    def _split(
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
            renamed = status._replace(name=component)
            found.setdefault(robot, {}).setdefault(group, []).append(renamed)
        parts = {
            robot: [
                row
                for group, rows in groups.items()
                for row in (_with_header(group, rows) if headers else rows)
            ]
            for robot, groups in found.items()
        }
        return parts, unknown


def shared_identity(shared: Shared, hardware_id: str, name: str) -> tuple[str, str] | None:
    """The names of the robot and the component that a status on a shared topic belongs to.

    None where the status names no robot.
    """
    identity = hardware_id if shared.by == "hardware_id" else name
    if shared.pattern is None:
        return (identity, name) if is_name(identity) else None
    match = shared.pattern.fullmatch(identity) if len(identity) <= SEARCHED else None
    if match is None or not is_name(match["robot"] or ""):
        return None
    return match["robot"], match.groupdict().get("component") or name


def _with_header(group: str, statuses: Sequence[Status]) -> list[Status]:
    header = Status(0, group, "", "", tuple((each.name, each.message) for each in statuses))
    rows = [each._replace(name=f"{group}/{each.name.replace('/', ' ')}") for each in statuses]
    return [header, *rows]
