"""An aggregated array -> groups and components as their drivers published them.

Owns the reading of diagnostic_aggregator's flat list of rows. The list names a component by its
group's path and an altered name ("/" became " ", prefixes may be cut off), but the header row that
a GenericAnalyzer puts before its components names them again, unaltered, as the keys of its values
(diagnostic_aggregator, generic_analyzer_base.hpp and analyzer_group.cpp). The reader knows no time
and keeps no level; the updates pass on to the components what it finds.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.model import Instant, Status
from ros_diagnostics_exporter.robots.component import STALE, Component, Identity
from ros_diagnostics_exporter.robots.components import Components
from ros_diagnostics_exporter.robots.limits import truncate
from ros_diagnostics_exporter.robots.marks import Mark, Marks
from ros_diagnostics_exporter.robots.rejections import Reject
from ros_diagnostics_exporter.robots.renames import find_former, path_of

# What the aggregator itself writes into a header (status_item.hpp, *_analyzer_base.hpp, ...).
_HEADER_MESSAGE = re.compile(
    r"OK|Warning|Error|Stale|All Stale|No analyzers|Analyzer init failed"
    r"|Pluginlib exception loading analyzer"
    r'|Unanalyzed items found in "Other"|No items found, expected \d+|Expected \d+, found \d+'
)

# No aggregator has this many groups; further names are not stored.
_MAX_GROUPS = 4096
# Nor so many levels; a name that is nothing but slashes must not cost its square.
_MAX_LEVELS = 64


class Leaf(NamedTuple):
    """One component of an aggregated array.

    ``rows`` are the indices of its statuses: several where several groups list it, then ``group``
    is the first of them in byte order. ``exact``: whether ``component`` is the name as
    published; otherwise it is the row's name without the group's path, and the group belongs to
    the component's identity.
    """

    component: str
    group: str
    rows: tuple[int, ...]
    exact: bool = True

    @property
    def identity(self) -> Identity:
        """That of its component, as long as it is known by nothing better."""
        return self.component, "" if self.exact else self.group, ""


class Structure(NamedTuple):
    """Which rows of an array are components, and which are groups (row, path)."""

    leaves: tuple[Leaf, ...] = ()
    groups: tuple[tuple[int, str], ...] = ()


@dataclass(eq=False, repr=False)
class AggregatedUpdates:
    """Applies the arrays of one robot's aggregator: complete, so a missing component is STALE."""

    _components: Components
    _marks: Marks[Component]
    _limits: config.Limits
    _reject: Reject
    # path -> (level, message) as reported
    groups: dict[str, tuple[int, str]] = field(default_factory=dict)
    _structure: Structure | None = None
    _planned_at: int = -1  # the last change that the plan is made of
    _plan: list[tuple[Component, tuple[int, ...]]] = field(default_factory=list)
    _missing: list[Component] = field(default_factory=list)
    _paths: dict[Component, str] = field(default_factory=dict)  # of the row that it had last
    _group_rows: list[tuple[int, str]] = field(default_factory=list)  # with the label of each

    def __post_init__(self) -> None:
        self._reader = TreeReader()

    def apply(self, statuses: Sequence[Status], now: Instant, *, alone: bool) -> None:
        """Update the components from one array; ``alone``: no array of a driver counts."""
        structure = self._reader.read(statuses)
        if structure is not self._structure or self._marks.at[Mark.NAMES] > self._planned_at:
            self._plan_updates(structure, statuses, now)
        self._update_groups(statuses)
        for component, rows in self._plan:
            status = statuses[rows[0]]
            if len(rows) > 1:
                status = max((statuses[row] for row in rows), key=_level)
            if (
                status is component.last
                and component.reported == status.level != STALE
                and component.key_values  # none are counted yet by another config
            ):
                component.listed = component.received = now.mono  # most of most arrays
                continue
            if status.level == STALE:
                is_old = component.is_on_change and not component.is_stale  # for want of an update
            else:
                is_old = component.raw_received is not None
            if is_old:
                component.listed = now.mono  # received at its source: this is an older copy
            else:
                self._components.update(component, status, now)
        for component in self._missing:
            # What a driver publishes is no matter of the aggregator, and of what is known from an
            # earlier process nobody knows yet who publishes it.
            if component.raw_received is None and (alone or component in self._paths):
                self._components.mark_missing(component, now)

    def lists(self, component: Component) -> bool:
        """Whether the last array has a component."""
        return any(component is each for each, _rows in self._plan)

    def drop_groups(self) -> None:
        """Have no groups any more: no aggregator is read."""
        self.groups = {}
        self._marks.note(Mark.GROUPS)

    def reset(self, limits: config.Limits) -> None:
        """Look the components up again at the next array: the config may want others."""
        self._limits = limits
        self._structure = None

    def _plan_updates(self, structure: Structure, statuses: Sequence[Status], now: Instant) -> None:
        """Find the components of a changed structure, and those that are missing in it."""
        components = self._components
        self._structure = structure
        self._remove_groups(structure)
        length = self._limits.label_length
        self._group_rows = [(row, truncate(path, length)) for row, path in structure.groups]
        self._plan = []
        self._paths = {each: self._paths[each] for each in components if each in self._paths}
        former = self._find_former(structure, statuses)
        for leaf in structure.leaves:
            if leaf.exact and components.is_received_split(leaf.component):
                continue  # several nodes' statuses, of which the aggregator has the latest
            known = former.get(leaf.identity)
            if known is None:
                component = components.get_or_add(leaf.identity, leaf.group, now)
            elif leaf.exact or not known.is_exact:
                component = components.identify(known, leaf.identity, now)
            else:
                component = known
            if component is not None:
                components.regroup(component, leaf.group)
                self._paths[component] = statuses[leaf.rows[0]].name
                self._plan.append((component, leaf.rows))
        self._planned_at = self._marks.count
        listed = {component.identity for component, _rows in self._plan}
        # An aggregator that has just started lists no component yet: none is missing because of
        # that. They become STALE after their own time.
        self._missing = [
            component
            for identity, component in components.by_identity.items()
            if structure.leaves and identity not in listed and component.is_published
        ]

    def _find_former(
        self, structure: Structure, statuses: Sequence[Status]
    ) -> dict[Identity, Component]:
        """The components known under another name that the structure's leaves continue."""
        known = self._components.by_identity
        new = {each.identity: statuses[each.rows[0]].name for each in structure.leaves}
        rows = {identity: path for identity, path in new.items() if identity not in known}
        if not rows:
            return {}
        vanished = {
            component: path
            for identity, component in known.items()
            if identity not in new and component.raw_received is None and component.is_published
            if (path := self._paths.get(component) or path_of(component)).startswith("/")
        }
        return find_former(rows, vanished, is_moved=len(rows) == len(new))

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


class TreeReader:
    """Reads the arrays of one robot's aggregator, storing which names proved to be groups.

    The structure of the last array is kept: as long as the names stay, reading is a comparison.
    """

    def __init__(self) -> None:
        self.groups: set[str] = set()
        self._seen_child = False
        self._names: list[str] = []
        self._rows: list[int] = []  # that decide about the structure, beside the names
        self._deciding: list[Status] = []
        self._signature: list[object] = []  # of each
        self._structure = Structure()

    def read(self, statuses: Sequence[Status]) -> Structure:
        """The structure of one array; its indices point into ``statuses``."""
        names = [status.name for status in statuses]
        if names == self._names:
            before, self._deciding = self._deciding, [statuses[row] for row in self._rows]
            # Mostly the same objects: what did not change is decoded once.
            others = [row for row, each in enumerate(self._deciding) if each is not before[row]]
            if all(self._sign(row) == self._signature[row] for row in others):
                return self._structure
        self._structure = self._parse(statuses, names)
        self._names = names
        self._rows = [row for row, _path in self._structure.groups]
        self._rows += [leaf.rows[0] for leaf in self._structure.leaves if not leaf.exact]
        self._deciding = [statuses[row] for row in self._rows]
        self._signature = [self._sign(row) for row in range(len(self._rows))]
        return self._structure

    def _sign(self, row: int) -> object:
        """What of a deciding row does: a group's keys; else whether it could be a header."""
        status, is_group = self._deciding[row], row < len(self._structure.groups)
        keys = [key for key, _value in status.values] if is_group else []
        return keys or _could_be_header(status)

    def _parse(self, statuses: Sequence[Status], names: list[str]) -> Structure:
        found = _components_after_headers(statuses)
        known = set(names)
        prefixes = {path for name in known for path in _paths_above(name) if path in known}
        if len(self.groups) < _MAX_GROUPS:
            self.groups.update(name for name in names if name in prefixes)
        self._seen_child = self._seen_child or bool(prefixes)
        keyed = bool(found)
        earlier: set[str] = set()
        for row, status in enumerate(statuses):
            if row not in found and self._is_leaf(status, earlier, keyed=keyed):
                found[row] = self._name_from_row(status.name)
            earlier.add(status.name)
        groups = tuple((row, name) for row, name in enumerate(names) if row not in found)
        return Structure(_merge(found), groups)

    def _is_leaf(self, status: Status, earlier: set[str], *, keyed: bool) -> bool:
        """Whether a row that no header's keys name is a component.

        ``earlier`` are the names before it in the array: a GenericAnalyzer's header stands before
        its components, an AnalyzerGroup's after them. ``keyed``: this aggregator
        publishes values, so that a header would have named it.
        """
        if status.name in self.groups:
            return False
        if status.name.startswith("/") and not self._seen_child:
            return False  # right after its start the aggregator sends headers without children
        if not _could_be_header(status):
            return True
        return not keyed and status.name.rpartition("/")[0] in earlier

    def _name_from_row(self, name: str) -> tuple[str, str, bool]:
        group = next((path for path in _paths_above(name) if path in self.groups), None)
        if group is None:
            group = name.rpartition("/")[0]
        return (name[len(group) + 1 :] if group else name.lstrip("/")), group, False


def _level(status: Status) -> int:
    # For one component in several groups STALE comes first: a group that has lost the component
    # knows more than one that waits longer for it.
    return min(status.level, STALE)


def _paths_above(name: str) -> Iterable[str]:
    """The paths above a row's name, the longest first: "/a/b/c" -> "/a/b", "/a"."""
    end = name.rfind("/")
    for _level in range(_MAX_LEVELS):
        if end <= 0:
            return
        yield name[:end]
        end = name.rfind("/", 0, end)


def _could_be_header(status: Status) -> bool:
    return (
        not status.values
        and not status.hardware_id
        and _HEADER_MESSAGE.fullmatch(status.message) is not None
    )


def _components_after_headers(
    statuses: Sequence[Status],
) -> dict[int, tuple[str, str, bool]]:
    """Row -> (name as published, group, True) for every block "header, then its components".

    A row is a header if as many rows as it has values follow, each one level below it and each
    named, in order, by the key. An AnalyzerGroup's header has keys too, but its children stand
    before it.
    """
    found: dict[int, tuple[str, str, bool]] = {}
    row = 0
    while row < len(statuses):
        header = statuses[row]
        count = len(header.values)
        block = statuses[row + 1 : row + 1 + count]
        if count and len(block) == count and _is_block(header, block):
            for offset, (key, _message) in enumerate(header.values, start=1):
                found[row + offset] = (key, header.name, True)
            row += count
        row += 1
    return found


def _is_block(header: Status, block: Sequence[Status]) -> bool:
    prefix = header.name + "/"
    for (key, _message), status in zip(header.values, block, strict=True):
        if not status.name.startswith(prefix):
            return False
        # Prefix removal cuts at the front, so what is left is the end of the name.
        shown = status.name[len(prefix) :]
        if "/" in shown or not key.replace("/", " ").endswith(shown):
            return False
    return True


def _merge(places: dict[int, tuple[str, str, bool]]) -> tuple[Leaf, ...]:
    """One leaf for each component, in the order of first appearance."""
    rows: dict[tuple[str, str], list[int]] = {}
    for row in sorted(places):
        component, group, exact = places[row]
        rows.setdefault((component, "" if exact else group), []).append(row)
    return tuple(
        Leaf(
            component,
            min((places[row][1] for row in own), key=str.encode),
            tuple(own),
            places[own[-1]][2],
        )
        for (component, _group), own in rows.items()
    )
