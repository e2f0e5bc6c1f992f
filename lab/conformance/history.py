"""Histories of check results: what both sides are given, and the notifications that come of it.

Time is counted in ticks. A host or service has one result at each; its track has a letter for each.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

NONE = "."  # no result at this tick
AGAIN = " again"
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
        word, again, _ = self.kind.partition(AGAIN)
        return f"{word} {self.what}{again}" + (f" to {self.who}" if self.who != "ops" else "")


def marked(notifications: Sequence[Notification]) -> list[Notification]:
    """The same with one `again` for what is sent to somebody again and again."""
    found: list[Notification] = []
    last: dict[tuple[str, str], str] = {}
    for who, what, kind in notifications:
        before = last.get((who, what), "")
        if kind == before.removesuffix(AGAIN):
            if before == kind:
                last[who, what] = kind + AGAIN
                found.append(Notification(who, what, kind + AGAIN))
        else:
            last[who, what] = kind
            found.append(Notification(who, what, kind))
    return found


class Downtime(NamedTuple):
    """A planned downtime of a host, from before tick ``start`` until before tick ``end``."""

    host: str
    start: int
    end: int


class Acknowledgement(NamedTuple):
    """Somebody acknowledges what is wrong after the results of a tick.

    One that is not ``sticky`` ends with the next change of state. ``notify`` sends it to others.
    """

    what: str
    tick: int
    sticky: bool = True
    notify: bool = False


class Escalation(NamedTuple):
    """Of what is wrong, the notifications from ``first`` to ``last`` (0: all) go to ``who``."""

    who: str
    first: int
    last: int = 0


HOURS_CHANGE = 6  # the tick before which the hours of a `Hours` begin or end


class Hours(NamedTuple):
    """When notifications are sent: those about a service, or those to a contact.

    They ``begin`` before tick HOURS_CHANGE, or end then.
    """

    of: Literal["service", "contact"]
    begin: bool


@dataclass(frozen=True)
class History:
    """One history.

    ``services`` are tracks by ``host/service``, ``hosts`` tracks by name (up without one).
    ``attempts`` is max_check_attempts. ``flapping`` switches flap detection on. ``freshness`` is
    in ticks. Before each tick of ``restarts`` the monitoring is restarted. ``parents`` are the
    hosts behind which others are (host -> parent); they are no robots, and hosts behind one are
    notified as UNREACHABLE where ``unreachable`` is set. ``repeat`` is notification_interval in
    ticks, None for never. ``reason`` says why a difference is on purpose.
    """

    name: str
    services: Mapping[str, str]
    hosts: Mapping[str, str] = field(default_factory=dict)
    attempts: int = 3
    flapping: bool = False
    freshness: int | None = None
    downtimes: tuple[Downtime, ...] = ()
    restarts: tuple[int, ...] = ()
    parents: Mapping[str, str] = field(default_factory=dict)
    unreachable: bool = False
    repeat: int | None = None
    acknowledgements: tuple[Acknowledgement, ...] = ()
    escalations: tuple[Escalation, ...] = ()
    hours: Hours | None = None
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
        return bool(self.freshness or self.downtimes or self.hours or self.of_people)

    @property
    def robots(self) -> tuple[str, ...]:
        """Its hosts but for those that are only parents of others."""
        parents = set(self.parents.values())
        return tuple(each for each in self.all_hosts if each not in parents)

    @property
    def of_people(self) -> bool:
        """Whether it is about whom Alertmanager notifies, not only about what is a fault."""
        to_contacts = self.hours is not None and self.hours.of == "contact"
        return bool(self.repeat or self.acknowledgements or self.escalations or to_contacts)
