"""A seeded history of a fleet: what happens to whom, and when."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from random import Random
from typing import NamedTuple

TICK = 60  # seconds; the simulation's unit of time
PERIOD = 10  # ticks between two messages of a robot
DAY = 86_400 // TICK
SITES = 4
# Part of the exporter -> seconds until its trouble is a fault.
OWN_PARTS = {"database": 0.0, "domain 7": 1200.0, "Alertmanager": 3600.0}
COMPONENTS = tuple(f"part {number}" for number in range(10))
OK, WARN, ERROR, STALE = range(4)


class Event(NamedTuple):
    """What happens at a tick: ``who`` is a robot, a site or ""; ``how`` depends on ``what``."""

    at: int
    what: str
    who: str = ""
    how: tuple[object, ...] = ()


@dataclass(frozen=True)
class Story:
    """A fleet of ``robots``, and all that happens to it within ``ticks``, in order of time.

    Each robot publishes every ``period`` ticks.
    """

    seed: int
    robots: int
    ticks: int
    events: tuple[Event, ...]
    period: int = PERIOD
    able: bool = False  # what the robots can do is judged


def robot_name(number: int) -> str:
    """Return the name of a robot."""
    return f"r{number:03d}"


def site_of(robot: str) -> str:
    """Return where a robot is."""
    return f"site {int(robot[1:]) % SITES}"


def generate(
    seed: int, robots: int, days: float, *, lose: bool = False, able: bool = False
) -> Story:
    """The history of a seed: the same for the same arguments.

    With ``lose`` the exporter loses its database, too, and the wall clock is set by months. With
    ``able`` the robots can do something, for which they need parts that fail together.
    """
    random = Random(seed)
    ticks = round(days * DAY)
    events: list[Event] = []
    for number in range(robots):
        count = round(random.expovariate(1 / (2 * days)))
        for _ in range(count):
            to_robot = random.choice(_OF_ROBOT)
            events += to_robot(random, random.randrange(ticks), robot_name(number))
    for _ in range(round(random.expovariate(1 / (4 * days)))):
        to_fleet = random.choice(_OF_FLEET)
        events += to_fleet(random, random.randrange(ticks), robots)
    if lose:
        for _ in range(1 + round(random.expovariate(1 / days))):
            events += _lose(random, random.randrange(ticks))
            events += _set_clock(random, random.randrange(ticks))
    for number in range(robots if able else 0):
        for _ in range(1 + round(random.expovariate(1 / days))):
            events += _redundant(random, random.randrange(ticks), robot_name(number))
    events += _of_exporter(Random(f"own {seed}"), ticks, days)  # all else stays as it is without
    kept = (event for event in events if event.at < ticks)
    ordered = tuple(sorted(kept, key=lambda event: event.at))
    return Story(seed, robots, ticks, ordered, able=able)


def _length(random: Random) -> int:
    """Ticks that something takes: much shorter than confirm_after, about it, or much longer."""
    return random.choice((3, 12, 25, 40, 90, 400, 1000))


# -- to one robot ------------------------------------------------------------------------------


def _trouble(random: Random, at: int, robot: str) -> Iterator[Event]:
    part, level = random.choice(COMPONENTS), random.choice((WARN, ERROR, ERROR, STALE))
    yield Event(at, "level", robot, (part, level))
    yield Event(at + _length(random), "level", robot, (part, OK))


_COURSES = (
    (WARN, ERROR, OK),
    (WARN, ERROR, WARN, OK),
    (ERROR, WARN, ERROR, OK),
    (ERROR, STALE, OK),
    (WARN, STALE, WARN, OK),
)


def _worse_and_better(random: Random, at: int, robot: str) -> Iterator[Event]:
    part = random.choice(COMPONENTS)
    for level in random.choice(_COURSES):
        yield Event(at, "level", robot, (part, level))
        at += _length(random)


def _flap(random: Random, at: int, robot: str) -> Iterator[Event]:
    part = random.choice(COMPONENTS)
    for number in range(random.choice((6, 15, 30))):
        yield Event(at, "level", robot, (part, OK if number % 2 else random.choice((WARN, ERROR))))
        at += PERIOD * random.choice((1, 1, 2))
    yield Event(at, "level", robot, (part, OK))


def _mute(random: Random, at: int, robot: str) -> Iterator[Event]:
    part = random.choice(COMPONENTS)
    yield Event(at, "mute", robot, (part, True))
    yield Event(at + 2 * _length(random), "mute", robot, (part, False))


def _off(random: Random, at: int, robot: str) -> Iterator[Event]:
    yield Event(at, "off", robot, (True,))
    yield Event(at + 2 * _length(random), "off", robot, (False,))


def _many(random: Random, at: int, robot: str) -> Iterator[Event]:
    level = random.choice((WARN, ERROR))
    for part in COMPONENTS[:9]:
        yield Event(at, "level", robot, (part, level))
        yield Event(at + 3 * _length(random), "level", robot, (part, OK))


def _charge(random: Random, at: int, robot: str) -> Iterator[Event]:
    yield Event(at, "charge", robot, (random.choice((5.0, 15.0, 20.1)),))
    yield Event(at + _length(random), "charge", robot, (random.choice((20.2, 50.0, 9.9)),))
    yield Event(at + 2 * _length(random) + 1000, "charge", robot, (80.0,))


def _network(random: Random, at: int, robot: str) -> Iterator[Event]:
    how = random.choice(("lose", "repeat", "swap"))
    yield Event(at, how, robot, (True,))
    yield Event(at + 3 * _length(random), how, robot, (False,))


def _forgotten(random: Random, at: int, robot: str) -> Iterator[Event]:
    yield Event(at, "forget", robot, (random.choice(COMPONENTS),))


def _out_of_config(random: Random, at: int, robot: str) -> Iterator[Event]:
    yield Event(at, "declared", robot, (False,))
    yield Event(at + _length(random), "declared", robot, (True,))


def _redundant(random: Random, at: int, robot: str) -> Iterator[Event]:
    """Parts that stand in for one another, about at one time, and one of them later."""
    for number in random.choice(((1, 2), (3, 4), (3, 4, 5), (2, 7), (2, 6))):
        level = random.choice((ERROR, ERROR, ERROR, WARN))
        yield Event(at + random.randrange(3), "level", robot, (COMPONENTS[number], level))
        yield Event(at + 5 * _length(random), "level", robot, (COMPONENTS[number], OK))


_OF_ROBOT = (
    *(_trouble, _trouble, _trouble, _worse_and_better, _worse_and_better, _flap, _mute, _off, _off),
    *(_many, _charge, _network, _network, _forgotten, _out_of_config),
)


# -- to the fleet ------------------------------------------------------------------------------


def _partition(random: Random, at: int, _robots: int) -> Iterator[Event]:
    site = f"site {random.randrange(SITES)}"
    yield Event(at, "partition", site, (True,))
    yield Event(at + 2 * _length(random), "partition", site, (False,))


def _common(random: Random, at: int, robots: int) -> Iterator[Event]:
    part = random.choice(COMPONENTS)
    for number in random.sample(range(robots), random.randrange(1, robots // 2 + 2)):
        yield Event(at + random.randrange(10), "level", robot_name(number), (part, ERROR))
        end = at + 20 + _length(random)
        yield Event(end, "level", robot_name(number), (part, OK))


def _maintenance(random: Random, at: int, _robots: int) -> Iterator[Event]:
    yield Event(at, "maintenance", f"site {random.randrange(SITES)}", (_length(random),))


def _restart(random: Random, at: int, _robots: int) -> Iterator[Event]:
    yield Event(at, "restart", "", (random.choice((0, 1, 5, 30, 100)),))


def _lose(random: Random, at: int) -> Iterator[Event]:
    yield Event(at, "restart", "", (random.choice((0, 5, 30, 100)), True))


def _set_clock(random: Random, at: int) -> Iterator[Event]:
    yield Event(at, "clock", "", (random.uniform(-2.0, 200.0) * 86_400,))


def _clock(random: Random, at: int, _robots: int) -> Iterator[Event]:
    yield Event(at, "clock", "", (random.choice((-3600.0, -30.0, 30.0, 3600.0)),))


def _config(random: Random, at: int, _robots: int) -> Iterator[Event]:
    yield Event(at, "confirm_after", "", (random.choice((0.0, 600.0, 1200.0, 1200.0, 3600.0)),))


_OF_FLEET = (_partition, _common, _common, _maintenance, _maintenance, _restart, _restart, _clock,
             _config)  # fmt: skip


# -- to the exporter itself --------------------------------------------------------------------

_OWN_COURSES = (
    (WARN, OK),
    (ERROR, OK),
    (WARN, ERROR, OK),
    (ERROR, STALE, OK),
    (WARN, STALE, WARN, OK),
    (STALE, OK),
    (ERROR, None),  # the part is no more, as a domain that fleet.yml has no longer
)


def _of_exporter(random: Random, ticks: int, days: float) -> Iterator[Event]:
    for _ in range(1 + round(random.expovariate(1 / (2 * days)))):
        part, at = random.choice(list(OWN_PARTS)), random.randrange(ticks)
        for level in (*random.choice(_OWN_COURSES), OK):
            yield Event(at, "own", part, (level,))
            at += _length(random)
