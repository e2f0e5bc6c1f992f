"""What a robot, or a fleet, can do: fleet.yml's expressions, resolved to the parts that it has."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping

from ros_diagnostics_exporter.config import capabilities as config
from ros_diagnostics_exporter.config.capabilities import (
    CapabilityOf,
    CheckOf,
    ComponentsOf,
    RobotsOf,
    in_order,
)
from ros_diagnostics_exporter.config.fleet import Fleet, Profile
from ros_diagnostics_exporter.config.fleet import Robot as Settings
from ros_diagnostics_exporter.faults.model import (
    CapabilityState,
    CapabilityView,
    ComponentName,
    PartName,
)
from ros_diagnostics_exporter.faults.needs import (
    MISSING,
    AtLeast,
    Need,
    NeedView,
    Other,
    WantedCapability,
)
from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.conditions import Watch
from ros_diagnostics_exporter.robots.marks import Mark
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.robots.rules import SEARCHED, check_matches, key_matches

_Names = Mapping[Component, ComponentName]


class RobotCapabilities:
    """Those of one robot, as they are to be judged."""

    def __init__(self, robot: RobotState) -> None:
        self._robot = robot
        self._read = -1  # the last change that `_wanted` is made of
        self._wanted: list[WantedCapability] = []  # each after those that it needs
        self._watches: dict[str, list[Watch]] = {}  # by the capability that is needed `when`
        self._watched: dict[Component, list[Watch]] = {}

    def update(self, changed: Iterable[Component], names: _Names) -> list[WantedCapability] | None:
        """Take the components that changed; what the robot can do, None where that is as before."""
        marks = self._robot.marks
        if marks.last(Mark.NAMES, Mark.SERIES, Mark.CONFIG) > self._read:
            self._read = marks.count
            return self._differs(self._start_over(self._robot.settings.profile, names))
        if not self._watched:
            return None
        for component in changed:
            for watch in self._watched.get(component, ()):
                watch.update(component)
        return self._differs(
            [each._replace(applies=self._applies(each.name)) for each in self._wanted]
        )

    def _differs(self, wanted: list[WantedCapability]) -> list[WantedCapability] | None:
        if wanted == self._wanted:
            return None
        self._wanted = wanted
        return wanted

    def _start_over(self, profile: Profile, names: _Names) -> list[WantedCapability]:
        self._watches, self._watched = {}, {}
        for name, capability in profile.capabilities.items():
            self._watches[name] = [Watch(each) for each in capability.when]
            for watch in self._watches[name]:
                for component in _named(names, watch.condition.component):
                    self._watched.setdefault(component, []).append(watch)
                    watch.update(component)
        return [
            WantedCapability(
                name,
                _resolved(profile.capabilities[name].need, profile, names),
                self._applies(name),
            )
            for name in in_order(profile.capabilities)
        ]

    def _applies(self, name: str) -> bool | None:
        """Whether all conditions hold; None where one is not known and none does not."""
        holds = [watch.holds for watch in self._watches[name]]
        if False in holds:
            return False
        return None if None in holds else True


def _named(names: _Names, patterns: Iterable[Pattern]) -> Iterator[Component]:
    for component in names:
        name = component.identity[0][:SEARCHED]
        if any(pattern.search(name) for pattern in patterns):
            yield component


def _resolved(need: config.Expression, profile: Profile, names: _Names) -> AtLeast:
    """The expression of what the robot has; what it lacks is missing where it is needed."""
    found: dict[Need, None] = {}  # each once, whatever it is named by
    for each in need.of:
        own = list(_elements(each, profile, names))
        if not own and need.k is None:
            own = [MISSING]
        found.update(dict.fromkeys(own))
    lacking = 0 if need.k is None else max(0, need.k - len(found))
    degraded = CapabilityState[need.degraded.upper()]
    return AtLeast(need.k, (*found, *[MISSING] * lacking), degraded)


def _elements(need: config.Need, profile: Profile, names: _Names) -> Iterator[Need]:
    if isinstance(need, config.Expression):
        yield _resolved(need, profile, names)
    elif isinstance(need, CapabilityOf):
        yield Other(need.name)
    elif isinstance(need, CheckOf):
        check = next(each for each in profile.checks if each.name == need.name)
        own = (PartName(*of) for of in names.values() if check_matches(check, *of))
        yield AtLeast(None, (PartName(check=check.name), *own))
    elif isinstance(need, ComponentsOf):
        for component in _named(names, need.patterns):
            part = PartName(*names[component])
            if not need.keys:
                yield part
                continue
            for value in component.values.all:
                if any(key_matches(pattern, value.key) for pattern in need.keys):
                    yield part._replace(key=value.key)


# -- in words ----------------------------------------------------------------------------------

_CLAUSES = (  # in the order of a sentence that begins with "The robot"
    (CapabilityState.LOST, "has lost", " and "),
    (CapabilityState.DEGRADED, "is degraded in", " and "),
    (CapabilityState.NO_RESERVE, "has no reserve for", " and "),
    (CapabilityState.UNKNOWN, "may not have", " or "),
    (CapabilityState.OK, "still has", " and "),
)


def capabilities_text(capabilities: Mapping[str, CapabilityView]) -> str:
    """Such as "has lost lifting, still has driving and charging"; "" where none are named."""
    clauses = []
    for state, words, joint in _CLAUSES:
        names = [name for name, each in capabilities.items() if each.state is state]
        if names:
            clauses.append(f"{words} {joint.join(names)}")
    return ", ".join(clauses)


# -- what a fleet can do -------------------------------------------------------------------------


_MOST_NAMED = 5  # robots
_LENGTH = 512  # characters
_WHY = {
    CapabilityState.LOST: "has lost",
    CapabilityState.DEGRADED: "is degraded in",
    CapabilityState.UNKNOWN: "may not have",
}


def wanted_of_fleet(fleet: Fleet, robots: Iterable[Settings]) -> list[WantedCapability]:
    """What the fleet can do, each after those that it needs; ``robots`` are all that it has."""
    known = sorted(robots, key=lambda each: each.name)
    return [
        WantedCapability(name, _of_robots(fleet.capabilities[name].need, fleet, known))
        for name in in_order(fleet.capabilities)
    ]


def _of_robots(need: config.Expression, fleet: Fleet, robots: list[Settings]) -> AtLeast:
    """The expression of these robots; what is lacking of k is missing."""
    found: dict[Need, None] = {}  # each once, whatever selects it
    for each in need.of:
        found.update(dict.fromkeys(_robots_of(each, fleet, robots)))
    least = 1 if need.k is None else need.k
    missing = [MISSING] * max(0, least - len(found))
    return AtLeast(need.k, (*found, *missing), CapabilityState[need.degraded.upper()])


def _robots_of(need: config.Need, fleet: Fleet, robots: list[Settings]) -> Iterator[Need]:
    if isinstance(need, config.Expression):
        yield _of_robots(need, fleet, robots)
    elif isinstance(need, CapabilityOf):
        yield Other(need.name)
    elif isinstance(need, RobotsOf):
        for robot in robots:
            labels = {**robot.labels, "fleet": fleet.name, "robot": robot.name}
            if need.capability in robot.profile.capabilities and need.selects(labels):
                yield PartName(check=need.capability, robot=robot.name)


def robot_counts(view: NeedView) -> dict[str, int]:
    """How many robots can (ok), and cannot: degraded, lost, unknown; or are in maintenance."""
    found = dict.fromkeys(("ok", "degraded", "lost", "unknown", "maintenance"), 0)
    for part, state in view.parts.items():
        can = "ok" if state is CapabilityState.NO_RESERVE else state.name.lower()
        found["maintenance" if part in view.maintained else can] += 1
    return found


def fleet_evidence(view: NeedView) -> str:
    """How many robots can, and which cannot and why, in lines."""
    numbers, planned = robot_counts(view), view.maintained
    lines = [f"{numbers['ok'] + numbers['degraded']} of {len(view.parts)} robots can"]
    if planned:
        lines[0] += f", {len(planned)} in maintenance"
    others = [
        f"{part.robot} {_WHY[found]} {part.check}"
        for part, found in view.parts.items()
        if found in _WHY and part not in planned
    ]
    more = len(others) - _MOST_NAMED
    lines += [*others[:_MOST_NAMED], *([f"and {more} more"] if more > 0 else [])]
    return ";\n".join(lines)[:_LENGTH]
