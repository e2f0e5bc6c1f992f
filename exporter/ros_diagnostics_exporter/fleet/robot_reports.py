"""What is reported of one robot to the judgement of faults: what changed since it last was."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Literal

from ros_diagnostics_exporter.config.fleet import Profile, Threshold, ValueRule
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.faults.book import UPLINK_TIME
from ros_diagnostics_exporter.faults.engine import Faults
from ros_diagnostics_exporter.faults.model import (
    Change,
    ComponentName,
    ComponentReport,
    ComponentSettings,
    Identity,
    RobotSettings,
    Scope,
    State,
    ValueReport,
    Verdict,
)
from ros_diagnostics_exporter.fleet import dependencies
from ros_diagnostics_exporter.fleet.awaited import Awaited
from ros_diagnostics_exporter.fleet.capabilities import RobotCapabilities
from ros_diagnostics_exporter.fleet.conditional_problems import ConditionalProblems
from ros_diagnostics_exporter.fleet.first_reports import FirstReports
from ros_diagnostics_exporter.model import Instant, Level
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.components import SHADOWED, Components
from ros_diagnostics_exporter.robots.conditions import RobotConditions, Suppressed
from ros_diagnostics_exporter.robots.marks import Mark
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.robots.rules import check_matches, component_rule, value_rule
from ros_diagnostics_exporter.robots.values import ExportedValue

_Presence = Literal["up", "silent", "pending"]
_LEVELS = tuple(Level)
_OK = Level.OK
_NUMBERED = re.compile(r"(#[0-9]+|\[[0-9]+\])+")  # what a key is given beside the published one


class RobotReports:
    """One robot, and what was reported of it.

    ``maintenance``, ``maintained`` and ``cut_off`` are as last reported; ``has_adopted``: another
    process received it, as a fault of it fires.
    """

    def __init__(self, robot: RobotState, events: deque[Event]) -> None:
        self.robot = robot
        self._events = events
        self.maintenance = False
        self.maintained: frozenset[str] = frozenset()
        self.cut_off = False
        self.has_adopted = False
        self._settings = robot.settings
        self._limits = robot.limits
        self._declared = robot.declared
        self._presence: _Presence | None = None
        self._announced: float | None = None  # when a publisher of it was first seen, monotonic
        self._names: dict[Component, ComponentName] = {}
        self._dependencies: dependencies.Dependencies = {}
        self._measured: frozenset[ComponentName] = frozenset()  # by queries, if any depends on any
        self._first: FirstReports | None = None  # since its return, where that matters
        self.read = -1  # the last change that was reported
        self.is_up = False  # was reported, with all of its components
        self._everything = True  # is to be reported, because none of it was, or by other settings
        self._usual = ComponentSettings()  # of components of which fleet.yml says nothing
        self._monitors = False  # values: a rule has thresholds
        self.may_end = False  # what is not repeated: a rule has ends_after
        self._awaited = Awaited(robot)
        self._conditions = RobotConditions(robot)
        self._capabilities = RobotCapabilities(robot)
        self.by_condition = ConditionalProblems()

    # -- config ------------------------------------------------------------------------------

    @property
    def has_other_settings(self) -> bool:
        """Whether the robot follows another config than was reported."""
        robot = self.robot
        same = robot.settings is self._settings and robot.limits is self._limits
        return not same or robot.declared != self._declared

    def configure(self, faults: Faults, now: Instant) -> list[Change]:
        """Report by which config the robot is judged; its parts are reported anew after it."""
        robot = self.robot
        name, profile = robot.settings.name, robot.settings.profile
        self._settings, self._limits = robot.settings, robot.limits
        self._usual = ComponentSettings(profile.confirm_after, False, profile.stale_is_critical)
        self._declared, self._everything = robot.declared, True
        self._monitors = any(rule.thresholds for rule in profile.values)
        self.may_end = any(rule.ends_after is not None for rule in profile.components)
        settings = RobotSettings(
            robot.settings.labels,
            profile.confirm_after,
            profile.flap_interval,
            boot_grace=profile.boot_grace,
        )
        changes = faults.configure_robot(name, settings, now, declared=robot.declared)
        self._capabilities = RobotCapabilities(robot)
        if self._presence is None and profile.capabilities:  # nothing is reported of it yet
            changes += self._report_capabilities(faults, now)
        expected = _expected(profile)
        for identity in list(faults.identities(name)):
            if identity.scope is Scope.CHECK and identity.check not in expected:
                changes += faults.check_changed(name, identity.check, 0, None, now)
        if robot.maintenance != self.maintenance:
            self.maintenance = robot.maintenance
            changes += faults.maintenance({name: robot.maintenance}, now)
        if robot.maintained != self.maintained:
            self.maintained = robot.maintained
            changes += faults.components_in_maintenance(name, robot.maintained, now)
        return changes + self._follow_config(faults, now)

    def start_over(self, faults: Faults, now: Instant) -> list[Change]:
        """Report all of it to another engine, but its downtime."""
        self._presence, self.is_up, self.maintenance = None, False, self.robot.maintenance
        self.maintained, self.cut_off = self.robot.maintained, False
        self._names, self.read = _names(self.robot.components), self.robot.marks.count
        changes, name = self.configure(faults, now), self.robot.settings.name
        return changes + faults.components_in_maintenance(name, self.maintained, now)

    def adopted(self, faults: Faults) -> list[ComponentName]:
        """The components that have problems and were never received here."""
        known = {
            ComponentName(identity.group, identity.component)
            for identity in faults.identities(self.robot.settings.name)
            if identity.component
        }
        return sorted(known.difference(self._names.values()))

    def end_unrepeated(self, faults: Faults, now: Instant) -> list[Change]:
        """End what an earlier process knew, and the robot has not repeated for its ends_after."""
        robot, changes = self.robot.settings, list[Change]()
        arrays_for = self.robot.components.arrays_for(now)
        if arrays_for <= 0.0 or not faults.in_trouble(robot.name):
            return changes
        for name in self.adopted(faults):
            rule = component_rule(robot.profile, name.component)
            after = None if rule is None else rule.ends_after
            if after is not None and arrays_for >= after:
                healthy = ComponentReport(name, Level.OK, ComponentSettings())
                total = len(self.robot.components)
                changes += faults.components_changed(robot.name, [healthy], total, now)
        return changes

    def _follow_config(self, faults: Faults, now: Instant) -> list[Change]:
        """Follow what the config of before the start did not: ignored components, other names."""
        robot, changes = self.robot.settings, list[Change]()
        for name in self.adopted(faults):
            rule = component_rule(robot.profile, name.component)
            if rule is not None and rule.ignore:
                changes += faults.forget_component(robot.name, name, now)
        return changes

    # -- what changed ------------------------------------------------------------------------

    def is_due(self, now: Instant) -> bool:
        """Whether there is anything to report that no mark shows: it is back, silent or late."""
        if self._awaited and self.robot.up and self._awaited.has_found(now):
            return True
        return self._presence_at(now) != self._presence

    def update(self, faults: Faults, now: Instant) -> list[Change]:
        """Report it."""
        presence, changes = self._presence_at(now), list[Change]()
        if presence != self._presence:
            changes += self._report_presence(faults, presence, now)
        marks, profile = self.robot.marks, self.robot.settings.profile
        renamed, anew = marks.at[Mark.NAMES] > self.read, self._everything
        if renamed:
            changes += self._follow_names(faults, now)
        if renamed or self._everything:
            self._follow_dependencies()
        if profile.has_conditions or self._everything:
            self._apply_conditions(now)
        if self.robot.up:
            if self._awaited:
                self._awaited.find(now)
            levels = marks.components(Mark.LEVEL, self.read)
            self._awaited.await_late(levels, now)
            self._note_first(levels)
            changes += self._report_levels(faults, levels, now, renamed=renamed)
            if self._monitors or self._everything:
                changes += self._report_values(faults, now)
            if renamed or self._everything:
                changes += self._report_checks(faults, now)
            self._everything = False
        if profile.capabilities or anew:
            changes += self._report_capabilities(faults, now)
        self.read = marks.count
        self.is_up = self._presence == "up" and not self._awaited
        return changes

    def _changed(self) -> list[Component]:
        """The components of which a level or a value was noted since the last report."""
        marks = self.robot.marks
        return [
            *marks.components(Mark.LEVEL, self.read),
            *marks.components(Mark.VALUE, self.read),
        ]

    def _apply_conditions(self, now: Instant) -> None:
        """Have what depends on what changed reported, where its conditions say something else."""
        components = self.robot.components
        found = self._conditions.update(self._changed(), everything=self._everything)
        for component, differs in found.items():
            name = self._names.get(component)
            suppressed = None if name is None else self._find_suppression(component)
            is_known = self.robot.up and suppressed is not None and suppressed.known
            component.suppressed_because = suppressed.because if suppressed and is_known else ""
            if differs:
                components.report_again(component)
            if name is not None and self.robot.up:
                of = self.robot.settings.name, name
                self._events.extend(self.by_condition.update(component, of, self._conditions, now))

    def _report_capabilities(self, faults: Faults, now: Instant) -> list[Change]:
        name, profile = self.robot.settings.name, self.robot.settings.profile
        wanted = self._capabilities.update(self._changed(), self._names)
        if wanted is None and (profile.capabilities or not faults.capabilities(name)):
            return []
        return faults.configure_capabilities(name, wanted or (), now)

    def _find_suppression(self, component: Component) -> Suppressed | None:
        """Why the component's trouble is no fault, if it is none."""
        if component.feed is not None and component.feed.shadow:
            return Suppressed(SHADOWED, known=True)
        rule = component.rule
        return None if rule is None else self._conditions.find(component, rule.conditions)

    @property
    def mode(self) -> tuple[bool | None, bool | None]:
        """Whether the robot works by itself, and what is an intervention holds; None: not known."""
        return self._conditions.mode

    # -- presence ----------------------------------------------------------------------------

    def _presence_at(self, now: Instant) -> _Presence:
        robot = self.robot
        if robot.up:
            return "up"
        if robot.last_mono is not None:
            return "pending" if robot.is_fleeting and not robot.is_published else "silent"
        if robot.silent_reason == "never_seen":
            self._announced = None
            return "pending"
        if self._announced is None:
            self._announced = now.mono
        # What has just begun to publish has its stale_after to be received.
        late = now.mono - self._announced > robot.settings.profile.stale_after
        return "silent" if late else "pending"

    def _report_presence(self, faults: Faults, presence: _Presence, now: Instant) -> list[Change]:
        robot = self.robot
        self.by_condition.clear()
        is_first, self._presence = self._presence is None, presence
        self._awaited.clear()
        if presence == "pending":
            known = faults.identities(robot.settings.name)
            if is_first and any(each.state is State.SILENT for each in known):
                return []  # an earlier process received it
            return faults.robot_pending(robot.settings.name, now)
        if presence == "silent":
            last = robot.last_mono
            since = now if last is None else Instant(last, robot.last_wall)
            return faults.robot_silent(robot.settings.name, since, now)
        self._everything = True
        self._first = FirstReports(robot) if robot.settings.profile.boot_grace else None
        self._awaited.await_raw(now)
        # What was there before the exporter listened has not booted.
        listened = now.mono - robot.listened_since
        may_boot = listened > robot.settings.profile.stale_after
        return faults.robot_back(robot.settings.name, now, may_boot=may_boot)

    # -- components --------------------------------------------------------------------------

    def find(self, name: ComponentName) -> Component | None:
        """The component that was reported by this name."""
        return next((each for each, known in self._names.items() if known == name), None)

    @property
    def by_name(self) -> dict[ComponentName, Component]:
        """The components by the names by which they were reported."""
        return {name: each for each, name in self._names.items()}

    def name_of(self, component: Component) -> ComponentName | None:
        """The name by which a component was reported."""
        return self._names.get(component)

    def _follow_names(self, faults: Faults, now: Instant) -> list[Change]:
        """Report the components that have gone, and those that have another name."""
        robot, components = self.robot.settings.name, self.robot.components
        names = _names(components)
        changes: list[Change] = []
        for component, old in self._names.items():
            if component not in names:
                changes += faults.forget_component(robot, old, now)
                self._awaited.drop(component)
        for component, new in names.items():
            former = self._names.get(component)
            if former is not None and former != new:
                changes += faults.component_moved(robot, former, new, now)
                components.report_again(component)
        self.by_condition.clear()  # the conditions are evaluated anew
        self._names = names
        return changes

    def _follow_dependencies(self) -> None:
        """Have those reported that depend on others than before."""
        former, self._dependencies = self._dependencies, dependencies.find(self._names)
        measured = (name for each, name in self._names.items() if each.feed is not None)
        self._measured = frozenset(measured if self._dependencies else ())
        for component in former.keys() | self._dependencies.keys():
            differs = former.get(component) != self._dependencies.get(component)
            if differs and component in self._names:
                self.robot.components.report_again(component)

    def _report_levels(
        self, faults: Faults, changed: list[Component], now: Instant, *, renamed: bool
    ) -> list[Change]:
        awaited = self._awaited or ()  # of most robots none is
        reported = [
            self._component_report(component, name)
            for component, name in self._to_report(changed)
            if component not in awaited
        ]
        if not reported and not renamed:
            return []
        robot, total = self.robot.settings.name, len(self.robot.components)
        return faults.components_changed(robot, reported, total, now)

    def _to_report(self, changed: Iterable[Component]) -> Iterator[tuple[Component, ComponentName]]:
        for component in self._names if self._everything else changed:
            name = self._names.get(component)
            if name is not None and component.level >= 0:  # received at least once
                yield component, name

    def _component_report(self, component: Component, name: ComponentName) -> ComponentReport:
        """The component as it is judged: healthy, or not known, where its condition says so."""
        level, settings = _LEVELS[component.level], self._component_settings(component)
        is_first = self._first is not None and component in self._first.now
        is_late = component.is_stale and not component.stale_at_source
        if level is _OK and not is_late:
            return ComponentReport(name, level, settings, is_first)
        suppressed = self._find_suppression(component)
        if self.robot.network.lossy and component.feed is None and is_late:
            suppressed = Suppressed("messages are lost", known=False)
        if is_late and level is _OK:  # as fleet.yml has STALE: no message says so
            suppressed, level = Suppressed("nothing is received", known=False), Level.STALE
        if suppressed is None:
            return ComponentReport(name, level, settings, is_first)
        if suppressed.known and level is not Level.STALE:
            return ComponentReport(name, Level.OK, settings)
        # As a STALE that is planned: nothing begins, and nothing ends.
        settings = replace(settings, planned_stale=True, stale_is_critical=False)
        return ComponentReport(name, Level.STALE, settings)

    def _component_settings(self, component: Component) -> ComponentSettings:
        profile, rule = self._settings.profile, component.rule
        if rule is None and component.feed is None and component not in self._dependencies:
            return self._usual  # of most components, asked for at each change of a level
        own = None if rule is None else rule.confirm_after
        planned = component.plans_stale
        if component.feed is not None:
            own = component.feed.confirm_after if own is None else own
        confirm_after = profile.confirm_after if own is None else own
        depends_on = self._dependencies.get(component, frozenset())
        if depends_on and not self._measured.isdisjoint(depends_on):
            confirm_after += UPLINK_TIME
        return ComponentSettings(
            confirm_after,
            planned,
            profile.stale_is_critical and not planned,
            measured=component.feed is not None and not component.feed.sent,
            uplink=component.is_uplink,
            depends_on=depends_on,
        )

    def _note_first(self, changed: list[Component]) -> None:
        """Note which components were not received since the robot came back, before now."""
        if self._first is not None:
            self._first.note(self._names if self._everything else changed, self._is_judged)

    def _is_judged(self, component: Component) -> bool:
        is_suppressed = self._find_suppression(component) is not None
        return component.level == Level.OK or not (component.is_stale or is_suppressed)

    # -- values and checks -------------------------------------------------------------------

    def _report_values(self, faults: Faults, now: Instant) -> list[Change]:
        robot = self.robot.settings.name
        troubled: dict[ComponentName, list[Identity]] = {}
        for identity in faults.identities(robot):
            if identity.scope is Scope.VALUE:
                name = ComponentName(identity.group, identity.component)
                troubled.setdefault(name, []).append(identity)
        changes: list[Change] = []
        changed = self.robot.marks.components(Mark.VALUE, self.read)
        for component, name in self._to_report(changed):
            reports = self._value_reports(component, troubled.get(name, ()))
            if reports:
                settings = self._component_settings(component)
                changes += faults.values_changed(robot, name, settings, reports, now)
        return changes

    def _value_reports(
        self, component: Component, troubled: Iterable[Identity]
    ) -> list[ValueReport]:
        """Its values with thresholds, and those that had one and are no longer published."""
        found = {
            value.key: self._value_report(component, value, value.rule)
            for value in component.values.all
            if value.rule is not None and value.rule.thresholds
        }
        missing: dict[str, list[Threshold]] = {}
        for each in troubled:
            if each.key not in found:
                # Without a number it does not matter which one the threshold has.
                threshold = Threshold(each.bound, each.state.value, 0.0)
                missing.setdefault(each.key, []).append(threshold)
        for key, thresholds in missing.items():
            wanted = not self._everything or _is_monitored(self._settings.profile, component, key)
            found[key] = ValueReport(key, None, tuple(thresholds) if wanted else ())
        if component.has_lapsed:
            return [each._replace(most=Verdict.HEALTHY) for each in found.values()]
        return list(found.values())

    def _value_report(
        self, component: Component, value: ExportedValue, rule: ValueRule
    ) -> ValueReport:
        if component.is_stale:
            return ValueReport(value.key, None, rule.thresholds)
        most = self._most(component, rule)
        waits = most is Verdict.NO_DATA and bool(value.beyond)  # for its condition to be known
        first = self._first
        is_first = first is not None and first.has_value(component, value.key, waits=waits)
        return ValueReport(value.key, value.number, rule.thresholds, most, is_first)

    def _most(self, component: Component, rule: ValueRule) -> Verdict:
        """The worst that a value's conditions let it be."""
        suppressed = self._conditions.find(component, rule.conditions)
        if suppressed is None:
            return Verdict.FAILING
        return Verdict.HEALTHY if suppressed.known else Verdict.NO_DATA

    def _report_checks(self, faults: Faults, now: Instant) -> list[Change]:
        expected = _expected(self._settings.profile)
        if not expected:
            return []
        robot, changes = self.robot.settings, list[Change]()
        known, adopted = {each.name: each for each in robot.profile.checks}, self.adopted(faults)
        for check, counts in self.robot.components.count_checks():
            if check in expected:
                # Those of adopted faults are there: another process received them.
                found = sum(counts) + sum(check_matches(known[check], *each) for each in adopted)
                changes += faults.check_changed(robot.name, check, found, expected[check], now)
        return changes


def _expected(profile: Profile) -> Mapping[str, int]:
    return {check.name: check.expect for check in profile.checks if check.expect is not None}


def _names(components: Components) -> dict[Component, ComponentName]:
    """The names of a robot's components as their series have them: no two are the same."""
    return {each: ComponentName(each.group, each.label) for each in components}


def _is_monitored(profile: Profile, component: Component, key: str) -> bool:
    """Whether the config has a threshold for a value that is not published now."""
    name = component.identity[0]
    rules = (value_rule(profile, name, each) for each in (key, _NUMBERED.sub("", key)))
    return any(rule is not None and rule.thresholds for rule in rules)
