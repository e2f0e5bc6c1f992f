"""What has to hold of larger causes, silence and flapping, by what was delivered.

What a larger cause explains is not notified one by one; a cause begins where enough of a fleet is
in trouble, and ends where none of it is.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from math import ceil
from typing import NamedTuple

from ros_diagnostics_exporter.config.faults import CauseSettings
from ros_diagnostics_exporter.events import Event
from simulation.can import leaves_of_all
from simulation.story import COMPONENTS, ERROR, TICK, site_of
from simulation.world import (
    CALM,
    FLAP_INTERVAL,
    GRACE,
    LATE,
    PENDING_AFTER,
    SETTINGS,
    STALE_AFTER,
    Delivered,
    Part,
    World,
)

FLAPS = 10  # changes in a row, none more than an interval after the other: more than 0.4 of 20
Place = tuple[str, str]  # what a cause explains: its scope and the site, component or robot
Wrong = tuple[str, object]


class _End(NamedTuple):
    at: float  # monotonic
    offset: float  # of the wall clock


class LargerCauses:
    """Reads the faults after each tick and yields what is wrong: a text, and of what."""

    def __init__(self, world: World) -> None:
        self._world = world
        self._standing: set[Place] = set()  # that lasted before this tick, too
        self._ended: dict[Place, _End] = {}

    def began(self, begun: list[Event], faults: Mapping[tuple[str, ...], Event]) -> Iterator[Wrong]:
        """What is wrong with the faults that began in this tick; ``faults`` are those that last."""
        lasting = set(map(_place, faults.values()))
        mild = {_place(each) for each in faults.values() if each.severity == "warning"}
        now = _End(self._world.now.mono, self._world.offset)
        self._ended.update(dict.fromkeys(self._standing - lasting, now))
        for event in begun:
            for place in _explained_by(event):
                # Many that are a warning say less than one that is critical.
                says_less = place[0] == "many" and place in mild and event.severity == "critical"
                if place in self._standing & lasting and not says_less:
                    yield "a fault began that a larger one explains", (event, place)
                elif self._just_over(place, self._world.mono(event.time)):
                    yield "a fault began just after the end of a larger one", (event, place)
        self._standing = lasting

    def _just_over(self, place: Place, at: float) -> bool:
        """Whether a cause ended less than confirm_after before; not clear if a clock was set."""
        end = self._ended.get(place)
        if end is None or place[0] not in {"site", "common"} or end.offset != self._world.offset:
            return False
        return 1 < at - end.at < SETTINGS.confirm_after - 1

    # -- what should have happened -----------------------------------------------------------

    def missing(self) -> Iterator[Wrong]:
        """What lasts although nothing is wrong, or does not although enough is."""
        for known in self._world.declared():
            yield from self._silence(known)
            yield from self._many(known)
            yield from self._flapping(known)
        for site in sorted(set(map(site_of, self._world.delivered))):
            yield from self._site(site)
        for component in COMPONENTS:
            yield from self._common(component)

    def _for(self, since: float) -> float:
        """Seconds since then, without restart_grace and quiet."""
        return self._world.now.mono - max(since, self._world.started + GRACE)

    def _silence(self, known: Delivered) -> Iterator[Wrong]:
        world, name = self._world, known.name
        explained = {("site", site_of(name)), ("flapping", name)} & self._standing
        if explained or self._recently("site", site_of(name)):
            return
        least = STALE_AFTER + world.confirm_after + SETTINGS.confirm_after + LATE
        if known.last is None or not world.is_known(known):
            if self._for(known.quiet) > PENDING_AFTER + LATE and not (
                {("pending", name), ("silent", name)} & self._standing
            ):
                yield "a robot that was never received is not notified", name
        elif self._for(max(known.last, known.quiet)) > least and not (
            {("pending", name), ("silent", name)} & self._standing
        ):
            yield "a robot that is silent is not notified", name

    def _site(self, site: str) -> Iterator[Wrong]:
        robots = [each for each in self._world.declared() if site_of(each.name) == site]
        lasts = ("site", site) in self._standing
        is_over = bool(robots) and all(map(self._is_up, robots))
        if lasts and is_over and not self._world.holds_adopted:
            yield "a site is silent whose robots are received", site
        least = STALE_AFTER + SETTINGS.confirm_after + LATE
        silent = [
            each
            for each in robots
            if each.last is not None
            and self._world.is_known(each)
            and self._for(max(each.last, each.quiet)) > least
        ]
        if self._for(self._world.resized.get(site, 0.0)) <= SETTINGS.confirm_after + LATE:
            return  # enough since then, perhaps
        if not lasts and robots and len(silent) >= _needed(SETTINGS.site, len(robots)):
            yield "a site is silent and not notified", site

    def _common(self, component: str) -> Iterator[Wrong]:
        robots = self._world.declared()
        parts = [each.parts[component] for each in robots if component in each.parts]
        lasts = ("common", component) in self._standing
        if lasts and not any(each.level == ERROR for each in parts):
            yield "a common cause lasts of a component that is well", component
        resized = max(self._world.resized.values(), default=0.0)
        if self._for(resized) <= SETTINGS.confirm_after + LATE:
            return
        bad = sum(self._is_steadily_critical(each, component) for each in robots)
        if not lasts and bad >= _needed(SETTINGS.common, len(robots)):
            yield "a common cause is not notified", component

    def _is_steadily_critical(self, known: Delivered, component: str) -> bool:
        part = known.parts.get(component)
        if part is None or part.level != ERROR or part.stale or not self._is_up(known):
            return False
        changed = part.changes[-1] if part.changes else 0.0
        return self._for(max(changed, known.gap, known.quiet)) > SETTINGS.confirm_after + LATE

    def _many(self, known: Delivered) -> Iterator[Wrong]:
        world, name = self._world, known.name
        quiet = self._for(max(known.gap, known.quiet))
        lasts = ("many", name) in self._standing
        parts = known.parts.values()
        if lasts and quiet > LATE and self._is_up(known) and all(map(self._is_well, parts)):
            yield "many components are reported of a robot that is well", name
        if lasts or quiet <= CALM or any(self._recently("common", each) for each in known.parts):
            return
        least = world.confirm_after + LATE
        bad = [
            part
            for part in parts
            if part.trouble_since is not None and self._for(part.trouble_known) > least
        ]
        if len(bad) < _needed(SETTINGS.many, len(known.parts)):
            return
        if all(world.in_trouble(each) <= 1 for each in known.parts):
            yield "many components of a robot are in trouble and not notified", name

    def _flapping(self, known: Delivered) -> Iterator[Wrong]:
        world = self._world
        explained = self._recently("many", known.name)
        for name, part in known.parts.items():
            changes = part.changes[-FLAPS:]
            steps = [later - sooner for sooner, later in pairwise(changes)]
            if len(changes) < FLAPS or max(steps) > FLAP_INTERVAL or explained:
                continue
            clear = min(changes) - max(known.gap, known.quiet, world.started) > LATE
            flaps = world.now.mono - changes[-1] < LATE and clear
            alone = world.in_trouble(name) <= 2 and not self._recently("common", name)
            few = sum(each.trouble_since is not None or each.changes[-1:] > [changes[0]]
                      for each in known.parts.values()) <= 3  # fmt: skip
            if (
                flaps
                and not (world.story.able and name in leaves_of_all())  # see `capabilities`
                and alone
                and few
                and ("flapping", f"{known.name} {name}") not in self._standing
            ):
                yield "a component flaps and is not notified", (known.name, name)

    def _recently(self, scope: str, name: str) -> bool:
        """Whether such a cause lasts, or did not long ago."""
        end = self._ended.get((scope, name))
        lately = end is not None and self._world.now.mono - end.at < CALM
        return (scope, name) in self._standing or lately

    def _is_up(self, known: Delivered) -> bool:
        return known.last is not None and known.last > max(
            self._world.started, self._world.now.mono - STALE_AFTER + TICK
        )

    def _is_well(self, part: Part) -> bool:
        fresh = self._world.now.mono - part.received < STALE_AFTER / 2
        return part.trouble_since is None and not part.stale and fresh


def _needed(settings: CauseSettings, whole: int) -> int:
    """How many of so many have to be in trouble for a larger cause."""
    least = max(settings.number, ceil(round(settings.share * whole, 6)), 1)
    return least if settings.absolute is None else min(least, max(1, settings.absolute))


def _place(event: Event) -> Place:
    if event.scope == "site":
        return "site", event.site
    if event.scope == "common":
        return "common", event.component
    if event.scope == "flapping":
        return event.state, f"{event.robot} {event.component}"
    return event.state, event.robot if event.scope == "robot" else str(event)


def _explained_by(event: Event) -> Iterator[Place]:
    """The larger faults during which this one does not begin."""
    if event.scope == "component":
        yield "flapping", f"{event.robot} {event.component}"
    if event.scope in {"component", "flapping", "capability"}:
        yield "many", event.robot
    if event.scope in {"component", "flapping"}:
        yield "common", event.component
    if event.scope == "robot" and event.state in {"silent", "flapping"}:
        yield "site", site_of(event.robot)
