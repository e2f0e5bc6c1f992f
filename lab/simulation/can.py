"""What the robots of a simulation can do, and the components that they need for it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from ros_diagnostics_exporter.config.capabilities import (
    Capability,
    CapabilityOf,
    ComponentsOf,
    Expression,
    FleetCapability,
    RobotsOf,
)
from ros_diagnostics_exporter.regex import Pattern
from simulation.story import COMPONENTS


class _Can(NamedTuple):
    """At least ``k`` of what follows: numbers of components, and names of others."""

    k: int
    of: tuple[int | str, ...]


CAN = {
    "view": _Can(1, (1, 2)),
    "around": _Can(2, (3, 4, 5)),
    "driving": _Can(2, ("view", 6)),
    "docking": _Can(2, (2, 7)),
}


def capabilities() -> Mapping[str, Capability]:
    """The same in fleet.yml's terms."""
    return {
        name: Capability(
            name,
            Expression(
                each.k,
                tuple(
                    CapabilityOf(of)
                    if isinstance(of, str)
                    else ComponentsOf((Pattern(COMPONENTS[of]),))
                    for of in each.of
                ),
            ),
        )
        for name, each in CAN.items()
    }


# Of the fleet: so many robots have to be able to do this.
TOGETHER, NEEDED, EACH = "transport", 5, "driving"


def of_fleet() -> Mapping[str, FleetCapability]:
    """What the fleet can do while enough of its robots can."""
    need = Expression(NEEDED, (RobotsOf(EACH, {}),))
    return {TOGETHER: FleetCapability(TOGETHER, need)}


def leaves(name: str) -> set[str]:
    """The components that a capability rests on."""
    found: set[str] = set()
    for of in CAN[name].of:
        found |= leaves(of) if isinstance(of, str) else {COMPONENTS[of]}
    return found


def leaves_of_all() -> set[str]:
    """The components that any capability rests on."""
    return set().union(*map(leaves, CAN))
