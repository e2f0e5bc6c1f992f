"""What fleet.yml's conditions suppress, as problems for people and as events.

The judgement of faults sees none of it: there it is healthy, or not known.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.faults.model import (
    ComponentName,
    Identity,
    ProblemView,
    Reason,
    Scope,
    State,
    severity_of,
)
from ros_diagnostics_exporter.model import Instant, Level
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.conditions import RobotConditions, Suppressed

_STATES = {Level.WARN: State.WARNING, Level.ERROR: State.CRITICAL, Level.STALE: State.STALE}


class _Kept(NamedTuple):
    """One problem that is suppressed, since a Unix time."""

    since: float
    suppressed: Suppressed


class ConditionalProblems:
    """The problems of one robot that its conditions suppress now."""

    def __init__(self) -> None:
        self._kept: dict[Component, dict[Identity, _Kept]] = {}

    def update(
        self,
        component: Component,
        names: tuple[str, ComponentName],
        conditions: RobotConditions,
        now: Instant,
    ) -> Iterator[Event]:
        """Take what a component is like now; ``names`` are the names of its robot and itself.

        What is suppressed only because its condition is not known is no event.
        """
        former = self._kept.pop(component, {})
        kept: dict[Identity, _Kept] = {}
        for identity, suppressed in _troubles(component, names, conditions):
            if suppressed is not None:
                before = former.get(identity)
                since = now.wall if before is None else before.since
                kept[identity] = _Kept(since, suppressed)
            was_known = identity in former and former[identity].suppressed.known
            if was_known != (suppressed is not None and suppressed.known):
                yield _event(identity, suppressed, now)
        if kept:
            self._kept[component] = kept

    def clear(self) -> None:
        """Forget all of them: the robot is silent, or its components have other names."""
        self._kept.clear()

    def views(self) -> Iterator[ProblemView]:
        """All of them."""
        for kept in self._kept.values():
            for identity, each in kept.items():
                yield ProblemView(
                    identity=identity,
                    since=each.since,
                    due=each.since,
                    fault=None,
                    suppressed=Reason.CONDITION,
                    healthy=False,
                    because=each.suppressed.because,
                )


def _troubles(
    component: Component, names: tuple[str, ComponentName], conditions: RobotConditions
) -> Iterator[tuple[Identity, Suppressed | None]]:
    """What is wrong with a component and its values that has a condition, and what that says."""
    robot, (group, name) = names
    rule = component.rule
    if rule is not None and rule.conditions is not None and component.level > Level.OK:
        state = _STATES[Level(component.level)]
        if not (state is State.STALE and component.plans_stale):
            identity = Identity(Scope.COMPONENT, state, "", robot, group, name)
            yield identity, conditions.find(component, rule.conditions)
    for value in () if component.is_stale else component.values.all:
        if value.rule is not None and value.rule.conditions is not None:
            suppressed = conditions.find(component, value.rule.conditions)
            for each in value.beyond:
                yield (
                    Identity(
                        Scope.VALUE,
                        State(each.severity),
                        "",
                        robot,
                        group,
                        name,
                        key=value.key,
                        bound=each.bound,
                    ),
                    suppressed,
                )


def _event(identity: Identity, suppressed: Suppressed | None, now: Instant) -> Event:
    return Event(
        time=now.wall,
        kind="condition",
        robot=identity.robot,
        group=identity.group,
        component=identity.component,
        after="suppressed" if suppressed is not None and suppressed.known else "judged",
        message="" if suppressed is None else suppressed.because,
        scope=identity.scope.value,
        state=identity.state.value,
        key=identity.key,
        bound=identity.bound,
        severity=severity_of(identity),
    )
