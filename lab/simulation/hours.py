"""Histories of a few hours whose mails do not depend on seconds: for real servers, too."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from random import Random

from ros_diagnostics_exporter.faults.model import Identity
from simulation.mails import Key, Mails
from simulation.story import (
    COMPONENTS,
    ERROR,
    OK,
    SITES,
    STALE,
    WARN,
    Event,
    Story,
    robot_name,
    site_of,
)
from simulation.world import World

ROBOTS = 12
TICKS = 190  # three hours and ten minutes
AFTER = 40  # ticks in which nothing more may come of it
TRIES = 6  # histories with other seconds, of which each has to lead to the same mails
SHORT, LONG, LONGEST = 6, 55, 75  # ticks: over before it is confirmed; confirmed; a robot's silence
_LEVELS = (WARN, ERROR, ERROR, STALE)
Ledger = Counter[tuple[str, Key]]
Incident = tuple[Event, ...]


def hours(seed: int) -> Story:
    """A history of the fleet; what would depend on seconds is left out."""
    random = Random(seed)
    free = [(robot_name(n), part) for n in range(ROBOTS) for part in COMPONENTS[1:]]
    random.shuffle(free)
    wanted = (*_OF_FLEET, *(random.choice(_OF_PARTS) for _ in range(40)), *_OF_ROBOTS)
    incidents = [tuple(what(random, free)) for what in wanted]
    while True:
        story = _story(seed, incidents)
        expected = mails(story)
        doubtful = set[Key]()
        for other in _others(story, random):
            found = mails(other)
            doubtful |= {key for _what, key in (expected - found) + (found - expected)}
        if not doubtful:
            return story
        of_robots = {Identity(*key).robot: key for key in sorted(doubtful, reverse=True)}  # type: ignore[arg-type]
        for key in of_robots.values():
            _leave_out(incidents, key)


def _story(seed: int, incidents: list[Incident]) -> Story:
    events = tuple(sorted(event for incident in incidents for event in incident))
    return Story(seed, ROBOTS, TICKS, events, period=1)


def _leave_out(incidents: list[Incident], key: Key) -> None:
    """Leave out what a fault comes of, else something that has to do with its robot or site."""
    identity = Identity(*key)  # type: ignore[arg-type]
    site = identity.site or (site_of(identity.robot) if identity.robot else "")

    def is_of(event: Event) -> bool:
        named = identity.component in event.how or not identity.component
        return event.who == identity.robot and named

    def is_near(event: Event) -> bool:
        if not site:
            return identity.component in event.how
        return site in (event.who, site_of(event.who) if event.who[:1] == "r" else "")

    for touches in (is_of, is_near, lambda event: event.what == "restart"):
        for incident in reversed(incidents):
            if any(map(touches, incident)):
                incidents.remove(incident)
                return


def mails(story: Story) -> Ledger:
    """The mails that the simulation sends of a history: what, and of which fault."""
    world, sent = World(replace(story, ticks=story.ticks + AFTER)), Mails()
    events = list(story.events)
    while world.tick < world.story.ticks:
        due = [event for event in events if event.at <= world.tick + 1]
        del events[: len(due)]
        world.advance(due)
        sent.scrape(world.state, world.now)
    return Counter((what, key) for what, key, _at in sent.sent)


def _others(story: Story, random: Random) -> Iterator[Story]:
    """The same history with other seconds: as messages, reloads and starts take their time."""
    for _ in range(TRIES):
        events = [_later(event, random) for event in story.events]
        yield replace(
            story, events=tuple(sorted(events)), ticks=story.ticks + random.choice((0, AFTER))
        )


def _later(event: Event, random: Random) -> Event:
    if event.what == "restart":
        return event._replace(how=(int(str(event.how[0])) + random.randrange(5),))
    if event.what in {"maintenance", "declared"}:
        return event._replace(at=event.at + random.randrange(3))
    return event._replace(at=event.at + random.randrange(-1, 2))


# -- what happens ------------------------------------------------------------------------------

_Free = list[tuple[str, str]]  # components that nothing happens to yet


def _levels(free: _Free, at: int, *steps: tuple[int, int]) -> Iterator[Event]:
    robot, part = free.pop()
    for level, ticks in steps:
        yield Event(at, "level", robot, (part, level))
        at += ticks
    yield Event(at, "level", robot, (part, OK))


def _short(random: Random, free: _Free) -> Iterator[Event]:
    yield from _levels(free, random.randrange(5, TICKS - 40), (random.choice(_LEVELS), SHORT))


def _long(random: Random, free: _Free) -> Iterator[Event]:
    yield from _levels(free, random.randrange(5, 120), (random.choice(_LEVELS), LONG))


def _lasts(random: Random, free: _Free) -> Iterator[Event]:
    [first, *_] = _levels(free, random.randrange(5, 140), (random.choice(_LEVELS), LONG))
    yield first


def _worse_and_better(random: Random, free: _Free) -> Iterator[Event]:
    yield from _levels(free, random.randrange(5, 60), (WARN, LONG), (ERROR, 25), (WARN, 25))


def _worse_while_critical(random: Random, free: _Free) -> Iterator[Event]:
    steps = (ERROR, LONG), (random.choice((WARN, STALE)), 30)
    yield from _levels(free, random.randrange(5, 90), *steps)


def _flaps(random: Random, free: _Free) -> Iterator[Event]:
    steps = [(OK if number % 2 else random.choice((WARN, ERROR)), 3) for number in range(14)]
    yield from _levels(free, random.randrange(5, 120), *steps)


def _is_missing(random: Random, free: _Free) -> Iterator[Event]:
    robot, part = free.pop()
    at = random.randrange(5, 90)
    yield Event(at, "mute", robot, (part, True))
    yield Event(at + LONGEST, "mute", robot, (part, False))


def _charge(random: Random, free: _Free) -> Iterator[Event]:
    robot, at = free[0][0], random.randrange(5, 110)
    yield Event(at, "charge", robot, (random.choice((5.0, 15.0)),))
    yield Event(at + LONG, "charge", robot, (80.0,))


def _off(random: Random, free: _Free) -> Iterator[Event]:
    robot, at = random.choice(free)[0], random.randrange(5, 100)
    yield Event(at, "off", robot, (True,))
    yield Event(at + random.choice((SHORT, LONGEST)), "off", robot, (False,))


def _many(random: Random, free: _Free) -> Iterator[Event]:
    robot, at = random.choice(free)[0], random.randrange(5, 110)
    for part in COMPONENTS[1:]:
        yield Event(at, "level", robot, (part, ERROR))
        yield Event(at + LONG, "level", robot, (part, OK))
    free[:] = [each for each in free if each[0] != robot]


def _undeclared(random: Random, free: _Free) -> Iterator[Event]:
    robot, at = random.choice(free)[0], random.randrange(60, 120)
    yield Event(at, "declared", robot, (False,))
    yield Event(at + 20, "declared", robot, (True,))


def _common(random: Random, free: _Free) -> Iterator[Event]:
    part, at = random.choice(COMPONENTS[1:]), random.randrange(5, 110)
    for number in random.sample(range(ROBOTS), 7):
        yield Event(at + random.randrange(4), "level", robot_name(number), (part, ERROR))
        yield Event(at + 4 + LONG, "level", robot_name(number), (part, OK))
    free[:] = [each for each in free if each[1] != part]


def _partition(random: Random, _free: _Free) -> Iterator[Event]:
    site, at = f"site {random.randrange(SITES)}", random.randrange(55, 100)
    yield Event(at, "partition", site, (True,))
    yield Event(at + LONGEST, "partition", site, (False,))


def _maintenance(random: Random, _free: _Free) -> Iterator[Event]:
    yield Event(random.randrange(5, 120), "maintenance", f"site {random.randrange(SITES)}", (40,))


def _restart(random: Random, _free: _Free) -> Iterator[Event]:
    yield Event(random.randrange(10, 45), "restart", "", (random.randrange(3),))


_OF_FLEET = (_restart, _restart, _partition, _maintenance, _common, _many)
_OF_PARTS = (
    _short,
    _long,
    _long,
    _lasts,
    _worse_and_better,
    _worse_while_critical,
    _flaps,
    _is_missing,
)
_OF_ROBOTS = (_charge, _charge, _off, _off, _off, _off, _undeclared)
