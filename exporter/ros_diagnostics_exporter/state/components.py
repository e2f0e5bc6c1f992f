"""The components of one robot: made, heard, late, counted, taken out.

Every change of a level goes through here, whether an array, silence or the config made it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from math import inf

from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.model import Instant, Status
from ros_diagnostics_exporter.state.bounds import Budget, Reject, bounded
from ros_diagnostics_exporter.state.component import ERROR, OK, STALE, Component, Identity
from ros_diagnostics_exporter.state.component_values import Values
from ros_diagnostics_exporter.state.rules import check_matches, component_rule, value_rule
from ros_diagnostics_exporter.state.versions import Versions

# How many series a component has at least: level, since, changes, info, problem since, message.
SERIES_OF_COMPONENT = 6


class Members:
    """The components of one robot by their identity.

    ``reject`` is told the reason of what is not taken in; ``changed`` hears (component, level
    before, now) at every change of a level.
    """

    def __init__(
        self,
        profile: config.Profile,
        limits: config.Limits,
        *,
        budget: Budget,
        versions: Versions,
        reject: Reject,
        changed: Callable[[Component, int, Instant], None],
    ) -> None:
        self.all: dict[Identity, Component] = {}
        self.removals = 0  # how many components were ever taken out
        self._profile = profile
        self._limits = limits
        self._budget = budget
        # Of values alone: whatever a robot sends, there is a place for its components' levels.
        self._of_values = Budget(limits.robot_series, budget)
        self._held = 0  # key-values that all components hold
        self._versions = versions
        self._reject = reject
        self._changed = changed
        self._restless: set[Identity] = set()
        # What the judgement of faults has yet to take: emptied by it.
        self.level_changes: dict[Component, None] = {}
        self.value_changes: dict[Component, None] = {}
        self.names_version = 0  # raised when a component comes, goes or has another label
        self._deadline = inf  # when the next component may be late, monotonic
        self._checked: list[tuple[str, list[Component]]] = []
        self._checked_at = -1  # the version of the structure of `_checked`

    # -- come and go -------------------------------------------------------------------------

    def obtain(self, identity: Identity, group: str, now: Instant) -> Component | None:
        """The component of this identity, made if there is room for it and the config wants it."""
        known = self.all.get(identity)
        if known is not None:
            return known
        rule = component_rule(self._profile, identity[0])
        if rule is not None and rule.ignore:
            return None
        if len(self.all) >= self._limits.components:
            self._reject("component_limit", identity[0])
            return None
        limit = self._budget.take(SERIES_OF_COMPONENT)
        if limit is not None:
            self._reject(limit, identity[0])
            return None
        if len(identity[0]) > self._limits.label_length:
            self._reject("label_length", identity[0])
        values = self._values(identity[0])
        component = Component(identity, self._label(identity), rule, values, now)
        self.all[identity] = component
        self._versions.structure += 1
        self.names_version += 1
        self.regroup(component, group)
        return component

    def _values(self, name: str) -> Values:
        profile = self._profile
        return Values(
            (lambda key: value_rule(profile, name, key)) if profile.values else None,
            (self._limits.values, self._limits.label_length),
            self._of_values,
            self._reject,
        )

    def _label(self, identity: Identity) -> str:
        name, _group, parting = identity
        label = f"{name} [{parting}]" if parting else name
        return bounded(label or "(unnamed)", self._limits.label_length)

    def regroup(self, component: Component, group: str) -> None:
        """Put a component into another group."""
        label = bounded(group, self._limits.label_length)
        if component.group != label:
            component.group = label
            self._versions.structure += 1
            self.names_version += 1

    def part(self, name: str) -> None:
        """Give a component whose name proved to be two components' its hardware_id as well."""
        component = self.all.pop((name, "", ""), None)
        if component is not None:
            component.identity = (name, "", component.hardware_id)
            component.name = self._label(component.identity)
            self.all[component.identity] = component
            self._versions.structure += 1
            self.names_version += 1

    def remove(self, component: Component) -> None:
        """Take one component out, with all that is known about it."""
        component.values.clear()
        self._hold(component, 0)
        self._budget.give(SERIES_OF_COMPONENT)
        del self.all[component.identity]
        self._restless.discard(component.identity)
        self.removals += 1
        self.names_version += 1
        self._versions.structure += 1
        self._versions.levels += 1

    def remove_all(self) -> None:
        """Take all components out."""
        for component in list(self.all.values()):
            self.remove(component)

    def configure(self, profile: config.Profile, limits: config.Limits, now: Instant) -> None:
        """Judge every component by another profile."""
        self._profile, self._limits = profile, limits
        self._of_values.limit = limits.robot_series
        for component in list(self.all.values()):
            name = component.identity[0]
            component.rule = component_rule(profile, name)
            if component.rule is not None and component.rule.ignore:
                self.remove(component)
                continue
            component.values.clear()
            component.values = self._values(name)
            self._hold(component, 0)  # counted anew with the next status
            if component.last is not None and component.last.level != STALE:
                component.values.update(component.last.values)
            if component.level >= OK:
                self._set_level(component, component.reported, now)

    # -- levels ------------------------------------------------------------------------------

    def hear(self, component: Component, status: Status, now: Instant) -> None:
        """Take one status of one component."""
        component.listed = now.mono
        if len(status.values) > component.held:
            status = self._within_limits(component, status)
        if status == component.last and component.reported == status.level:
            if status.level != STALE:
                component.heard = now.mono
            return
        said = status.level
        if said > STALE:
            self._reject("bad_level", component.name)
            said = ERROR  # as diagnostic_aggregator reads it (status_item.hpp, valToLevel)
        component.last = status
        self._hold(component, len(status.values))
        if status.hardware_id and status.hardware_id != component.hardware_id:
            component.hardware_id = status.hardware_id
            self._versions.structure += 1
        before = component.level
        changed = self._set_level(component, said, now, notify=False)
        if component.take_message(status.message, renew=changed) and component.level != OK:
            self._versions.levels += 1
        if changed:  # told after the message was taken
            self._changed(component, before, now)
        if said != STALE:
            component.heard = now.mono
            numbers, shape = component.values.update(status.values)
            self._versions.values += numbers
            self._versions.structure += shape
            if numbers or shape:
                self.value_changes[component] = None

    def _within_limits(self, component: Component, status: Status) -> Status:
        """The status with no more key-values than one component, and one robot, may have."""
        most = self._limits.values
        free = max(0, self._limits.robot_series - self._held + component.held)
        if len(status.values) > min(most, free):
            self._reject("robot_series_limit" if free < most else "value_limit", component.name)
            most = min(most, free)
            status = status._replace(values=status.values[:most])
        self._hold(component, len(status.values))
        return status

    def _hold(self, component: Component, values: int) -> None:
        self._held += values - component.held
        component.held = values

    def hear_raw(self, component: Component, status: Status, now: Instant) -> None:
        """Take one status from the component's own topic, whose gaps tell when it is late."""
        component.renew_raw(now.mono, self._stale_after(component))
        self.hear(component, status, now)
        self._expect(component, now)

    def lose(self, component: Component, now: Instant) -> None:
        """Mark a component of which nothing fresh is known any more."""
        self._set_level(component, STALE, now)

    def lose_all(self, now: Instant) -> None:
        """Mark all of them, because the robot is silent."""
        for component in self.all.values():
            self._set_level(component, STALE, now)

    def _set_level(
        self, component: Component, said: int, now: Instant, *, notify: bool = True
    ) -> bool:
        was_stale, before = component.is_stale, component.level
        changed = component.set_reported(said, now, self._profile.flap_interval)
        if was_stale != component.is_stale:  # the numbers of a stale component are not shown
            self._versions.structure += 1
            self.value_changes[component] = None
            self._expect(component, now)
        if changed:
            self._versions.levels += 1
            self.level_changes[component] = None
            if component.flaps is not None and component.flaps.ratio > 0:
                self._restless.add(component.identity)
            if notify:
                self._changed(component, before, now)
        return changed

    # -- time --------------------------------------------------------------------------------

    def calm(self, now: Instant) -> None:
        """Let restless components come to rest."""
        for identity in list(self._restless):
            component = self.all.get(identity)
            flaps = None if component is None else component.flaps
            if flaps is None:
                self._restless.discard(identity)
            elif flaps.rest(now.mono, self._profile.flap_interval):
                self._versions.levels += 1
                if flaps.ratio == 0.0:
                    self._restless.discard(identity)

    def find_late(self, now: Instant) -> None:
        """Mark the components that are late; cheap as long as none can be."""
        if now.mono <= self._deadline:
            return
        self._deadline = inf
        for component in self.all.values():
            if component.is_stale or component.heard is None:
                continue
            due = component.heard + self._stale_after(component)
            if now.mono > due:
                self._set_level(component, STALE, now)
            else:
                self._deadline = min(self._deadline, due)

    def _stale_after(self, component: Component) -> float:
        raw = component.heard_raw is not None
        return component.stale_after(self._profile.stale_after, raw=raw)

    def _expect(self, component: Component, now: Instant) -> None:
        """Look at the late ones no later than when this one, heard now, would be late."""
        self._deadline = min(self._deadline, now.mono + self._stale_after(component))

    def forgettable(self, now: Instant) -> Iterable[Component]:
        """Components long gone that were OK when last received: absence never ends a problem."""
        after = self._profile.forget_after
        for component in self.all.values():
            gone = now.mono - component.listed > after and component.is_stale
            if gone and component.was_ok:
                yield component

    # -- asked -------------------------------------------------------------------------------

    def count_checks(self) -> Iterator[tuple[str, list[int]]]:
        """For each check of the profile how many of its components stand at each level."""
        if self._checked_at != self._versions.structure:
            self._checked_at = self._versions.structure
            self._checked = [
                (check.name, [each for each in self.all.values() if _holds(check, each)])
                for check in self._profile.checks
            ]
        for name, components in self._checked:
            counts = [0, 0, 0, 0]
            for component in components:
                if component.level >= OK:
                    counts[component.level] += 1
            yield name, counts


def _holds(check: config.Check, component: Component) -> bool:
    return check_matches(check, component.group, component.name)
