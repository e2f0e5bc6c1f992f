"""What is known about one robot: whether it is heard, its components, its groups.

Every array goes in here; every level comes out of here. Components of an aggregated array are
complete (who is missing is STALE), those of a raw array are partial (who is late is STALE).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import inf

from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.config.lookup import check_matches, component_rule, value_rule
from ros_diagnostics_exporter.diagnostics import Array, Instant, Status
from ros_diagnostics_exporter.state.bounds import Budget, bounded
from ros_diagnostics_exporter.state.component import ERROR, OK, STALE, Component, Identity
from ros_diagnostics_exporter.state.network import Network
from ros_diagnostics_exporter.state.readings import Values
from ros_diagnostics_exporter.state.remembered import RememberedRobot
from ros_diagnostics_exporter.tree import Structure, TreeReader

# How many series a component has at least: level, since, changes, info, problem since, message.
SERIES_OF_COMPONENT = 6

Changed = Callable[["Robot", Component, int, Instant], None]  # told the level before


@dataclass
class Versions:
    """Counters of change, so that a reader may keep what he made from an unchanged part."""

    structure: int = 0  # which series there are
    receipt: int = 0  # messages, bytes, last message, clock offset
    levels: int = 0
    values: int = 0
    groups: int = 0
    inventory: int = 0  # the config's part

    def copy(self) -> Versions:
        """The counters as they stand."""
        return replace(self)


class Robot:
    """One robot; see the module. All of it is guarded by the lock of the State that holds it."""

    def __init__(
        self,
        settings: config.Robot,
        limits: config.Limits,
        budget: Budget,
        changed: Changed,
        *,
        declared: bool,
    ) -> None:
        self.settings = settings
        self.declared = declared
        self.limits = limits
        self.up = False
        self.source = settings.source
        self.first_raw: float | None = None
        self.last_mono: float | None = None
        self.last_wall = 0.0
        self.messages = 0
        self.bytes = 0
        self.clock_offset: float | None = None
        self.undecodable = False
        self.network = Network()
        self.maintenance = False
        self.rejected: Counter[str] = Counter()
        self.components: dict[Identity, Component] = {}
        self.groups: dict[str, tuple[int, str]] = {}
        self.versions = Versions()
        self._budget = budget
        self._changed = changed
        self._tree = TreeReader()
        self._structure: Structure | None = None
        self._plan: list[tuple[Component, tuple[int, ...]]] = []
        self._missing: list[Component] = []
        self._parted: set[str] = set()
        self._restless: set[Identity] = set()
        self._deadline = inf  # when the next component may be late, monotonic
        self._members: list[tuple[str, list[Component]]] = []
        self._members_of = -1  # the version of the structure that they were found in

    def configure(self, settings: config.Robot, limits: config.Limits, now: Instant) -> None:
        """Follow another config; what is known stays, as far as it is still wanted."""
        if settings.source is not self.settings.source:
            self.source = settings.source
        if _road(settings) != _road(self.settings):
            self.network = Network()
        judged_alike = settings.profile == self.settings.profile
        self.settings, self.limits = settings, limits
        self.versions.inventory += 1
        self.versions.structure += 1
        if judged_alike:
            return
        self._structure = None  # what was ignored may be wanted now
        for identity, component in list(self.components.items()):
            component.rule = component_rule(settings.profile, identity[0])
            if component.rule is not None and component.rule.ignore:
                self._remove(identity, component)
                continue
            component.values.clear()
            component.values = self._values(identity[0])
            if component.last is not None and not component.is_stale:
                component.values.update(component.last.values)
            if component.level >= OK:
                self._set_level(component, component.reported, now)

    # -- what comes in -----------------------------------------------------------------------

    def receive(self, array: Array, now: Instant, *, raw: bool) -> None:
        """Take in one array from the raw or the aggregated topic."""
        self.up = True
        self.undecodable = False
        self.last_mono, self.last_wall = now
        self.messages += 1
        self.bytes += array.size
        if array.stamp > 0:
            self.clock_offset = now.wall - array.stamp
        self.versions.receipt += 1
        if raw:
            self._take_partial(array.statuses, now)
        else:
            self._take_tree(array.statuses, now)

    @property
    def silent_reason(self) -> str | None:
        """Why nothing arrives, in one word; None while the robot is up."""
        if self.up:
            return None
        if self.network.domain_up and self.undecodable:
            return "undecodable"
        if self.network.obstacle is not None:
            return self.network.obstacle
        if self.network.publishers:
            return "mute"
        return "publisher_gone" if self.last_wall else "never_seen"

    def reject(self, reason: str) -> None:
        """Count something that was not taken in."""
        self.rejected[reason] += 1
        self.versions.receipt += 1

    def _take_tree(self, statuses: Sequence[Status], now: Instant) -> None:
        structure = self._tree.read(statuses)
        if structure is not self._structure:
            self._adopt(structure, now)
        self._take_groups(statuses, structure)
        for component, rows in self._plan:
            component.listed = now.mono
            status = statuses[rows[0]]
            if len(rows) > 1:
                status = max((statuses[row] for row in rows), key=_severity)
            if component.heard_raw is not None and status.level != STALE:
                continue  # heard at the source: the aggregate is an older copy
            self._hear(component, status, now)
        for component in self._missing:
            self._set_level(component, STALE, now)

    def _adopt(self, structure: Structure, now: Instant) -> None:
        """Find the components of a changed structure, and those that are missing in it."""
        self._structure = structure
        self._plan = []
        for leaf in structure.leaves:
            identity = (leaf.component, "" if leaf.exact else leaf.group, "")
            component = self._component(identity, leaf.group, now)
            if component is not None:
                self._regroup(component, leaf.group)
                self._plan.append((component, leaf.rows))
        listed = {id(component) for component, _rows in self._plan}
        if not structure.leaves:
            # An aggregator that has just started lists no component yet: that says nothing
            # about them. They become STALE when their own time is over.
            self._missing = []
            return
        self._missing = [
            each
            for each in self.components.values()
            if id(each) not in listed and each.heard_raw is None
        ]
        self._withdraw_groups(structure)

    def _withdraw_groups(self, structure: Structure) -> None:
        """Take out, in silence, components that prove to be groups."""
        paths = {path for _row, path in structure.groups}
        for identity, component in list(self.components.items()):
            if identity[1] and f"{identity[1]}/{identity[0]}" in paths:
                self._remove(identity, component)
                self._missing = [each for each in self._missing if each is not component]

    def _take_groups(self, statuses: Sequence[Status], structure: Structure) -> None:
        groups: dict[str, tuple[int, str]] = {}
        length = self.limits.label_length
        for row, path in structure.groups:
            level = min(statuses[row].level, STALE)
            label = bounded(path, length)
            if label not in groups or level > groups[label][0]:
                groups[label] = (level, statuses[row].message)
        if groups != self.groups:
            if groups.keys() != self.groups.keys():
                self.versions.structure += 1
            self.groups = groups
            self.versions.groups += 1

    def _take_partial(self, statuses: Sequence[Status], now: Instant) -> None:
        if len({status.name for status in statuses}) != len(statuses):
            statuses = self._part(statuses)
        for status in statuses:
            parting = status.hardware_id if status.name in self._parted else ""
            identity = (status.name, "", parting)
            component = self.components.get(identity)
            if component is None:
                component = self._component(identity, _node_of(status.name), now)
                if component is None:
                    continue
            component.listed = now.mono
            component.renew_raw(now.mono, self._threshold(component))
            self._hear(component, status, now)
            self._expect(component, now)

    def _part(self, statuses: Sequence[Status]) -> list[Status]:
        """The last status of each component of an array that carries a name more than once.

        One name with two hardware_ids are two components; that is remembered for good.
        """
        ids: dict[str, set[str]] = {}
        for status in statuses:
            if status.hardware_id:
                ids.setdefault(status.name, set()).add(status.hardware_id)
        for name, found in ids.items():
            if len(found) > 1 and name not in self._parted:
                self._parted.add(name)
                self._rename_parted(name)
        last = {}
        for status in statuses:
            parting = status.hardware_id if status.name in self._parted else ""
            last[status.name, parting] = status
        return list(last.values())

    def _rename_parted(self, name: str) -> None:
        component = self.components.pop((name, "", ""), None)
        if component is not None:
            component.identity = (name, "", component.hardware_id)
            component.name = self._label(component.identity)
            self.components[component.identity] = component
            self.versions.structure += 1

    def _hear(self, component: Component, status: Status, now: Instant) -> None:
        """Take one status of one component."""
        last = component.last
        if status == last and component.reported == status.level:
            if status.level != STALE:
                component.heard = now.mono
            return
        said = status.level
        if said > STALE:
            self.reject("bad_level")
            said = ERROR  # as diagnostic_aggregator reads it (status_item.hpp, valToLevel)
        component.last = status
        if said != STALE:
            component.heard = now.mono
        if status.hardware_id and status.hardware_id != component.hardware_id:
            component.hardware_id = status.hardware_id
            self.versions.structure += 1
        level_before = component.level
        changed = self._set_level(component, said, now, notify=False)
        if component.take_message(status.message, renew=changed) and component.level != OK:
            self.versions.levels += 1
        if changed:
            self._changed(self, component, level_before, now)
        if said != STALE:
            numbers, shape = component.values.update(status.values)
            self.versions.values += numbers
            self.versions.structure += shape

    def _set_level(
        self, component: Component, said: int, now: Instant, *, notify: bool = True
    ) -> bool:
        was_stale = component.is_stale
        before = component.level
        changed = component.set_reported(said, now, self.settings.profile.flap_interval)
        if was_stale != component.is_stale:  # the numbers of a stale component are not shown
            self.versions.structure += 1
            self._expect(component, now)
        if changed:
            self.versions.levels += 1
            if component.flaps is not None and component.flaps.ratio > 0:
                self._restless.add(component.identity)
            if notify:
                self._changed(self, component, before, now)
        return changed

    # -- components --------------------------------------------------------------------------

    def _label(self, identity: Identity) -> str:
        name, _group, parting = identity
        label = f"{name} [{parting}]" if parting else name
        return bounded(label or "(unnamed)", self.limits.label_length)

    def _component(self, identity: Identity, group: str, now: Instant) -> Component | None:
        """The component of this identity, made if there is room for it and the config wants it."""
        known = self.components.get(identity)
        if known is not None:
            return known
        rule = component_rule(self.settings.profile, identity[0])
        if rule is not None and rule.ignore:
            return None
        if len(self.components) >= self.limits.components:
            self.reject("component_limit")
            return None
        if not self._budget.take(SERIES_OF_COMPONENT):
            self.reject("series_limit")
            return None
        label = self._label(identity)
        if label != identity[0] and len(identity[0]) > self.limits.label_length:
            self.reject("label_length")
        component = Component(identity, label, rule, self._values(identity[0]), now)
        self._regroup(component, group)
        self.components[identity] = component
        self.versions.structure += 1
        return component

    def _values(self, name: str) -> Values:
        profile = self.settings.profile
        return Values(
            (lambda key: value_rule(profile, name, key)) if profile.values else None,
            (self.limits.values, self.limits.label_length),
            self._budget,
            self.reject,
        )

    def _regroup(self, component: Component, group: str) -> None:
        label = bounded(group, self.limits.label_length)
        if component.group != label:
            component.group = label
            self.versions.structure += 1

    def _remove(self, identity: Identity, component: Component) -> None:
        component.values.clear()
        self._budget.give(SERIES_OF_COMPONENT)
        del self.components[identity]
        self._restless.discard(identity)
        self._plan = [entry for entry in self._plan if entry[0] is not component]
        self._structure = None  # read anew: the row may belong to another component now
        self.versions.structure += 1
        self.versions.levels += 1

    def remember(self, now: Instant) -> RememberedRobot:
        """What a later process should know."""
        settings = self.settings
        return RememberedRobot(
            domain_id=settings.domain_id,
            topic=settings.topic_agg or settings.topic_raw or "",
            source=self.source.value,
            last_seen=self.last_wall,
            components=[
                each.remember(now)._asdict() for each in self.components.values() if each.level >= 0
            ],
        )

    def restore(self, known: RememberedRobot, now: Instant) -> None:
        """Put back what a former process knew: all of it STALE until it is heard."""
        if self.settings.source is config.Source.AUTO:
            self.source = config.Source(known.source)
        self.last_wall = known.last_seen
        if known.last_seen:
            self.last_mono = now.mono - max(0.0, now.wall - known.last_seen)
        for each in known.components:
            component = self._component(each.identity, each.group, now)
            if component is not None:
                component.restore(each, now)
                self._parted.update({each.identity[0]} if each.identity[2] else ())
        self.versions.levels += 1
        self.versions.receipt += 1

    # -- time --------------------------------------------------------------------------------

    def tick(self, now: Instant) -> bool:
        """Let time pass: silence, late components, flapping. True if the robot fell silent."""
        for identity in list(self._restless):
            flaps = self.components[identity].flaps
            if flaps is not None and flaps.rest(now.mono, self.settings.profile.flap_interval):
                self.versions.levels += 1
                if flaps.ratio == 0.0:
                    self._restless.discard(identity)
        if not self.up or self.last_mono is None:
            return False
        if now.mono - self.last_mono > self.settings.profile.stale_after:
            self.up = False
            self.versions.receipt += 1
            self._all_stale(now)
            return True
        if now.mono > self._deadline:
            self._find_late(now)
        return False

    def _all_stale(self, now: Instant) -> None:
        for component in self.components.values():
            self._set_level(component, STALE, now)

    def _threshold(self, component: Component) -> float:
        raw = component.heard_raw is not None
        return component.stale_after(self.settings.profile.stale_after, raw=raw)

    def _expect(self, component: Component, now: Instant) -> None:
        """Look at the late ones no later than when this one, heard now, would be late."""
        self._deadline = min(self._deadline, now.mono + self._threshold(component))

    def _find_late(self, now: Instant) -> None:
        """Mark the late components, and note when the next one would be late."""
        self._deadline = inf
        for component in self.components.values():
            if component.is_stale or component.heard is None:
                continue
            due = component.heard + self._threshold(component)
            if now.mono > due:
                self._set_level(component, STALE, now)
            else:
                self._deadline = min(self._deadline, due)

    def count_checks(self) -> Iterator[tuple[str, list[int]]]:
        """For each check of the profile how many of its components stand at each level."""
        if self._members_of != self.versions.structure:
            self._members_of = self.versions.structure
            self._members = [
                (check.name, [each for each in self.components.values() if _in(check, each)])
                for check in self.settings.profile.checks
            ]
        for name, members in self._members:
            counts = [0, 0, 0, 0]
            for component in members:
                if component.level >= OK:
                    counts[component.level] += 1
            yield name, counts

    def forgettable(self, now: Instant) -> Iterable[Identity]:
        """Components long gone that were OK when they went: absence never ends a fault."""
        after = self.settings.profile.forget_after
        for identity, component in self.components.items():
            gone = now.mono - component.listed > after and component.is_stale
            if gone and component.before_stale in (None, OK):
                yield identity

    def forget(self, identity: Identity) -> None:
        """Take one component out, with all that is known about it."""
        self._remove(identity, self.components[identity])

    def release(self) -> None:
        """Give back the series of a robot that goes."""
        for component in self.components.values():
            component.values.clear()
            self._budget.give(SERIES_OF_COMPONENT)
        self.components = {}


def _road(settings: config.Robot) -> tuple[int, str | None, str | None]:
    return settings.domain_id, settings.topic_agg, settings.topic_raw


def _in(check: config.Check, component: Component) -> bool:
    return check_matches(check, component.group, component.name)


def _severity(status: Status) -> int:
    # For one component in several groups STALE comes first: a group that has lost the component
    # knows more than one that waits longer for it.
    return min(status.level, STALE)


def _node_of(name: str) -> str:
    """The node that publishes a raw status: updaters write "node: task"."""
    node, colon, _task = name.partition(": ")
    return node if colon else ""
