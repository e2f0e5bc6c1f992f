"""What the config says about faults, resolved; all times in seconds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import ceil
from types import MappingProxyType


@dataclass(frozen=True)
class CauseSettings:
    """From how many on several problems are one: ``number`` and ``share``, or ``absolute``."""

    number: int
    share: float
    absolute: int | None = None

    def needed(self, total: int) -> int:
        """How many of ``total`` have to be in trouble."""
        # The tolerance keeps 0.1 of 30 at 3, whatever floating point makes of it.
        needed = max(1, self.number, ceil(self.share * total - 1e-9))
        return needed if self.absolute is None else min(needed, max(1, self.absolute))


@dataclass(frozen=True)
class FleetSettings:
    """What holds for the whole fleet.

    ``confirm_after`` is that of sites and common causes; ``value_hysteresis`` the share of a
    threshold by which a value has to come back.
    """

    confirm_after: float = 10.0
    restart_grace: float = 30.0
    pending_after: float = 900.0
    flapping_start: float = 0.4
    flapping_stop: float = 0.2
    value_hysteresis: float = 0.02
    many: CauseSettings = CauseSettings(8, 0.5)
    site: CauseSettings = CauseSettings(5, 0.5)
    common: CauseSettings = CauseSettings(5, 0.3, absolute=20)


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


@dataclass(frozen=True)
class ComponentSettings:
    """What holds for one component, the robot's and the fleet's defaults applied."""

    confirm_after: float = 10.0
    planned_stale: bool = False
    stale_is_critical: bool = False
