"""What fleet.yml's conditions keep quiet, as problems for people and as events.

The judgement of faults sees none of it: there it is well, or not known.
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
from ros_diagnostics_exporter.robots.conditions import Quiet, RobotConditions

_STATES = {Level.WARN: State.WARNING, Level.ERROR: State.CRITICAL, Level.STALE: State.STALE}


class _Kept(NamedTuple):
    """One problem that is kept quiet, since a Unix time."""

    since: float
    quiet: Quiet


class ConditionalProblems:
    """The problems of one robot that its conditions keep quiet now."""

    def __init__(self) -> None:
        self._kept: dict[Component, dict[Identity, _Kept]] = {}

    def update(
        self,
        component: Component,
        of: tuple[str, ComponentName],
        conditions: RobotConditions,
        now: Instant,
    ) -> Iterator[Event]:
        """Take what a component is like now; ``of`` are the names of its robot and itself.

        What is quiet only because its condition is not known is no event.
        """
        former = self._kept.pop(component, {})
        kept: dict[Identity, _Kept] = {}
        for identity, quiet in _troubles(component, of, conditions):
            if quiet is not None:
                before = former.get(identity)
                since = now.wall if before is None else before.since
                kept[identity] = _Kept(since, quiet)
            was_known = identity in former and former[identity].quiet.known
            if was_known != (quiet is not None and quiet.known):
                yield _event(identity, quiet, now)
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
                    because=each.quiet.because,
                )


def _troubles(
    component: Component, of: tuple[str, ComponentName], conditions: RobotConditions
) -> Iterator[tuple[Identity, Quiet | None]]:
    """What is wrong with a component and its values that has a condition, and what that says."""
    robot, (group, name) = of
    rule = component.rule
    if rule is not None and rule.conditions is not None and component.level > Level.OK:
        state = _STATES[Level(component.level)]
        if not (state is State.STALE and rule.planned_stale):
            identity = Identity(Scope.COMPONENT, state, "", robot, group, name)
            yield identity, conditions.find(component, rule.conditions)
    for value in () if component.is_stale else component.values.all:
        if value.rule is not None and value.rule.conditions is not None:
            quiet = conditions.find(component, value.rule.conditions)
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
                    quiet,
                )


def _event(identity: Identity, quiet: Quiet | None, now: Instant) -> Event:
    return Event(
        time=now.wall,
        kind="condition",
        robot=identity.robot,
        group=identity.group,
        component=identity.component,
        after="quiet" if quiet is not None and quiet.known else "judged",
        message="" if quiet is None else quiet.because,
        scope=identity.scope.value,
        state=identity.state.value,
        key=identity.key,
        bound=identity.bound,
        severity=severity_of(identity),
    )
