"""What capabilities need: expressions over the parts of one robot, and how good these are. Pure.

An expression is as good as the k-th best of what it lists: so it is never better than its parts
say. Where just k of more can be used, it has no reserve.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import inf
from types import MappingProxyType
from typing import NamedTuple

from ros_diagnostics_exporter.faults.model import CapabilityState, PartName


@dataclass(frozen=True)
class AtLeast:
    """At least ``k`` of what follows; None: all of it.

    ``degraded`` is what each of these counts as where it is degraded.
    """

    k: int | None
    of: tuple[Need, ...]
    degraded: CapabilityState = CapabilityState.DEGRADED


@dataclass(frozen=True)
class Other:
    """Another capability of the robot."""

    name: str


@dataclass(frozen=True)
class Missing:
    """What was never received, or rests on a condition that is not known."""


Need = PartName | AtLeast | Other | Missing
MISSING = Missing()


class WantedCapability(NamedTuple):
    """A capability of fleet.yml; ``applies``: whether it is needed now, if that is known."""

    name: str
    need: Need
    applies: bool | None = True


class Bad(NamedTuple):
    """How bad a part is, and when (monotonic) it has been so for its confirm_after."""

    state: CapabilityState
    due: float


class Standing(NamedTuple):
    """How good an expression is: because of which parts, and for want of data (``absent``).

    ``due`` (monotonic) is when these have been so for their confirm_after; inf: never, as what was
    never received is not lost.
    """

    state: CapabilityState
    parts: Mapping[PartName, Bad] = MappingProxyType({})
    due: float = inf
    absent: bool = False


class NeedView(NamedTuple):
    """A capability with its expression, and how good its parts are now, those that are OK too.

    ``maintained`` are those of them that are in a planned downtime.
    """

    state: CapabilityState
    wanted: WantedCapability
    parts: Mapping[PartName, CapabilityState]
    maintained: frozenset[PartName]


FINE = Standing(CapabilityState.OK)
NOT_KNOWN = Standing(CapabilityState.UNKNOWN, absent=True)
Look = Callable[[PartName | Other], "Standing | None"]


def outcome(need: Need, look: Look) -> Standing | None:
    """How good it is; None where it is out of use, as what ``look`` has as None.

    Args:
        need: The expression.
        look: How good a part, or another capability, is.
    """
    if isinstance(need, Missing):
        return NOT_KNOWN
    if not isinstance(need, AtLeast):
        return look(need)
    outcomes = (outcome(one, look) for one in need.of)
    found = [_counted(each, need.degraded) for each in outcomes if each is not None]
    if not found:
        return None
    if need.k is None:
        return _kth_best(len(found), found)
    k = min(need.k, len(found))
    known = [each for each in found if each.parts or each.state is not CapabilityState.UNKNOWN]
    return _kth_best(k, known if len(known) >= k else found)


def _counted(standing: Standing, degraded: CapabilityState) -> Standing:
    """What is degraded, as what it counts as."""
    if standing.state is not CapabilityState.DEGRADED:
        return standing
    return FINE if degraded is CapabilityState.OK else standing._replace(state=degraded)


def _kth_best(k: int, standings: list[Standing]) -> Standing:
    state = sorted(each.state for each in standings)[k - 1]
    unusable = [each for each in standings if each.state > CapabilityState.DEGRADED]
    if state is CapabilityState.OK and (not unusable or len(standings) - len(unusable) > k):
        return FINE
    bad = [each for each in standings if each.state is not CapabilityState.OK]
    if state is CapabilityState.OK:
        state, dues = CapabilityState.NO_RESERVE, sorted(each.due for each in unusable)
    else:
        # As many as it takes until the k-th best is not better.
        dues = sorted(each.due for each in bad if each.state >= state)[: len(standings) - k + 1]
    parts = {part: its for each in bad for part, its in each.parts.items()}
    return Standing(state, MappingProxyType(parts), dues[-1], any(each.absent for each in bad))


def with_parts(need: Need, named: Callable[[PartName], PartName | None]) -> Need | None:
    """The expression with its parts as they are ``named`` now, without those that are None."""
    if isinstance(need, AtLeast):
        found = (with_parts(each, named) for each in need.of)
        return replace(need, of=tuple(each for each in found if each is not None))
    return named(need) if isinstance(need, PartName) else need


def parts_of(need: Need, others: Mapping[str, Iterable[PartName]]) -> Iterator[PartName]:
    """The parts on which an expression rests; ``others`` are those of the capabilities before."""
    if isinstance(need, PartName):
        yield need
    elif isinstance(need, Other):
        yield from others[need.name]
    elif isinstance(need, AtLeast):
        for each in need.of:
            yield from parts_of(each, others)
