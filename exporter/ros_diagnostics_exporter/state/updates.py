"""Arrays -> components: the complete ones of an aggregator, the partial ones of drivers."""

from __future__ import annotations

from collections.abc import Sequence

from ros_diagnostics_exporter.config.fleet import Limits
from ros_diagnostics_exporter.ingest.tree import Structure, TreeReader
from ros_diagnostics_exporter.model import Instant, Status
from ros_diagnostics_exporter.state.bounds import Reject, bounded
from ros_diagnostics_exporter.state.component import STALE, Component
from ros_diagnostics_exporter.state.components import Members
from ros_diagnostics_exporter.state.versions import Versions

MOST_PARTED = 4096  # names of one robot that two components carry


class TreeIntake:
    """Takes the arrays of one robot's aggregator: complete, so who is missing is STALE."""

    def __init__(
        self, members: Members, versions: Versions, limits: Limits, reject: Reject
    ) -> None:
        self.groups: dict[str, tuple[int, str]] = {}  # path -> (level, message) as reported
        self._members = members
        self._versions = versions
        self._limits = limits
        self._reject = reject
        self._reader = TreeReader()
        self._structure: Structure | None = None
        self._removals = 0  # of the members, when the plan was made
        self._plan: list[tuple[Component, tuple[int, ...]]] = []
        self._missing: list[Component] = []

    def take(self, statuses: Sequence[Status], now: Instant) -> None:
        """Take one array."""
        structure = self._reader.read(statuses)
        if structure is not self._structure or self._removals != self._members.removals:
            self._adopt(structure, now)
        self._take_groups(statuses, structure)
        for component, rows in self._plan:
            status = statuses[rows[0]]
            if len(rows) > 1:
                status = max((statuses[row] for row in rows), key=_severity)
            if component.heard_raw is not None and status.level != STALE:
                component.listed = now.mono  # heard at its source: the aggregate is an older copy
            else:
                self._members.hear(component, status, now)
        for component in self._missing:
            self._members.lose(component, now)

    def start_over(self, limits: Limits) -> None:
        """Look for the components anew at the next array: the config may want others."""
        self._limits = limits
        self._structure = None

    def _adopt(self, structure: Structure, now: Instant) -> None:
        """Find the components of a changed structure, and those that are missing in it."""
        members = self._members
        self._structure = structure
        self._withdraw_groups(structure)
        self._plan = []
        for leaf in structure.leaves:
            identity = (leaf.component, "" if leaf.exact else leaf.group, "")
            component = members.obtain(identity, leaf.group, now)
            if component is not None:
                members.regroup(component, leaf.group)
                self._plan.append((component, leaf.rows))
        self._removals = members.removals
        listed = {component.identity for component, _rows in self._plan}
        # An aggregator that has just started lists no component yet: that says nothing about
        # them. They become STALE when their own time is over.
        self._missing = [
            component
            for identity, component in members.all.items()
            if structure.leaves and identity not in listed and component.heard_raw is None
        ]

    def _withdraw_groups(self, structure: Structure) -> None:
        """Take out, in silence, components that prove to be groups."""
        paths = {path for _row, path in structure.groups}
        for (name, group, _parting), component in list(self._members.all.items()):
            if group and f"{group}/{name}" in paths:
                self._members.remove(component)

    def _take_groups(self, statuses: Sequence[Status], structure: Structure) -> None:
        groups: dict[str, tuple[int, str]] = {}
        for row, path in structure.groups:
            level = min(statuses[row].level, STALE)
            label = bounded(path, self._limits.label_length)
            if label not in groups and len(groups) >= self._limits.components:
                self._reject("component_limit", path)
                break
            if label not in groups or level > groups[label][0]:
                groups[label] = (level, statuses[row].message)
        if groups != self.groups:
            self.groups = groups
            self._versions.groups += 1


class RawIntake:
    """Takes the arrays of a robot's drivers: partial, so who is late is STALE."""

    def __init__(self, members: Members) -> None:
        self._members = members
        self._parted: set[str] = set()  # names that two components carry

    def take(self, statuses: Sequence[Status], now: Instant) -> None:
        """Take one array."""
        if len({status.name for status in statuses}) != len(statuses):
            statuses = self._last_of_each(statuses)
        for status in statuses:
            parting = status.hardware_id if status.name in self._parted else ""
            identity = (status.name, "", parting)
            component = self._members.all.get(identity)
            if component is None:
                component = self._members.obtain(identity, _node_of(status.name), now)
            if component is not None:
                self._members.hear_raw(component, status, now)

    def part(self, name: str) -> None:
        """Tell the components of this name apart by their hardware_id from now on."""
        if name not in self._parted and len(self._parted) < MOST_PARTED:
            self._parted.add(name)
            self._members.part(name)

    def _last_of_each(self, statuses: Sequence[Status]) -> list[Status]:
        """The last status of each component of an array that carries a name more than once.

        One name with two hardware_ids are two components; that is remembered for good.
        """
        ids: dict[str, set[str]] = {}
        for status in statuses:
            if status.hardware_id:
                ids.setdefault(status.name, set()).add(status.hardware_id)
        for name, found in ids.items():
            if len(found) > 1:
                self.part(name)
        last = {}
        for status in statuses:
            parting = status.hardware_id if status.name in self._parted else ""
            last[status.name, parting] = status
        return list(last.values())


def _severity(status: Status) -> int:
    # For one component in several groups STALE comes first: a group that has lost the component
    # knows more than one that waits longer for it.
    return min(status.level, STALE)


def _node_of(name: str) -> str:
    """The node that publishes a raw status: updaters write "node: task"."""
    node, colon, _task = name.partition(": ")
    return node if colon else ""
