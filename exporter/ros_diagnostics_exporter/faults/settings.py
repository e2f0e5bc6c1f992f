"""What the config says about the faults of one robot or component; all times in seconds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType


@dataclass(frozen=True)
class RobotSettings:
    """What holds for one robot.

    ``presence_interval`` lies between two of the 21 states in which a robot's coming and going is
    counted, ``flap_interval`` between two of a component.
    """

    labels: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    confirm_after: float = 10.0
    flap_interval: float = 15.0
    presence_interval: float = 60.0

    @property
    def site(self) -> str:
        """The site whose robots may fall silent together; "" is one too."""
        return self.labels.get("site", "")

    @property
    def uplink(self) -> str:
        """The robot-like entry through which it is reached; "" where there is none."""
        return self.labels.get("uplink", "")


@dataclass(frozen=True)
class ComponentSettings:
    """What holds for one component, the robot's and the fleet's defaults applied.

    ``measured``: by a query rather than by the robot, so also while the robot is not reached.
    ``behind``: the components of its robot, (group, name) each, whose failure explains its own.
    """

    confirm_after: float = 10.0
    planned_stale: bool = False
    stale_is_critical: bool = False
    measured: bool = False
    behind: frozenset[tuple[str, str]] = frozenset()
