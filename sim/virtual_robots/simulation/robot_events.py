"""The events of a whole robot: it joins, crashes, hangs, loses its network, and so on.

Each has a handler, a function of fleet, robot, event and time; the fleet does not know them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

from virtual_robots.simulation.actions import LEASE
from virtual_robots.simulation.fleet import Fleet, appear
from virtual_robots.simulation.kinds import load_kind
from virtual_robots.simulation.outputs import Output, Presence
from virtual_robots.simulation.robots import State, VirtualRobot

BOOT_TIME = 10.0
FLAP_PERIOD = 5.0


class RobotEvent(NamedTuple):
    """An event of a robot: ``length`` in seconds (0: until another event ends it).

    ``by``: seconds of a clock jump; ``rate``: arrays a second of a flood; ``period``: seconds
    between two changes of a flapping network.
    """

    what: str
    length: float = 0.0
    by: float = 3600.0
    rate: float = 100.0
    period: float = FLAP_PERIOD


Handler = Callable[[Fleet, VirtualRobot, RobotEvent, float], Iterator[Output]]


def parse_event(text: str) -> RobotEvent:
    """Parse `WHAT` or `WHAT: NUMBER`, the value of a robot's parameter.

    The number is a clock jump's offset in seconds, a flood's arrays a second, else the event's
    length in seconds. Raises ValueError with a text.
    """
    what, _, number = (part.strip() for part in text.partition(":"))
    if what not in EVENTS:
        raise ValueError(f"{what!r} cannot happen to a whole robot, only {', '.join(EVENTS)}")
    if not number:
        return RobotEvent(what)
    try:
        value = float(number)
    except ValueError:
        raise ValueError(f"{what}: {number!r} is no number") from None
    limits = {"clock_jump": (-3e8, 3e8), "flood": (1e-3, 1e4)}  # ROS' stamps end in 2038
    low, high = limits.get(what, (0.0, 1e9))
    if not low <= value <= high:
        raise ValueError(f"{what}: {number} must be between {low:g} and {high:g}")
    if what == "clock_jump":
        return RobotEvent(what, by=value)
    return RobotEvent(what, rate=value) if what == "flood" else RobotEvent(what, length=value)


def trigger(fleet: Fleet, robot: str, event: RobotEvent) -> Iterator[Output]:
    """Run the event now; yield its outputs. Raises KeyError for a robot that does not exist."""
    return EVENTS[event.what](fleet, fleet.robot(robot), event, fleet.now)


def _join(fleet: Fleet, robot: VirtualRobot, _: RobotEvent, now: float) -> Iterator[Output]:
    fleet.start(robot, now)
    yield from ()


def _leave(fleet: Fleet, robot: VirtualRobot, event: RobotEvent, now: float) -> Iterator[Output]:
    """Shut down in order: the robot leaves the graph at once."""
    fleet.stop(robot, State.OFF)
    yield from _leave_graph(robot, now)
    if event.length:
        fleet.start(robot, now + event.length)


def _reboot(fleet: Fleet, robot: VirtualRobot, event: RobotEvent, now: float) -> Iterator[Output]:
    yield from _leave(fleet, robot, event._replace(length=event.length or BOOT_TIME), now)


def _crash(fleet: Fleet, robot: VirtualRobot, event: RobotEvent, now: float) -> Iterator[Output]:
    """End without leaving the graph: it stays there until its lease expires."""
    fleet.stop(robot, State.OFF)
    _leave_graph_later(fleet, robot, now)
    if event.length:
        fleet.start(robot, now + event.length)
    yield from ()


def _hang(fleet: Fleet, robot: VirtualRobot, event: RobotEvent, now: float) -> Iterator[Output]:
    """Publish nothing; DDS' own threads keep the robot in the graph."""
    if robot.state is State.OFF:
        return
    fleet.stop(robot, State.PAUSED)
    generation = robot.generation

    def end(then: float) -> Iterator[Output]:
        if robot.generation == generation:
            yield from _resume(fleet, robot, event, then)

    if event.length:
        fleet.schedule(now + event.length, end)
    yield from ()


def _resume(fleet: Fleet, robot: VirtualRobot, _: RobotEvent, now: float) -> Iterator[Output]:
    """End a hang; a robot that is off stays off until `join`."""
    if robot.state is State.PAUSED:
        fleet.resume(robot, now)
    yield from ()


def _lose_network(
    fleet: Fleet, robot: VirtualRobot, event: RobotEvent, now: float
) -> Iterator[Output]:
    """Publish nothing; the robot itself runs on: message numbers increase, batteries drain."""
    robot.network_changes += 1
    latest = robot.network_changes
    _disconnect(fleet, robot, now)

    def end(then: float) -> Iterator[Output]:
        if robot.network_changes == latest:
            yield from _connect(robot, then)

    if event.length:
        fleet.schedule(now + event.length, end)
    yield from ()


def _restore_network(_: Fleet, robot: VirtualRobot, __: RobotEvent, now: float) -> Iterator[Output]:
    robot.network_changes += 1
    yield from _connect(robot, now)


def _flap(fleet: Fleet, robot: VirtualRobot, event: RobotEvent, now: float) -> Iterator[Output]:
    """Lose and restore the network in turns."""
    robot.network_changes += 1
    latest = robot.network_changes

    def toggle(rest: float, then: float) -> Iterator[Output]:
        if robot.network_changes != latest:
            return
        if not rest or not robot.online:
            yield from _connect(robot, then)
        else:
            _disconnect(fleet, robot, then)
        if rest:
            step = min(rest, event.period)
            fleet.schedule(then + step, lambda after: toggle(rest - step, after))

    yield from toggle(event.length, now)


def _connect(robot: VirtualRobot, now: float) -> Iterator[Output]:
    robot.online = True
    yield from appear(robot, now)


def _disconnect(fleet: Fleet, robot: VirtualRobot, now: float) -> None:
    robot.online = False
    _leave_graph_later(fleet, robot, now)


def _jump_clock(
    fleet: Fleet, robot: VirtualRobot, event: RobotEvent, now: float
) -> Iterator[Output]:
    robot.driver.clock_offset += event.by

    def end(_: float) -> Iterator[Output]:
        robot.driver.clock_offset -= event.by
        yield from ()

    if event.length:
        fleet.schedule(now + event.length, end)
    yield from ()


def _flood(fleet: Fleet, robot: VirtualRobot, event: RobotEvent, now: float) -> Iterator[Output]:
    normal = load_kind(robot.spec.kind).period
    robot.period = 1 / event.rate
    robot.rate_changes += 1
    latest = robot.rate_changes

    def end(_: float) -> Iterator[Output]:
        if robot.rate_changes == latest:
            robot.period = normal
        yield from ()

    if event.length:
        fleet.schedule(now + event.length, end)
    yield from ()


EVENTS: dict[str, Handler] = {
    "join": _join,
    "leave": _leave,
    "reboot": _reboot,
    "crash": _crash,
    "hang": _hang,
    "resume": _resume,
    "network_loss": _lose_network,
    "network_back": _restore_network,
    "flap": _flap,
    "clock_jump": _jump_clock,
    "flood": _flood,
}


def _leave_graph(robot: VirtualRobot, now: float) -> Iterator[Output]:
    if robot.present:
        robot.present = False
        robot.driver.leave_graph()
        yield Presence(now, robot.spec.name, present=False)


def _leave_graph_later(fleet: Fleet, robot: VirtualRobot, now: float) -> None:
    """Remove the robot from the graph when its lease expires, unless it is back by then."""
    robot.silence_count += 1
    silence = robot.silence_count

    def lease_expired(then: float) -> Iterator[Output]:
        silent = robot.state is State.OFF or not robot.online
        if silent and robot.silence_count == silence:
            yield from _leave_graph(robot, then)

    fleet.schedule(now + LEASE, lease_expired)
