"""Whose trouble fleet.yml's `when` and `unless` say is no fault now, for one robot.

A condition holds, does not hold, or is not known, because what it asks about was never received or
is STALE. What is not known suppresses nothing that `unless` names, and lets neither begin nor end
what `when` names. Conditions read levels and values, never faults, so that there are no circles.

What is evaluated is what changed: a condition keeps which of its components meet it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from math import isnan
from typing import NamedTuple

from ros_diagnostics_exporter.config.conditions import Condition, Conditions
from ros_diagnostics_exporter.config.fleet import Profile
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.marks import Mark
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.robots.rules import SEARCHED, key_matches


class Suppressed(NamedTuple):
    """Why trouble is no fault; ``known`` is False where a condition of `when` is not known."""

    because: str
    known: bool


class RobotConditions:
    """The conditions of one robot's components and values."""

    def __init__(self, robot: RobotState) -> None:
        self._robot = robot
        self._read = -1  # the last change of names that was read
        self._watches: dict[tuple[Component | None, Condition], Watch] = {}
        self._watched: dict[Component, list[Watch]] = {}  # by a component that they ask about
        self._conditional: dict[Component, tuple[Conditions, ...]] = {}
        self._suppressed: dict[tuple[Component, Conditions], Suppressed] = {}
        self._autonomous: Watch | None = None
        self._interventions: list[Watch] = []

    @property
    def mode(self) -> tuple[bool | None, bool | None]:
        """Whether the robot works by itself, and what is an intervention holds; None: not known."""
        stopped = {each.holds for each in self._interventions}
        is_stopped = True in stopped or (None if None in stopped else False)
        return (None if self._autonomous is None else self._autonomous.holds), is_stopped

    def find(self, component: Component, conditions: Conditions | None) -> Suppressed | None:
        """Why the trouble of a component, or a value of it, is no fault now; None: it is one."""
        return None if conditions is None else self._suppressed.get((component, conditions))

    def update(self, changed: Iterable[Component], *, everything: bool) -> dict[Component, bool]:
        """Take the components that changed, or all of them.

        Returns those with conditions that changed or depend on what did, and whether the conditions
        say something else of them than before.
        """
        profile, names = self._robot.settings.profile, self._robot.marks.at[Mark.NAMES]
        if not (profile.has_conditions or self._conditional):
            return {}
        if everything or names > self._read:
            self._read = names
            return self._start_over(profile)
        touched: dict[Component, None] = {}
        for component in changed:
            if component in self._conditional:
                touched[component] = None
            for watch in self._watched.get(component, ()):
                if watch.update(component):
                    touched.update(dict.fromkeys(watch.dependents))
        return {component: self._judge(component) for component in touched}

    def _start_over(self, profile: Profile) -> dict[Component, bool]:
        """Find what depends on what, and evaluate all of it."""
        former = self._conditional
        self._watches, self._watched, self._conditional, self._suppressed = {}, {}, {}, {}
        for component in self._robot.components:
            found = tuple(dict.fromkeys(_conditions_of(component, profile)))
            if found:
                self._conditional[component] = found
                for conditions in found:
                    for condition in (*conditions.when, *conditions.unless):
                        self._watch(component, condition).dependents.append(component)
        modes = profile.modes
        self._autonomous = None if modes is None else self._watch(None, modes.condition)
        interventions = modes.interventions if modes else ()
        self._interventions = [self._watch(None, each) for each in interventions]
        for component in self._conditional:
            self._judge(component)
        return dict.fromkeys((*former, *self._conditional), True)

    def _watch(self, component: Component | None, condition: Condition) -> Watch:
        asked = None if condition.component else component
        key = (asked, condition)
        watch = self._watches.get(key)
        if watch is None:
            watch = self._watches[key] = Watch(condition)
            for each in self._named(condition) if asked is None else [asked]:
                self._watched.setdefault(each, []).append(watch)
                watch.update(each)
        return watch

    def _named(self, condition: Condition) -> Iterator[Component]:
        for each in self._robot.components:
            name = each.identity[0][:SEARCHED]
            if any(pattern.search(name) for pattern in condition.component):
                yield each

    def _judge(self, component: Component) -> bool:
        differs = False
        for conditions in self._conditional[component]:
            suppressed = self._why_suppressed(component, conditions)
            before = self._suppressed.pop((component, conditions), None)
            if suppressed is not None:
                self._suppressed[component, conditions] = suppressed
            differs = differs or suppressed != before
        return differs

    def _why_suppressed(self, component: Component, conditions: Conditions) -> Suppressed | None:
        for condition in conditions.unless:
            if self._holds(component, condition):
                return Suppressed(f"unless {condition.text}", known=True)
        unknown = None
        for condition in conditions.when:
            if component.is_stale and not condition.component:
                continue  # its own values say nothing about why it is STALE
            holds = self._holds(component, condition)
            if holds is False:
                return Suppressed(f"only when {condition.text}", known=True)
            if holds is None and unknown is None:
                unknown = Suppressed(f"only when {condition.text}, which is not known", known=False)
        return unknown

    def _holds(self, component: Component, condition: Condition) -> bool | None:
        return self._watches[None if condition.component else component, condition].holds


class Watch:
    """One condition, and whether each of the components that it asks about meets it."""

    __slots__ = ("_meet", "condition", "dependents")

    def __init__(self, condition: Condition) -> None:
        self.condition = condition
        self.dependents: list[Component] = []
        self._meet: dict[Component, bool | None] = {}  # None: not known

    @property
    def holds(self) -> bool | None:
        """Whether any component meets it; None where none does and one is not known."""
        found = self._meet.values()
        if True in found:
            return True
        return None if None in found or not found else False

    def update(self, component: Component) -> bool:
        """Take what a component is like now; whether that makes a difference."""
        before = self.holds
        self._meet.pop(component, None)
        if _is_asked(self.condition, component):
            stale = component.is_stale
            self._meet[component] = None if stale else _meets(self.condition, component)
        return self.holds is not before


def _is_asked(condition: Condition, component: Component) -> bool:
    """Whether the component has what the condition is about, as far as it is known."""
    if condition.levels:
        return True
    last = component.last
    return component.is_stale if last is None else any(_pairs(condition, component))


def _meets(condition: Condition, component: Component) -> bool | None:
    """Whether it is like that; None where a number is asked for and there is none."""
    if condition.levels:
        return component.level in condition.levels
    if condition.texts:
        return any(
            pattern.fullmatch(text.strip()[:SEARCHED])
            for _row, text in _pairs(condition, component)
            for pattern in condition.texts
        )
    pairs = component.last.values if component.last is not None else ()
    exported = component.values.exported(pairs)
    numbers = [
        value.number
        for row, _text in _pairs(condition, component)
        for value in exported[row]
        if not isnan(value.number)
    ]
    return _is_between(condition, numbers) if numbers else None


def _is_between(condition: Condition, numbers: Iterable[float]) -> bool:
    return any(
        (condition.below is None or number < condition.below)
        and (condition.above is None or number > condition.above)
        for number in numbers
    )


def _pairs(condition: Condition, component: Component) -> Iterator[tuple[int, str]]:
    """Number and text of each key-value that the condition is about."""
    pairs = component.last.values if component.last is not None else ()
    for row, (key, text) in enumerate(pairs):
        if any(key_matches(pattern, key) for pattern in condition.key):
            yield row, text


def _conditions_of(component: Component, profile: Profile) -> Iterator[Conditions]:
    """Those of the component's faults and of its values'."""
    if component.rule is not None and component.rule.conditions is not None:
        yield component.rule.conditions
    name = component.identity[0][:SEARCHED]
    for rule in profile.values:
        if rule.conditions is not None and (rule.component is None or rule.component.search(name)):
            yield rule.conditions
