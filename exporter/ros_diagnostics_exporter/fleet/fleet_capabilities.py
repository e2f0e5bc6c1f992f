"""What a fleet can do: fleet.yml's expressions, resolved to the robots that it has."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from ros_diagnostics_exporter.config import capabilities as config
from ros_diagnostics_exporter.config.capabilities import CapabilityOf, RobotsOf, in_order
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.fleet import Robot as Settings
from ros_diagnostics_exporter.faults.model import Ability, PartName
from ros_diagnostics_exporter.faults.needs import (
    MISSING,
    AtLeast,
    Need,
    NeedView,
    Other,
    WantedCapability,
)

_MOST_NAMED = 5  # robots
_LENGTH = 512  # characters
_WHY = {
    Ability.LOST: "has lost",
    Ability.DEGRADED: "is degraded in",
    Ability.UNKNOWN: "may not have",
}


def wanted(fleet: Fleet, robots: Iterable[Settings]) -> list[WantedCapability]:
    """What the fleet can do, each after those that it needs; ``robots`` are all that it has."""
    known = sorted(robots, key=lambda each: each.name)
    return [
        WantedCapability(name, _resolved(fleet.capabilities[name].need, fleet, known))
        for name in in_order(fleet.capabilities)
    ]


def _resolved(need: config.Expression, fleet: Fleet, robots: list[Settings]) -> AtLeast:
    """The expression of these robots; what is lacking of k is missing."""
    found: dict[Need, None] = {}  # each once, whatever selects it
    for each in need.of:
        found.update(dict.fromkeys(_elements(each, fleet, robots)))
    least = 1 if need.k is None else need.k
    missing = [MISSING] * max(0, least - len(found))
    return AtLeast(need.k, (*found, *missing), Ability[need.degraded.upper()])


def _elements(need: config.Need, fleet: Fleet, robots: list[Settings]) -> Iterator[Need]:
    if isinstance(need, config.Expression):
        yield _resolved(need, fleet, robots)
    elif isinstance(need, CapabilityOf):
        yield Other(need.name)
    elif isinstance(need, RobotsOf):
        for robot in robots:
            labels = {**robot.labels, "fleet": fleet.name, "robot": robot.name}
            if need.capability in robot.profile.capabilities and need.selects(labels):
                yield PartName(check=need.capability, robot=robot.name)


def counts(view: NeedView) -> dict[str, int]:
    """How many robots can (ok), and cannot: degraded, lost, unknown; or are in maintenance."""
    found = dict.fromkeys(("ok", "degraded", "lost", "unknown", "maintenance"), 0)
    for part, ability in view.parts.items():
        can = "ok" if ability is Ability.NO_RESERVE else ability.name.lower()
        found["maintenance" if part in view.maintained else can] += 1
    return found


def evidence(view: NeedView) -> str:
    """How many robots can, and which cannot and why, in lines."""
    numbers, planned = counts(view), view.maintained
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
