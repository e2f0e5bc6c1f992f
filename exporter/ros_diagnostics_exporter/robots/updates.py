"""How arrays update the components of one robot: of its aggregator, its drivers, queries.

What a query of Prometheus measures has an identity with the query's name where others have a
group's path, which begins with a slash, or nothing: so neither a robot nor a restart can take one
for the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.model import Feed, Instant, Status
from ros_diagnostics_exporter.robots.component import STALE, Component, Identity
from ros_diagnostics_exporter.robots.components import Components
from ros_diagnostics_exporter.robots.limits import truncate
from ros_diagnostics_exporter.robots.marks import Mark, Marks
from ros_diagnostics_exporter.robots.rejections import Reject
from ros_diagnostics_exporter.robots.tree import Structure, TreeReader
from ros_diagnostics_exporter.sources.graph import GROUP

MAX_SPLIT_NAMES = 4096  # names of one robot that several components have
_MARK = "query:"


def query_of(identity: Identity) -> str | None:
    """The name of the query that measures a component; None where the robot publishes it."""
    _name, group, _hardware_id = identity
    return group.removeprefix(_MARK) if group.startswith(_MARK) else None


def is_of_graph(identity: Identity) -> bool:
    """Whether it is the ROS graph that shows a component."""
    return query_of(identity) == GROUP


class MeasuredUpdates:
    """Applies the answers of queries: partial, so only a late component is STALE.

    ``answered`` is when each query that measures something of the robot was last answered,
    monotonic, whether or not the answer had anything of it.
    """

    def __init__(self, components: Components) -> None:
        self._components = components
        self.answered: dict[str, float] = {}

    def apply(self, feed: Feed, statuses: Sequence[Status], now: Instant) -> None:
        """Update the components from one answer; their names are unique in it."""
        self.answered[feed.name] = now.mono
        for status in statuses:
            identity = (status.name, _MARK + feed.name, "")
            component = self._components.get_or_add(identity, feed.group, now)
            if component is not None:
                self._components.regroup(component, feed.group)
                self._components.update_measured(component, feed, status, now)

    def restored(self, identity: Identity) -> None:
        """Note that an earlier process had a component of this identity."""
        query = query_of(identity)
        if query is not None:
            self.answered.setdefault(query, float("-inf"))

    def follow(self, feeds: Mapping[str, Feed]) -> list[Component]:
        """Have each component follow its feed, as the config has it; returns those of no feed."""
        for name in self.answered.keys() - feeds.keys():
            del self.answered[name]
        lost = []
        for component in self._components:
            query = query_of(component.identity)
            if query is None:
                continue
            if query == GROUP and component.feed is not None:
                continue  # it says of each report by which feed it is
            if query in feeds:
                self._components.set_feed(component, feeds[query])
            else:
                lost.append(component)
        return lost

    def last_answer(self, component: Component) -> float | None:
        """When the query that measures a component was last answered; None where none does."""
        query = query_of(component.identity)
        return None if query is None else self.answered.get(query, float("-inf"))


class AggregatedUpdates:
    """Applies the arrays of one robot's aggregator: complete, so a missing component is STALE."""

    def __init__(
        self, components: Components, marks: Marks[Component], limits: config.Limits, reject: Reject
    ) -> None:
        self.groups: dict[str, tuple[int, str]] = {}  # path -> (level, message) as reported
        self._components = components
        self._marks = marks
        self._limits = limits
        self._reject = reject
        self._reader = TreeReader()
        self._structure: Structure | None = None
        self._planned_at = -1  # the last change that the plan is made of
        self._plan: list[tuple[Component, tuple[int, ...]]] = []
        self._missing: list[Component] = []
        self._group_rows: list[tuple[int, str]] = []  # with the label of each

    def apply(self, statuses: Sequence[Status], now: Instant) -> None:
        """Update the components from one array."""
        structure = self._reader.read(statuses)
        if structure is not self._structure or self._marks.at[Mark.NAMES] > self._planned_at:
            self._plan_updates(structure, now)
        self._update_groups(statuses)
        for component, rows in self._plan:
            status = statuses[rows[0]]
            if len(rows) > 1:
                status = max((statuses[row] for row in rows), key=_level)
            if status.level == STALE:
                is_old = component.is_on_change and not component.is_stale  # for want of an update
            else:
                is_old = component.raw_received is not None
            if is_old:
                component.listed = now.mono  # received at its source: this is an older copy
            else:
                self._components.update(component, status, now)
        for component in self._missing:
            self._components.mark_missing(component, now)

    def reset(self, limits: config.Limits) -> None:
        """Look the components up again at the next array: the config may want others."""
        self._limits = limits
        self._structure = None

    def _plan_updates(self, structure: Structure, now: Instant) -> None:
        """Find the components of a changed structure, and those that are missing in it."""
        components = self._components
        self._structure = structure
        self._remove_groups(structure)
        length = self._limits.label_length
        self._group_rows = [(row, truncate(path, length)) for row, path in structure.groups]
        self._plan = []
        for leaf in structure.leaves:
            identity = (leaf.component, "" if leaf.exact else leaf.group, "")
            component = components.get_or_add(identity, leaf.group, now)
            if component is not None:
                components.regroup(component, leaf.group)
                self._plan.append((component, leaf.rows))
        self._planned_at = self._marks.count
        listed = {component.identity for component, _rows in self._plan}
        # An aggregator that has just started lists no component yet: none is missing because of
        # that. They become STALE after their own time.
        self._missing = [
            component
            for identity, component in components.by_identity.items()
            if structure.leaves and identity not in listed and component.raw_received is None
        ]

    def _remove_groups(self, structure: Structure) -> None:
        """Remove, without an event, components that prove to be groups."""
        paths = {path for _row, path in structure.groups}
        for (name, group, _id), component in list(self._components.by_identity.items()):
            if group and f"{group}/{name}" in paths:
                self._components.remove(component)

    def _update_groups(self, statuses: Sequence[Status]) -> None:
        groups: dict[str, tuple[int, str]] = {}
        for row, label in self._group_rows:
            level = min(statuses[row].level, STALE)
            if label not in groups and len(groups) >= self._limits.components:
                self._reject("component_limit", label)
                break
            if label not in groups or level > groups[label][0]:
                groups[label] = (level, statuses[row].message)
        if groups != self.groups:
            self.groups = groups
            self._marks.note(Mark.GROUPS)


class RawUpdates:
    """Applies the arrays of a robot's drivers: partial, so only a late component is STALE."""

    def __init__(self, components: Components, reject: Reject) -> None:
        self._components = components
        self._reject = reject
        self._split_names: set[str] = set()  # names that several components have

    def apply(self, statuses: Sequence[Status], now: Instant) -> None:
        """Update the components from one array."""
        if len({status.name for status in statuses}) != len(statuses):
            statuses = self._worst_of_each(statuses)
        for status in statuses:
            hardware_id = status.hardware_id if status.name in self._split_names else ""
            identity = (status.name, "", hardware_id)
            component = self._components.by_identity.get(identity)
            if component is None:
                component = self._components.get_or_add(identity, _node_of(status.name), now)
            if component is not None:
                self._components.update_raw(component, status, now)

    def split_by_hardware_id(self, name: str) -> None:
        """Make a component of each name and hardware_id from now on."""
        if name not in self._split_names and len(self._split_names) < MAX_SPLIT_NAMES:
            self._split_names.add(name)
            self._components.split_by_hardware_id(name)

    def _worst_of_each(self, statuses: Sequence[Status]) -> list[Status]:
        """The worst status of each component, for an array that has a name more than once.

        One name with two hardware_ids are two components, from then on.
        """
        ids: dict[str, set[str]] = {}
        for status in statuses:
            if status.hardware_id:
                ids.setdefault(status.name, set()).add(status.hardware_id)
        for name, found in ids.items():
            if len(found) > 1:
                self.split_by_hardware_id(name)
        worst: dict[tuple[str, str], Status] = {}
        for status in statuses:
            hardware_id = status.hardware_id if status.name in self._split_names else ""
            key = status.name, hardware_id
            if key in worst:
                self._reject("duplicate_component", status.name)
                status = max(status, worst[key], key=_severity)  # noqa: PLW2901
            worst[key] = status
        return list(worst.values())


def _severity(status: Status) -> int:
    """By the rank of its state, in which ERROR, and what counts as it, is worse than STALE."""
    return {0: 0, 1: 1, STALE: 2}.get(status.level, 3)


def _level(status: Status) -> int:
    # For one component in several groups STALE comes first: a group that has lost the component
    # knows more than one that waits longer for it.
    return min(status.level, STALE)


def _node_of(name: str) -> str:
    """The node that publishes a raw status: updaters write "node: task"."""
    node, colon, _task = name.partition(": ")
    return node if colon else ""
