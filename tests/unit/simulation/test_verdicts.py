"""The checks of the random fleet: each finds the change of faults that it is there for."""

from dataclasses import replace

import pytest

from ros_diagnostics_exporter.faults.model import Change, Fault, Identity, Scope, State
from simulation.checks import Judge
from simulation.features import started
from simulation.small_fleet import FLEETS, ROBOTS
from simulation.story import Event, Story
from simulation.world import CALM, TICK
from support.fault_histories import ERROR, OK, STALE, WALL, WARN


def component(state=State.CRITICAL, name="motor", scope=Scope.COMPONENT):
    return Identity(scope, state, robot="r1", component=name)


def value(state):
    return Identity(Scope.VALUE, state, robot="r1", component="battery", key="charge", bound="low")


def can(name, state=State.LOST, robot="r1"):
    return Identity(Scope.CAPABILITY, state, robot=robot, check=name)


def flips(name, times, period=1):
    return 0, "flaps", "r1", name, times, period, ERROR


SILENT = Identity(Scope.ROBOT, State.SILENT, robot="r1")
SITE = Identity(Scope.SITE, State.SILENT, site="hall")
COMMON = Identity(Scope.COMMON, State.CRITICAL, component="lidar lower")
MANY = Identity(Scope.ROBOT, State.MANY, robot="r1", severity="critical")
FLAPS = component(State.FLAPPING, scope=Scope.FLAPPING)
INTERMITTENT = component(State.INTERMITTENT, scope=Scope.FLAPPING)
FALLING, LOW = value(State.FALLING), value(State.CRITICAL)
BROKEN = (0, "array", "r1", {"motor": ERROR})
UNPLANNED = (0, "array", "r1", {"board": ERROR})  # no capability rests on it
GONE = (0, "silent", {"r1"})
FALLS_SOON = (0, "fleet", FLEETS[1])


def charged(number, seconds=0):
    return seconds, "charge", "r1", number


@pytest.mark.parametrize(
    ("steps", "identity", "wrong"),
    [
        ([], component(), "began of"),
        ([(0, "array", "r1", {"motor": WARN}), (20,)], component(), "began of"),
        ([BROKEN, (5,)], component(), "before it was due"),
        ([BROKEN, (5,), GONE, (20,)], component(), "its robot is silent"),
        ([BROKEN, (0, "downtime", "r1", True), (20,)], component(), "in a downtime"),
        ([BROKEN, (0, "downtime_of", "r1", {"motor"}), (20,)], component(), "in a downtime"),
        ([UNPLANNED, (20,)], component(name="board"), "began twice"),
        ([], SILENT, "of a robot that is up"),
        ([(0, "restart"), GONE, (12,)], SILENT, "after a restart"),
        ([GONE, (0, "cut_off", {"r1"}, True), (30,)], SILENT, "without its domain"),
        ([(0, "silent", ROBOTS), (40,)], SILENT, "although"),
        ([(0, "silent", ROBOTS), (40,), (0, "uplink", OK), (0, "back", "r2"),
          (0, "back", "r3"), (0, "back", "r4"), (5,)], SILENT, "site"),
        ([(0, "uplink", ERROR), (12,), GONE, (30,)], SILENT, "although"),
        ([(0, "uplink", ERROR), (30,)], SITE, "although"),
        ([(0, "uplink", ERROR), (30,), (0, "measure", {"r1"}, {"disk": ERROR}), (12,)],
         component(name="disk"), "although"),
        ([BROKEN, (20,)], MANY, "began with"),
        ([], LOW, "before it was due"),
        ([charged(9.0), (5,)], LOW, "before it was due"),
        ([charged(9.0), (5,), charged(None), (20,)], LOW, "is no number"),
        ([charged(9.0), (5,), GONE, (20,)], LOW, "its robot is silent"),
        ([charged(9.0), (0, "counts", "r1", False), (20,)], LOW, "a condition"),
        ([FALLS_SOON, charged(15.0), (20,), (0, "thresholds", "r1", 2)], FALLING, "threshold"),
        ([FALLS_SOON, charged(9.0), (20,)], FALLING, "too low"),
        ([FALLS_SOON, (55,), charged(20.2), (4,)], FALLING, "few samples"),
        ([FALLS_SOON, (90,)], FALLING, "did not fall"),
        ([FALLS_SOON, charged(25.0), (90,), charged(23.0), (30,)], FALLING, "falls slowly"),
        ([flips("motor", 4)], FLAPS, "began with 4 changes"),
        ([flips("motor", 2)], INTERMITTENT, "began with 2 changes"),
        ([flips("motor", 5)], INTERMITTENT, "may flap"),
        ([UNPLANNED, (20,), flips("board", 5, 11)],
         component(State.INTERMITTENT, "board", Scope.FLAPPING), "began with 1 changes"),
        ([(0, "array", "r1", {"strict": WARN}), (20,)], can("signal", State.DEGRADED), "fine"),
        ([(0, "array", "r1", {"lidar upper": ERROR}), (5,),
          (0, "array", "r1", {"lidar lower": ERROR}), (6,)], can("view"), "began early"),
        ([(0, "everywhere_but", "r1", "motor"), (5,)], can("transport", robot=""), "began with"),
        ([BROKEN, (20,)], can("docking"), "although"),
    ],
)  # fmt: skip
def test_what_begins_and_may_not_is_found(steps, identity, wrong):
    world = after(steps)
    with pytest.raises((AssertionError, KeyError), match=wrong):
        changed(world, "began", identity)


@pytest.mark.parametrize(
    ("steps", "identity", "wrong"),
    [
        ([BROKEN, (0, "downtime", "r1", True)], component(), "in a downtime"),
        ([BROKEN, GONE], component(), "its robot is silent"),
        ([BROKEN], component(), "recovered with"),
        ([BROKEN], component(State.STALE), "recovered with"),
        ([(0, "array", "r1", {"motor": STALE})], component(State.WARNING), "recovered with"),
        ([GONE], SILENT, "of a silent robot"),
        ([charged(9.0), GONE], LOW, "its robot is silent"),
        ([charged(9.0), charged(None)], LOW, "is no number"),
        ([charged(9.0), charged(10.1)], LOW, "below its threshold"),
        ([charged(9.0)], FALLING, "below its threshold"),
        ([flips("motor", 10)], FLAPS, "recovered with 10 changes"),
        ([flips("motor", 2)], INTERMITTENT, "recovered with"),
        ([flips("motor", 5)], INTERMITTENT, "recovered with"),
        ([flips("motor", 2), GONE], INTERMITTENT, "its robot is silent"),
        ([(0, "everywhere", "lidar lower", ERROR), (40,)], COMMON, "last"),
        ([BROKEN, (200,)], can("driving"), "recovered without"),
        ([GONE], can("driving"), "its robot is silent"),
        ([(0, "everywhere", "motor", ERROR), (200,)], can("transport", robot=""), "without"),
    ],
)
def test_what_recovers_and_may_not_is_found(steps, identity, wrong):
    world = after(steps)
    world.lasting.add(identity)
    world.began_at[identity] = world.second
    with pytest.raises(AssertionError, match=wrong):
        changed(world, "recovered", identity)


def test_what_ends_twice_or_by_nobody_is_found():
    world = after([])
    with pytest.raises(AssertionError, match="ended twice"):
        changed(world, "recovered", component())
    for identity in (component(), value(State.WARNING), LOW):
        world.lasting.add(identity)
        with pytest.raises(AssertionError, match="removed by nobody"):
            changed(world, "removed", identity)


def test_a_fault_whose_threshold_is_gone_may_be_removed():
    world = after([(0, "thresholds", "r1", 2)])
    for identity in (LOW, FALLING):
        world.lasting.add(identity)
        changed(world, "removed", identity)
    assert world.lasting == set()


def after(steps):
    """The fleet after steps: seconds before each, what happens, and its arguments."""
    world = started()
    for seconds, *step in steps:
        world.second += seconds
        if step:
            what, *how = step
            getattr(world, what)(*how)
        world.engine()
    return world


def changed(world, what, identity):
    """Tell the checks of a change that the engine does not make."""
    world._changed([Change(what, Fault(identity, WALL, WALL, {}), WALL + world.second)])


@pytest.fixture(scope="module")
def lost():
    """A fleet of a story one robot of which has long lost what two of its parts are needed for."""
    ticks = 100 + int(CALM / TICK)
    broken = (Event(60, "level", "r002", (f"part {number}", ERROR)) for number in (3, 4))
    judge = Judge(Story(0, 3, ticks, tuple(broken), able=True))
    judge.run()
    return judge


@pytest.mark.parametrize(
    ("changes", "wrong"),
    [
        ({}, None),
        ({"state": "degraded"}, "a capability is better than its parts say"),
        ({"check": "view"}, "a capability that is well has a fault"),
        ({"robot": "r001"}, "a capability that is well has a fault"),
    ],
)
def test_what_a_robot_can_do_is_as_bad_as_its_parts(lost, changes, wrong):
    [(key, fault)] = lost._faults.items()
    found = [what for what, _about in lost._capabilities.missing({key: replace(fault, **changes)})]
    assert found[:1] == ([wrong] if wrong else [])
