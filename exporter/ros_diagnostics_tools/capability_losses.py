"""Which part that fails would lose what, of the capabilities that /api/v1/capabilities returns."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

from ros_diagnostics_exporter.faults.model import CapabilityState, PartName
from ros_diagnostics_exporter.faults.needs import (
    FINE,
    MISSING,
    NOT_KNOWN,
    AtLeast,
    Bad,
    Need,
    Other,
    Standing,
    WantedCapability,
    outcome,
    parts_of,
)


class Loss(NamedTuple):
    """What the robot loses with a part: ``now``, and if all others worked (``single``)."""

    part: PartName
    now: list[str]
    single: list[str]

    def as_json(self) -> dict[str, Any]:
        """The same for other programs."""
        return {"part": self.part._asdict(), "now": self.now, "single": self.single}


@dataclass(frozen=True)
class Known:
    """Expressions in their order, and how good their parts are, without those in maintenance."""

    wanted: tuple[WantedCapability, ...]
    states: Mapping[PartName, CapabilityState]
    maintained: frozenset[PartName]

    @classmethod
    def of(cls, capabilities: Iterable[Mapping[str, Any]]) -> Known:
        """Read what the exporter returns.

        Raises:
            KeyError, TypeError: It is not what an exporter of this version serves.
        """
        states: dict[PartName, CapabilityState] = {}
        maintained: set[PartName] = set()

        def read(need: Mapping[str, Any]) -> Need:
            if "of" in need:
                degraded = CapabilityState[need["degraded"].upper()]
                return AtLeast(need["k"], tuple(map(read, need["of"])), degraded)
            if "capability" in need:
                return Other(need["capability"])
            if "part" not in need:
                return MISSING
            part = PartName(**{key: need["part"][key] for key in PartName._fields})
            states[part] = CapabilityState[need["part"]["state"].upper()]
            if need["part"]["maintenance"]:
                maintained.add(part)
            return part

        wanted = tuple(
            WantedCapability(each["capability"], read(each["need"]), each["needed"])
            for each in capabilities
        )
        return cls(wanted, states, frozenset(maintained))


def find_losses(known: Known) -> list[Loss]:
    """The parts whose failure loses something, as all parts are now, or if all others worked."""
    now, fine = _judged(known), _judged(known, all_work=True)
    resting: dict[str, frozenset[PartName]] = {}
    for each in known.wanted:
        resting[each.name] = frozenset(parts_of(each.need, resting))
    found = []
    for part, state in known.states.items():
        concerned = [each for each in known.wanted if part in resting[each.name]]
        lost = _judged(known, (concerned, part), now)
        single = _judged(known, (concerned, part), fine, all_work=True)
        loss = Loss(
            part,
            [] if state is CapabilityState.LOST else _worse(concerned, now, lost),
            _worse(concerned, fine, single),
        )
        if loss.now or loss.single:
            found.append(loss)
    return found


def _judged(
    known: Known,
    failed: tuple[list[WantedCapability], PartName] | None = None,
    before: Mapping[str, Standing | None] = MappingProxyType({}),
    *,
    all_work: bool = False,
) -> dict[str, Standing | None]:
    """How good the capabilities are, of ``before`` those again that rest on a part that failed."""

    def look(part: PartName | Other) -> Standing | None:
        if isinstance(part, Other):
            return found[part.name]
        if failed is not None and part == failed[1]:
            return _standing(part, CapabilityState.LOST)
        if all_work:
            return FINE
        return None if part in known.maintained else _standing(part, known.states[part])

    found = dict(before)
    for each in known.wanted if failed is None else failed[0]:
        if all_work or each.applies:
            found[each.name] = outcome(each.need, look)
        else:
            found[each.name] = NOT_KNOWN if each.applies is None else FINE
    return found


def _standing(part: PartName, state: CapabilityState) -> Standing:
    return FINE if state is CapabilityState.OK else Standing(state, {part: Bad(state, 0.0)})


def _worse(
    concerned: list[WantedCapability],
    before: Mapping[str, Standing | None],
    after: Mapping[str, Standing | None],
) -> list[str]:
    """Those that are lost only after it."""
    return [
        each.name
        for each in concerned
        if _is_lost(after[each.name]) and not _is_lost(before[each.name])
    ]


def _is_lost(standing: Standing | None) -> bool:
    return standing is not None and standing.state is CapabilityState.LOST
