"""Steps of the small fleet that only show something together, one after the other."""

from __future__ import annotations

from collections.abc import Iterator
from random import Random
from typing import Any

from simulation.small_fleet import COMPONENTS, FALLS, FLEETS, HOSTS, ROBOTS
from simulation.story import OWN_PARTS
from support.fault_histories import ERROR, OK, STALE, WARN

# Seconds before it, what happens with its arguments, whether a new process goes on from the rows.
Step = tuple[int, tuple[Any, ...], bool]


def random_scene(random: Random) -> Iterator[Step]:
    """One of the scenes, of a robot, a component or a part that is drawn."""
    several = (_uplink, _downtime, _restless_downtime, _falling, _short_failures)
    scene = random.choice((*several, _own_part, _transport))
    return ((seconds, step, False) for seconds, step in scene(random))


_Scene = Iterator[tuple[int, tuple[Any, ...]]]


def _uplink(random: Random) -> _Scene:
    """The uplink fails before or after what it explains, and is repaired."""
    explained: tuple[Any, ...] = ("silent", set(ROBOTS))
    if random.random() < 0.5:
        explained = ("measure", ROBOTS, {random.choice(list(HOSTS)): ERROR})
    both = [("uplink", ERROR), explained]
    for step in random.sample(both, 2):
        yield 5, step
        yield 0, ("wait", random.choice((20, 60)))
    yield 0, ("wait", random.choice((20, 300)))
    yield 0, ("uplink", OK)
    yield 0, ("wait", 300)


def _downtime(random: Random) -> _Scene:
    """What failed before a downtime, or in it, goes on after it."""
    robot, name = random.choice(ROBOTS), random.choice(list(COMPONENTS))
    fails = random.choice((("array", robot, {name: ERROR}), ("silent", {robot})))
    for step in random.sample([fails, ("downtime", robot, True)], 2):
        yield 30, step
    yield 60, ("downtime", robot, False)
    yield 0, ("wait", 300)


def _restless_downtime(random: Random) -> _Scene:
    """A component changes in a downtime, and a little after it."""
    robot, name = random.choice(ROBOTS), random.choice(list(COMPONENTS))
    yield 0, ("downtime", robot, True)
    yield 5, ("flaps", robot, name, random.choice((4, 16)), 3, ERROR)
    yield 5, ("downtime", robot, False)
    yield 5, ("flaps", robot, name, 2, 3, ERROR)


def _falling(random: Random) -> _Scene:
    """A charge falls, and its threshold is taken out; samples are taken often."""
    robot = random.choice(ROBOTS)
    yield 0, ("fleet", FLEETS[1])
    yield 0, ("thresholds", robot, 3)
    yield 0, ("falls", robot, random.choice(FALLS), 9.0, True)
    yield 0, ("thresholds", robot, 2)
    yield 90, ("charge", robot, 50.0)


def _short_failures(random: Random) -> _Scene:
    """A component fails for a moment, and for longer: the last change of many is its fault."""
    robot, name = random.choice(ROBOTS), random.choice(list(COMPONENTS))
    yield 0, ("downtime", robot, False)
    yield 0, ("back", robot)
    yield 30, ("array", robot, dict.fromkeys(COMPONENTS, OK))
    yield 0, ("wait", 600)
    for seconds, level in ((25, ERROR), (3, OK), (330, WARN), (3, ERROR), (60, OK)):
        yield seconds, ("array", robot, {name: level})


def _own_part(random: Random) -> _Scene:
    """A part of the exporter fails, and is not known any more, or is no more after a start."""
    part = random.choice(list(OWN_PARTS))
    yield 0, ("own_part", part, ERROR)
    yield 0, ("wait", 700)
    yield 0, random.choice((("own_part", part, STALE), ("restart_without", part)))
    yield 0, ("wait", 60)


def _transport(random: Random) -> _Scene:
    """Too few robots can drive, and those that cannot are in a downtime."""
    broken = random.sample(ROBOTS, 3)
    for robot in ROBOTS:
        yield 0, ("downtime", robot, False)
        yield 0, ("back", robot)
        yield 0, ("array", robot, {"motor": ERROR if robot in broken else OK})
    yield 0, ("wait", 300)
    for is_so in (True, False):
        for robot in broken:
            yield 5, ("downtime", robot, is_so)
