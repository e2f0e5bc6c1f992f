"""The components of one robot: added, updated, late, counted, removed.

Every change of a level passes here, whether an array, silence or the config causes it.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterable, Iterator
from dataclasses import dataclass, field
from math import inf

from ros_diagnostics_exporter import durations
from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.model import Feed, Instant, Status
from ros_diagnostics_exporter.robots.component import (
    ERROR,
    OK,
    STALE,
    Component,
    Identity,
    full_name,
)
from ros_diagnostics_exporter.robots.limits import SeriesLimit, truncate, unique_name
from ros_diagnostics_exporter.robots.marks import Mark, Marks
from ros_diagnostics_exporter.robots.persisted import PersistedComponent
from ros_diagnostics_exporter.robots.rejections import Reject
from ros_diagnostics_exporter.robots.rules import (
    check_matches,
    component_rule,
    selects_component,
    value_rule,
)
from ros_diagnostics_exporter.robots.values import ComponentValues

SERIES_OF_COMPONENT = 6  # at least: level, since, changes, info, problem since, message
# Seconds after a robot is received again in which those that publish only on a change may start.
TIME_TO_START = 60.0
MAX_SPLIT_NAMES = 4096  # names of one robot that several components have
SHADOWED = "shadow mode (graph in fleet.yml)"  # why what a shadow shows is no fault


@dataclass(eq=False, repr=False)
class Components:
    """The components of one robot by their identity.

    ``reject`` is called with the reason and name of what is rejected, ``changed`` with (component,
    level before, now) at every change of a level. ``split_names`` are those that several nodes
    publish, each with a hardware_id; one that ``has_fault`` keeps the name that people know.
    """

    _profile: config.Profile
    _limits: config.Limits
    _series: SeriesLimit
    _marks: Marks[Component]
    _reject: Reject
    _changed: Callable[[Component, int, Instant], None]
    by_identity: dict[Identity, Component] = field(default_factory=dict)
    split_names: set[str] = field(default_factory=set)
    has_fault: Callable[[Component], bool] = lambda _component: False
    next_late: float = inf  # until when none of a robot that is up can be, monotonic
    _key_values: int = 0  # of all components
    _taken: dict[str, dict[str, int]] = field(default_factory=dict)  # labels, by group
    _waiting: dict[Component, str] = field(default_factory=dict)  # for another name, in this group
    # Arrays alone, which have all that is published.
    last_array: float = -inf  # when it was received, monotonic
    arrays_since: float = -inf  # when they came again, or were no longer lost, monotonic
    has_arrays: bool = False  # since the robot was silent
    _is_lossy: bool = False  # so are too many of its messages that say nothing
    unread: Container[str] = frozenset()  # components of fields whose topics are not read
    _checked: list[tuple[str, list[Component]]] = field(default_factory=list)
    _checked_at: int = -1  # the last change that `_checked` is made of

    def __post_init__(self) -> None:
        # Of values alone: whatever a robot sends, its components' levels are not rejected for it.
        most = self._limits.robot_series
        self._value_series = SeriesLimit(most, self._series, "robot_series_limit")

    def __iter__(self) -> Iterator[Component]:
        """All components, in the order in which they were added."""
        return iter(self.by_identity.values())

    def __len__(self) -> int:
        """How many there are."""
        return len(self.by_identity)

    # -- added and removed -------------------------------------------------------------------

    def get_or_add(self, identity: Identity, group: str, now: Instant) -> Component | None:
        """The component of this identity; None where a limit or the config rejects it."""
        known = self.by_identity.get(identity)
        if known is not None:
            return known
        rule = component_rule(self._profile, identity[0])
        if rule is not None and rule.ignore:
            return None
        if len(self) >= self._limits.components:
            self._reject("component_limit", identity[0])
            return None
        limit = self._series.add(SERIES_OF_COMPONENT)
        if limit is not None:
            self._reject(limit, identity[0])
            return None
        if len(identity[0]) > self._limits.label_length:
            self._reject("label_length", identity[0])
        values = self._values(identity[0])
        component = Component(identity, self._name(identity), rule, values, now, marks=self._marks)
        self.by_identity[identity] = component
        self._set_label(component, truncate(group, self._limits.label_length))
        return component

    def _values(self, name: str) -> ComponentValues:
        profile = self._profile
        has_rules = any(selects_component(rule, name) for rule in profile.values)
        return ComponentValues(
            (lambda key: value_rule(profile, name, key)) if has_rules else None,
            self._limits,
            self._value_series,
            self._reject,
            self._marks,
            judged=has_rules or profile.has_conditions,
        )

    def _name(self, identity: Identity) -> str:
        return truncate(full_name(identity), self._limits.label_length)

    def regroup(self, component: Component, group: str) -> None:
        """Move a component into another group."""
        group = truncate(group, self._limits.label_length)
        if component.group != group or component in self._waiting:
            self._rename(component, group)

    def _rename(self, component: Component, group: str) -> None:
        """Give a component the name of its identity: once it has no fault that has the other."""
        name = self._name(component.identity)
        if (component.name, component.group) != (name, group) and self.has_fault(component):
            self._waiting[component] = group
            return
        self._waiting.pop(component, None)
        component.name = name
        self._set_label(component, group)

    def rename_waiting(self) -> None:
        """Rename those that have no fault any more."""
        for component, group in list(self._waiting.items()):
            self._rename(component, group)

    def identify(self, component: Component, identity: Identity, now: Instant) -> Component | None:
        """Have a component go on as one of another identity; None where the config ignores it."""
        del self.by_identity[component.identity]
        is_renamed = component.identity[0] != identity[0]
        component.identity = identity
        self.by_identity[identity] = component
        if is_renamed and not self._follow_profile(component, now):
            return None
        self._rename(component, component.group)
        return component

    def is_received_split(self, name: str) -> bool:
        """Whether nodes were received that publish this name, each with a hardware_id."""
        return name in self.split_names and any(
            identity[0] == name and identity[2] and each.raw_received is not None
            for identity, each in self.by_identity.items()
        )

    def restore(self, persisted: PersistedComponent, now: Instant) -> Component | None:
        """Restore what an earlier process knew; None where a limit or the config rejects it."""
        name, _group, hardware_id = persisted.identity
        if hardware_id:
            self.split_names.add(name)
        component = self.get_or_add(persisted.identity, persisted.group, now)
        if component is not None:
            name = persisted.name or full_name(persisted.identity)
            if name != component.name:  # it has waited, or limits.label_length is another now
                component.name, self._waiting[component] = name, component.group
                self._set_label(component, component.group)
            component.restore(persisted, now)
        return component

    def _set_label(self, component: Component, group: str) -> None:
        """Give a component the label by which it is known in its group, until it moves."""
        self._release_label(component)
        component.group = group
        component.label = unique_name(component.name, self._taken.setdefault(group, {}), "~")
        self._marks.note(Mark.NAMES)

    def _release_label(self, component: Component) -> None:
        taken = self._taken.get(component.group, {})
        taken.pop(component.label, None)
        if not taken:
            self._taken.pop(component.group, None)

    def split_by_hardware_id(self, name: str, now: Instant) -> None:
        """Make a component of each name and hardware_id from now on.

        The one before goes on as that of the hardware_id whose status counts.
        """
        if name not in self.split_names and len(self.split_names) < MAX_SPLIT_NAMES:
            self.split_names.add(name)
            component = self.by_identity.get((name, "", ""))
            if component is not None and component.hardware_id:
                component.publisher, component.said = "", None
                last = component.last
                counted = component.hardware_id if last is None else last.hardware_id
                self.identify(component, (name, "", counted), now)

    def remove(self, component: Component) -> None:
        """Remove one component, with all that is known about it."""
        component.values.clear()
        self._count_key_values(component, 0)
        self._series.remove(SERIES_OF_COMPONENT)
        del self.by_identity[component.identity]
        self._waiting.pop(component, None)
        self._release_label(component)
        self._marks.forget(component)
        self._marks.note(Mark.NAMES)

    def configure(self, profile: config.Profile, limits: config.Limits, now: Instant) -> None:
        """Apply another profile, and other limits, to every component."""
        self._profile, self._limits = profile, limits
        self._value_series.limit = limits.robot_series
        for component in list(self.by_identity.values()):
            was_on_change = component.is_on_change
            if not self._follow_profile(component, now):
                continue
            if component.name != self._name(component.identity):
                self._rename(component, truncate(component.group, limits.label_length))
            if component.is_on_change and not was_on_change:
                if component.raw_received is None:  # an aggregator said STALE, and no driver
                    component.stale_at_source = False
                if self.receives_arrays(now) and not component.missing:
                    self._go_on(component, now)
                self._expect(component, now)

    def _follow_profile(self, component: Component, now: Instant) -> bool:
        """Apply the profile's rules for its name; False if they ignore it."""
        name = component.identity[0]
        component.rule = component_rule(self._profile, name)
        if component.rule is not None and component.rule.ignore:
            self.remove(component)
            return False
        component.values.clear()
        component.values = self._values(name)
        self._count_key_values(component, 0)  # counted again with the next status
        if component.last is not None and component.last.level != STALE:
            component.values.update(component.last.values)
        before = component.last_recorded
        if component.level >= OK and component.follow_rule(now):
            self._changed(component, before, now)
        return True

    def parse_values(self) -> None:
        """Parse the numbers that were not yet read; see `ComponentValues`."""
        for component in self.by_identity.values():
            if component.feed is None or component.has_numbers:  # of most without a call
                component.values.parse()

    # -- levels ------------------------------------------------------------------------------

    def update(self, component: Component, status: Status, now: Instant) -> None:
        """Update one component from its status."""
        component.listed = now.mono
        component.missing = component.has_lapsed = False
        if len(status.values) != component.key_values:
            status = self._within_limits(component, status)
        last = component.last
        if last is not None and component.reported == status.level and status[:4] == last[:4]:
            if status is not last:
                self._update_values(component, status, now)
            elif status.level != STALE:
                component.received = now.mono
            return
        reported = status.level
        if reported > STALE and (component.rule is None or reported not in component.rule.levels):
            self._reject("bad_level", component.name)
            reported = ERROR  # as diagnostic_aggregator reads it (status_item.hpp, valToLevel)
        if component.stale_at_source != (status.level == STALE):
            component.stale_at_source = not component.stale_at_source
            self.report_again(component)  # also where it was late, and so STALE, before
        if status.hardware_id:
            component.hardware_id = status.hardware_id
        before = component.last_recorded
        changed = self._apply_level(component, reported, now)
        component.set_message(status.message, always=changed)
        if component.level != before:  # also where a restart was in between
            self._changed(component, before, now)  # after the message was set, which it shows
        self._update_values(component, status, now)
        if component.rule is not None and component.is_on_change:
            self._expect(component, now)

    def _update_values(self, component: Component, status: Status, now: Instant) -> None:
        """Take the key-values of a status whose level and message are taken already."""
        component.last = status
        if component.reported == STALE:
            return
        component.received = now.mono
        if component.values.update(status.values):
            self._marks.note(Mark.VALUE, component)

    def _within_limits(self, component: Component, status: Status) -> Status:
        """The status with no more key-values than one component, and one robot, may have."""
        limit = self._limits.values
        free = max(0, self._limits.robot_series - self._key_values + component.key_values)
        if len(status.values) > min(limit, free):
            self._reject("robot_series_limit" if free < limit else "value_limit", component.name)
            limit = min(limit, free)
            status = status._replace(values=status.values[:limit])
        self._count_key_values(component, len(status.values))
        return status

    def _count_key_values(self, component: Component, count: int) -> None:
        self._key_values += count - component.key_values
        component.key_values = count

    def update_raw(self, component: Component, status: Status, now: Instant) -> None:
        """Update one component from its own topic, where the gaps decide when it is late."""
        component.note_raw(now.mono)
        self.update(component, status, now)
        self._expect(component, now)

    def update_measured(
        self, component: Component, feed: Feed, status: Status, now: Instant
    ) -> None:
        """Update one component from another feed than the robot's own topics."""
        self.set_feed(component, feed)
        component.raw_received = now.mono  # an aggregator that lacks it does not know it
        self.update(component, status, now)
        self._expect(component, now)

    def set_feed(self, component: Component, feed: Feed) -> None:
        """Set by which settings a component that is not the robot's own is late and judged."""
        if component.feed != feed:
            component.feed = feed
            component.suppressed_because = SHADOWED if feed.shadow else ""
            self._marks.note(Mark.LEVEL, component)
            self._marks.note(Mark.CONFIG)

    def report_again(self, component: Component) -> None:
        """Have the judgement of faults take all of a component, as if it had changed."""
        self._marks.note(Mark.LEVEL, component)
        self._marks.note(Mark.VALUE, component)

    def mark_missing(self, component: Component, now: Instant) -> None:
        """Make a component STALE, because its aggregator's array does not have it."""
        component.missing = True
        self._set_level(component, STALE, now)

    def resume_arrays(self, now: Instant) -> None:
        """Note that an array is received, as none was for long: all that is published could be."""
        self.has_arrays, self.arrays_since = True, now.mono
        absence = 0.0 if self.last_array == -inf else now.mono - self.last_array
        self.resume(now, absence, published=True)

    def receives_arrays(self, now: Instant) -> bool:
        """Whether arrays are received."""
        return now.mono - self.last_array <= self.stale_after

    @property
    def stale_after(self) -> float:
        """The seconds without an array after which the robot is silent."""
        return self._profile.stale_after

    def arrays_for(self, now: Instant) -> float:
        """For how many seconds whoever publishes could have, after a time to start."""
        is_so = self.has_arrays and self.receives_arrays(now) and not self._is_lossy
        return now.mono - self.arrays_since - TIME_TO_START if is_so else 0.0

    def resume(self, now: Instant, absence: float, *, published: bool) -> None:
        """Give what is published only on a change its level again: its source is back.

        Those are the robot's arrays, or unless ``published`` the topics of fields. What nobody
        could repeat has not ended: neither ``absence`` counts, nor the time to start.
        """
        for component in self.by_identity.values():
            if component.is_on_change and component.is_published is published:
                component.skip(absence + TIME_TO_START)
                self._go_on(component, now)
                self._expect(component, now)

    def _go_on(self, component: Component, now: Instant) -> None:
        """Give what is published only on a change the level again that was published last."""
        level = component.published
        if component.is_stale and level is not None and level != STALE:
            self._set_level(component, level, now)

    def follow_reading(self, now: Instant, *, lossy: bool, unread: Container[str]) -> None:
        """Have what is STALE judged again, as too many messages are lost or no longer are.

        What is published only on a change may have been lost, or not read: its time begins anew.
        """
        was_unread = {each for each in self if each.is_on_change and self._is_unread(each)}
        self.arrays_since = now.mono if self._is_lossy else self.arrays_since
        self._is_lossy, self.unread = lossy, unread
        for component in self:
            if component.is_stale:
                self.report_again(component)
            if component in was_unread and not self._is_unread(component):
                component.skip_to(now.mono)
                self._expect(component, now)

    def _is_unread(self, component: Component) -> bool:
        return self._is_lossy or (component.is_of_fields and component.identity[0] in self.unread)

    def mark_all_stale(self, now: Instant) -> None:
        """Make all that the robot publishes STALE, because it is silent."""
        self.has_arrays = False
        for component in self.by_identity.values():
            if component.feed is None:
                self._set_level(component, STALE, now)

    def _set_level(self, component: Component, reported: int, now: Instant) -> None:
        before = component.last_recorded
        self._apply_level(component, reported, now)
        if component.level != before:
            self._changed(component, before, now)

    def _apply_level(self, component: Component, reported: int, now: Instant) -> bool:
        """Set a level, without an event; True if it changed."""
        was_stale = component.reported == STALE
        changed = component.set_reported(reported, now)
        if was_stale != (reported == STALE):
            self._expect(component, now)
        return changed

    # -- time --------------------------------------------------------------------------------

    def mark_late_stale(self, now: Instant, *, up: bool) -> None:
        """Make the components that are late STALE; cheap as long as none can be."""
        if now.mono <= self.next_late:
            return
        self.next_late = inf
        for component in self.by_identity.values():
            due = self._due(component, now, up=up)
            if now.mono > due:
                self._lapse(component, now)
            else:
                self.next_late = min(self.next_late, due)

    def _due(self, component: Component, now: Instant, *, up: bool) -> float:
        """When it is late, or what is published only on a change is over, monotonic."""
        if component.rule is not None and component.is_on_change:
            is_known = self.receives_arrays(now) if component.is_published else up
            return component.ends_at if is_known and not self._is_unread(component) else inf
        if component.is_stale or component.received is None:
            return inf
        return component.received + self._stale_after(component)

    def _lapse(self, component: Component, now: Instant) -> None:
        rule = component.rule
        if rule is None or not component.is_on_change:
            self._set_level(component, STALE, now)
        elif rule.ends_after is not None:
            component.has_lapsed = True
            if component.level != OK or component.values.beyond:
                after = durations.written(rule.ends_after)
                component.said = component.last = None  # what is said again is wrong again
                component.values.clear()
                self._count_key_values(component, 0)
                component.set_message(f"not reported again for {after}", always=True)
                self._set_level(component, OK, now)
            self.report_again(component)  # also its values, of which none may be known now

    def _stale_after(self, component: Component) -> float:
        raw = component.raw_received is not None
        return component.stale_after(self._profile.stale_after, raw=raw)

    def _expect(self, component: Component, now: Instant) -> None:
        """Check for late ones no later than when this one, received now, would be late."""
        if component.rule is not None and component.is_on_change:
            self.next_late = min(self.next_late, component.ends_at)
        else:
            component.threshold = self._stale_after(component)
            self.next_late = min(self.next_late, now.mono + component.threshold)

    def forgettable(self, now: Instant) -> Iterable[Component]:
        """Components long absent that were OK when last received: absence never ends a problem."""
        after = self._profile.forget_after
        for component in self.by_identity.values():
            if now.mono - component.listed > after and component.is_stale and component.was_ok:
                yield component

    # -- checks ------------------------------------------------------------------------------

    def count_checks(self) -> Iterator[tuple[str, list[int]]]:
        """For each check of the profile how many of its components have each level."""
        if max(self._marks.at[Mark.NAMES], self._marks.at[Mark.CONFIG]) > self._checked_at:
            self._checked_at = self._marks.count
            self._checked = [
                (
                    check.name,
                    [each for each in self if check_matches(check, each.group, each.name)],
                )
                for check in self._profile.checks
            ]
        for name, components in self._checked:
            counts = [0, 0, 0, 0]
            for component in components:
                if component.level >= OK:
                    counts[component.level] += 1
            yield name, counts
