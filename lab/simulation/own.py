"""Parts of the exporter itself: what is reported of them, and what has to hold of their faults."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from ros_diagnostics_exporter.events import Event as Observed
from ros_diagnostics_exporter.faults.model import OwnReport
from ros_diagnostics_exporter.model import Level
from simulation.story import ERROR, OK, OWN_PARTS, STALE, TICK, WARN

_LEVEL_OF = {"warning": WARN, "critical": ERROR}
_LATE = 2 * TICK
Found = Iterator[tuple[str, object]]


class _Part(NamedTuple):
    """What was last reported of a part, None where it is no more; times are monotonic.

    ``since``: in the same trouble, whatever was not known in between. ``at``: as it is now.
    """

    level: int | None = OK
    since: float = 0.0
    at: float = 0.0
    known: int | None = OK  # the last level that was not STALE


class OwnParts:
    """The parts as they are, and as they were reported."""

    def __init__(self) -> None:
        self._levels: dict[str, int | None] = dict.fromkeys(OWN_PARTS, OK)
        self._reported = dict.fromkeys(OWN_PARTS, _Part())

    def set(self, part: str, level: int | None) -> None:
        """Let a part be so from now on; None: there is none any more."""
        self._levels[part] = level

    def reports(self, now: float) -> list[OwnReport]:
        """What the exporter finds out now."""
        for part, level in self._levels.items():
            last = self._reported[part]
            if level != last.level:
                known = last.known if level == STALE else level
                since = last.since if known == last.known else now
                self._reported[part] = _Part(level, since, now, known)
        return [
            OwnReport(part, Level(level), f"{part} fails", OWN_PARTS[part])
            for part, level in self._levels.items()
            if level is not None
        ]

    def is_gone(self, part: str) -> bool:
        """Whether there is no such part any more."""
        return self._reported[part].level is None

    @property
    def is_in_trouble(self) -> bool:
        """Whether any part is not OK."""
        return any(level != OK for level in self._levels.values())

    # -- what has to hold --------------------------------------------------------------------

    def began(self, event: Observed, at: float) -> Found:
        """What is wrong with a fault of a part that began."""
        part = self._reported[event.component]
        if part.level != _LEVEL_OF[event.state]:
            yield "a fault of the exporter began whose part is not so", event
        elif at - part.since < OWN_PARTS[event.component] - 1:
            yield "a fault of the exporter began before its time", event

    def ended(self, event: Observed) -> Found:
        """What is wrong with the end of one."""
        part = self._reported[event.component]
        if (event.reason == "removed") is not (part.level is None):
            yield "a fault of the exporter was removed with its part there, or the other way", event
        elif part.level in (STALE, _LEVEL_OF[event.state]):
            yield "a fault of the exporter recovered without a fresh level", event

    def missing(self, faults: Iterable[Observed], now: float, started: float) -> Found:
        """Faults that should have begun or ended by now, of an exporter that started then."""
        lasting = {
            (each.component, _LEVEL_OF[each.state]) for each in faults if each.scope == "exporter"
        }
        for name, part in self._reported.items():
            if part.level == STALE or now - max(part.at, started) < _LATE:
                continue
            for level in _LEVEL_OF.values():
                if level != part.level and (name, level) in lasting:
                    yield "a fault of the exporter lasts whose part works, or is gone", (name, part)
            # One that is started may know nothing of before.
            since = part.since if part.since > started else max(part.at, started)
            due = since + OWN_PARTS[name] + _LATE
            if part.level in (WARN, ERROR) and now > due and (name, part.level) not in lasting:
                yield "a fault of the exporter is missing", (name, part)
