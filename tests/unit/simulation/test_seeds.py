"""Seeded histories of a fleet: nothing is missed, sent twice or made up.

A seed that fails is explained by ``./run simulate --seed N``, which reduces it to a few events; its
story then gets a place in STORIES, and stays.
"""

from dataclasses import replace

import pytest

from simulation.checks import Judge
from simulation.story import ERROR, OK, WARN, Event, Story, generate

MANY = [pytest.param(seed, marks=pytest.mark.slow) for seed in range(100, 160)]
# Of each: seed, robots and ticks, then what happens.
STORIES = {
    "many components fail between two messages that come late": (
        Story(3, 6, 900, ()),
        Event(38, "swap", "r004", (True,)),
        *(Event(807, "level", "r004", (f"part {number}", ERROR)) for number in range(8)),
    ),
    "a component that fails is notified, and recovers": (
        Story(0, 2, 200, ()),
        Event(30, "level", "r000", ("part 1", ERROR)),
        Event(90, "level", "r000", ("part 1", OK)),
    ),
    "trouble counts from when a component is missing": (
        Story(11, 12, 100, ()),
        Event(31, "mute", "r003", ("part 0", True)),
        Event(37, "level", "r003", ("part 0", WARN)),
        Event(55, "mute", "r003", ("part 0", False)),
    ),
    "a robot that is removed and added while the exporter is stopped is the same": (
        Story(3, 20, 300, ()),
        Event(36, "restart", "", (100,)),
        Event(62, "declared", "r011", (False,)),
        Event(87, "declared", "r011", (True,)),
        Event(106, "mute", "r011", ("part 5", True)),
    ),
    "a message that comes late ends a fault by what it says": (
        Story(1, 10, 250, ()),
        Event(39, "swap", "r007", (True,)),
        Event(73, "level", "r007", ("part 7", ERROR)),
        Event(193, "level", "r007", ("part 7", OK)),
    ),
    "a fault may begin in the moment in which its robot is removed": (
        Story(144, 10, 52, ()),
        Event(30, "level", "r008", ("part 2", WARN)),
        Event(52, "declared", "r008", (False,)),
    ),
    "a fault may begin in the moment in which its component is taken out": (
        Story(144, 10, 52, ()),
        Event(30, "level", "r008", ("part 2", WARN)),
        Event(51, "off", "r008", (True,)),
        Event(52, "forget", "r008", ("part 2",)),
    ),
    "a fault that an exporter without its database adopts may end in the same moment": (
        Story(0, 2, 220, ()),
        Event(20, "level", "r000", ("part 1", WARN)),
        Event(30, "off", "r000", (True,)),
        Event(100, "off", "r000", (False,)),
        Event(100, "level", "r000", ("part 1", OK)),
        Event(100, "restart", "", (30, True)),
    ),
    "an exporter without its database waits for a robot as for one never received": (
        Story(111, 8, 240, ()),
        Event(31, "off", "r001", (True,)),
        Event(38, "restart", "", (100, True)),
    ),
    "the robots that are silent are many of a site that got smaller": (
        Story(0, 20, 400, ()),
        Event(30, "off", "r001", (True,)),
        Event(30, "off", "r005", (True,)),
        Event(200, "declared", "r009", (False,)),
        Event(218, "declared", "r013", (False,)),
    ),
}


@pytest.mark.parametrize("seed", [*range(1, 5), *MANY])
def test_a_seed_breaks_nothing(seed):
    judge = Judge(generate(seed, robots=10, days=2))

    judge.run()

    assert judge.notified
    assert judge.mails.sent


@pytest.mark.parametrize("seed", [1, 2, *MANY])
def test_nothing_ends_without_evidence_without_a_database_and_whatever_the_clock_is(seed):
    judge = Judge(generate(seed, robots=8, days=2, lose=True))

    judge.run()

    assert judge.notified


@pytest.mark.parametrize("seed", [1, *MANY])
def test_what_robots_can_do_is_as_good_as_its_parts_and_one_fault_is_one_mail(seed):
    judge = Judge(generate(seed, robots=6, days=2, able=True))

    judge.run()

    assert judge.notified


@pytest.mark.parametrize("seed", [6005, 7001])
def test_what_the_fleet_can_do_is_known_without_a_database_too(seed):
    """The first began with a start, before anything was received; the second was not adopted."""
    Judge(generate(seed, robots=8, days=1, lose=True, able=True)).run()


@pytest.mark.parametrize("story", STORIES.values(), ids=STORIES)
def test_a_story_breaks_nothing(story):
    fleet, *events = story
    Judge(replace(fleet, events=tuple(events))).run()
