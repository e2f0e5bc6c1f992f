"""Histories of check results: what both sides are given, and the notifications that come of it.

Time is counted in ticks. A host or service has one result at each; its track has a letter for each.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

NONE = "."  # no result at this tick
# Results of services, and of hosts.
SERVICE_CODES = {"o": 0, "w": 1, "c": 2, "u": 3}
HOST_CODES = {"u": 0, "d": 1}

Kind = Literal[
    "WARNING",
    "UNKNOWN",
    "CRITICAL",
    "DOWN",
    "UNREACHABLE",
    "RECOVERY",
    "FLAPPINGSTART",
    "FLAPPINGSTOP",
    "DOWNTIMESTART",
    "DOWNTIMEEND",
    "ACKNOWLEDGEMENT",
]


class Notification(NamedTuple):
    """One notification, as Nagios names them: to whom, about what, of which kind."""

    who: str
    what: str
    kind: str

    def __str__(self) -> str:
        return f"{self.kind} {self.what}" + (f" to {self.who}" if self.who != "ops" else "")


class Downtime(NamedTuple):
    """A planned downtime of a host, from before tick ``start`` until before tick ``end``."""

    host: str
    start: int
    end: int


@dataclass(frozen=True)
class History:
    """One history.

    ``services`` are tracks by ``host/service``, ``hosts`` tracks by name (up without one).
    ``attempts`` is max_check_attempts. ``flapping`` switches flap detection on. ``freshness`` is
    in ticks. Before each tick of ``restarts`` the monitoring is restarted. ``reason`` says why a
    difference is on purpose.
    """

    name: str
    services: Mapping[str, str]
    hosts: Mapping[str, str] = field(default_factory=dict)
    attempts: int = 3
    flapping: bool = False
    freshness: int | None = None
    downtimes: tuple[Downtime, ...] = ()
    restarts: tuple[int, ...] = ()
    reason: str = ""

    @property
    def ticks(self) -> int:
        """How many ticks it has."""
        return max(map(len, (*self.services.values(), *self.hosts.values())))

    @property
    def all_hosts(self) -> tuple[str, ...]:
        """Its hosts, those of services first."""
        return tuple(dict.fromkeys([*(each.split("/")[0] for each in self.services), *self.hosts]))

    @property
    def timed(self) -> bool:
        """Whether it matters how long a tick is, not only in which order results come."""
        return bool(self.freshness or self.downtimes)
