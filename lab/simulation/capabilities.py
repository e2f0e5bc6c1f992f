"""What has to hold of what robots can do, by what was delivered of their parts.

A capability is never better than its parts say, nor worse than they may be; a part is not notified
under a capability that is in trouble because of it. How good one is, is computed here a second
time, as docs/capabilities.md says it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial

from ros_diagnostics_exporter.events import Event
from simulation.can import CAN, EACH, NEEDED, leaves
from simulation.story import COMPONENTS, ERROR, OK, WARN
from simulation.world import CALM, LATE, STALE_AFTER, Delivered, Part, World

FINE, NO_RESERVE, DEGRADED, LOST = range(4)
_STATES = {"no_reserve": NO_RESERVE, "degraded": DEGRADED, "lost": LOST}
_OF_LEVEL = {OK: FINE, WARN: DEGRADED, ERROR: LOST}


def judge(name: str, look: Callable[[str], int]) -> tuple[int, set[str]]:
    """How good a capability is, and which components keep it from being well."""
    k, of = CAN[name]
    found = [
        judge(each, look) if isinstance(each, str) else (look(COMPONENTS[each]), {COMPONENTS[each]})
        for each in of
    ]
    state = sorted(each for each, _ in found)[k - 1]
    usable = sum(each < LOST for each, _ in found)
    if usable == k < len(of):
        state = max(state, NO_RESERVE)
    bad = set().union(*(parts for each, parts in found if each > FINE))
    return state, bad if state else set()


Wrong = tuple[str, object]


def _level(known: Delivered, name: str) -> int:
    return _state(known.parts[name])


class Capabilities:
    """Reads the faults after each tick and yields what is wrong: a text, and of what."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._standing: dict[tuple[str, str], set[str]] = {}  # states of faults, before this tick

    def began(self, begun: list[Event], faults: Mapping[tuple[str, ...], Event]) -> Iterator[Wrong]:
        """What is wrong with the faults that began in this tick; ``faults`` are those that last."""
        lasting: dict[tuple[str, str], set[str]] = {}
        for each in faults.values():
            if each.scope == "capability":
                lasting.setdefault((each.robot, each.check), set()).add(each.state)
        for event in begun:
            if event.scope == "capability" and not event.robot:
                yield from self._wrong_begin_of_fleet(event)
            elif event.scope == "capability":
                yield from self._wrong_begin(event)
            elif event.component and event.robot:
                yield from self._under(event, lasting)
        self._standing = lasting

    def _wrong_begin(self, event: Event) -> Iterator[Wrong]:
        known = self._world.delivered[event.robot]
        worst, _ = judge(event.check, lambda name: self._worst(known, name))
        if worst < _STATES[event.state]:
            yield "a capability is in trouble whose parts are well", event

    def _wrong_begin_of_fleet(self, event: Event) -> Iterator[Wrong]:
        able = [each.name for each in self._world.declared() if self._is_surely_able(each)]
        if len(able) >= NEEDED + (event.state == "no_reserve"):
            yield "the fleet is in trouble although enough robots can", (event, able)

    def _is_surely_able(self, known: Delivered) -> bool:
        """Whether it is received, in use and well in all that it needs for the fleet's."""
        now = self._world.now.mono
        state = self._world.state
        is_planned = state is not None and state.robots[known.name].maintenance
        used = now - max(known.quiet, known.gap, self._world.started) > LATE and not is_planned
        return used and judge(EACH, lambda name: self._worst(known, name))[0] == FINE

    def _worst(self, known: Delivered, name: str) -> int:
        """The worst that a component may count as: one that changed may flap."""
        part = known.parts.get(name)
        if part is None:
            return LOST
        is_well = part.trouble_since is None and not part.changes and not part.stale
        late = self._world.now.mono - part.received > LATE
        return FINE if is_well and not late else LOST

    def _under(self, event: Event, lasting: Mapping[tuple[str, str], set[str]]) -> Iterator[Wrong]:
        known, now = self._world.delivered[event.robot], self._world.now.mono
        since = max(known.gap, known.quiet, self._world.started)
        if now - since < 3 * LATE or any(part.stale for part in known.parts.values()):
            return  # what is not received since keeps a capability as it was
        for name in CAN:
            parts = [known.parts[each] for each in leaves(name) & known.parts.keys()]
            if any(_was_late(part, now) for part in parts):
                continue  # how good it is was not known, and what is not known explains nothing
            state, bad = judge(name, lambda each: _state(known.parts.get(each)))
            place = event.robot, name
            both = self._standing.get(place, set()) & lasting.get(place, set())
            if state and event.component in bad and both:
                yield "a part is notified under its capability", (event, name, both)

    # -- what should have happened -----------------------------------------------------------

    def missing(self, faults: Mapping[tuple[str, ...], Event]) -> Iterator[Wrong]:
        """What lasts although nothing is wrong, or does not although enough is."""
        if not self._world.story.able:
            return
        of: dict[str, list[Event]] = {}
        for each in faults.values():
            of.setdefault(each.robot, []).append(each)
        yield from self._missing_of_fleet(of.get("", []))
        common = {each.component for each in of.get("", ()) if each.scope == "common"}
        for known in self._world.declared():
            for name in CAN:
                yield from self._wrong(known, name, of.get(known.name, []), common)

    def _missing_of_fleet(self, lasting: list[Event]) -> Iterator[Wrong]:
        """Whether the fleet has the fault that its robots say, by those that are known."""
        now, parts, robots = self._world.now.mono, leaves(EACH), self._world.declared()
        found = []
        for known in robots:
            quiet = now - max(known.gap, known.quiet, self._world.started)
            is_known = quiet >= CALM and parts <= known.parts.keys()
            if is_known and not self._is_changing(known, parts):
                found.append(judge(EACH, partial(_level, known))[0])
        own = {each.state for each in lasting if each.scope == "capability"}
        if sum(each < DEGRADED for each in found) > NEEDED and own:
            yield "a fleet that is well has a fault", own
        if len(robots) >= NEEDED > len(robots) - found.count(LOST) and "lost" not in own:
            yield "a fleet can do less than its faults say", (own, found)

    def ended(self, event: Event) -> Iterator[Wrong]:
        """What is wrong with the end of a fault of the fleet: that no message is evidence of it."""
        if event.scope != "capability" or event.robot or event.reason != "recovered":
            return
        robots = self._world.declared()
        at = event.time - self._world.now.wall + self._world.now.mono
        able = [
            each.name
            for each in robots
            # Of one that was received since then it is not known what it said before.
            if self._is_perhaps_able(each) or (each.last is not None and each.last > at)
        ]
        has_more = event.state == "no_reserve" and len(robots) > NEEDED
        if len(able) < NEEDED + has_more <= len(robots):
            yield "the fleet's fault ended although too few robots can", (event, able)

    def _is_perhaps_able(self, known: Delivered) -> bool:
        """Whether it is received, and no part that it needs is known to have failed."""
        if known.last is None or known.last < self._world.started:
            return False
        parts = known.parts
        state, _ = judge(EACH, lambda name: _state(parts[name]) if name in parts else FINE)
        return state < LOST and self._world.now.mono - known.last <= STALE_AFTER + LATE

    def _wrong(
        self, known: Delivered, name: str, lasting: list[Event], common: set[str]
    ) -> Iterator[Wrong]:
        now, parts = self._world.now.mono, leaves(name)
        quiet = now - max(known.gap, known.quiet, self._world.started)
        if quiet < CALM or self._is_changing(known, parts) or not parts <= known.parts.keys():
            return
        state, bad = judge(name, lambda each: _state(known.parts[each]))
        own = {each.state for each in lasting if each.check == name and each.scope == "capability"}
        if not state and own:
            yield "a capability that is well has a fault", (known.name, name, own)
        if not state or bad & common or any(each.state == "many" for each in lasting):
            return
        if any(self._world.in_trouble(each) > 2 for each in bad):
            return  # perhaps common to many robots, or just no longer
        found = [
            each
            for each in lasting
            if each.scope == "capability"
            and bad <= leaves(each.check)
            and _STATES[each.state] >= state
        ]
        if not found:
            yield "a capability is better than its parts say", (known.name, name, state, bad)

    def _is_changing(self, known: Delivered, names: set[str]) -> bool:
        """Whether it is not clear what the components count as: they changed, or are not known."""
        now = self._world.now.mono
        parts = [known.parts[name] for name in names if name in known.parts]
        return any(
            part.stale or now - part.received > LATE or _changed_since(part, now) for part in parts
        )


def _was_late(part: Part, now: float) -> bool:
    """Whether a component is not received in time, or was not before this tick."""
    known = [part, *(part.before if part.touched == now else ())]
    return any(now - each.received > LATE for each in known)


def _changed_since(part: Part, now: float) -> bool:
    return bool(part.changes) and now - part.changes[-1] < CALM


def _state(part: Part | None) -> int:
    return FINE if part is None else _OF_LEVEL.get(part.level, LOST)
