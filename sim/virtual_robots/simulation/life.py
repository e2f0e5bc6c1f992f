"""What can happen to a whole robot: it joins, crashes, hangs, loses its network, and so on.

Each is a function of a fleet, a member and an event; the fleet does not know them.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

from virtual_robots.simulation.fleet import Fleet, appear
from virtual_robots.simulation.kinds import load_kind
from virtual_robots.simulation.members import Happening, Member, Presence, State

# How long Fast DDS believes in a participant that says nothing any more (its default lease).
LEASE = 20.0
BOOT_TIME = 10.0
FLAP_PERIOD = 5.0


class Order(NamedTuple):
    """What shall happen to a robot: ``length`` in seconds (0: until something else ends it).

    ``by``: seconds of a clock jump; ``rate``: arrays a second of a flood; ``period``: half a turn
    of a flapping network.
    """

    what: str
    length: float = 0.0
    by: float = 3600.0
    rate: float = 100.0
    period: float = FLAP_PERIOD


Deed = Callable[[Fleet, Member, Order, float], Iterator[Happening]]


def order_of(text: str) -> Order:
    """Read `WHAT` or `WHAT: NUMBER`, as a person orders it while the robots run.

    The number is what the deed needs most: seconds off of a clock jump, arrays a second of a flood,
    else how many seconds it lasts. Raises ValueError with a text.
    """
    what, _, number = (part.strip() for part in text.partition(":"))
    if what not in DEEDS:
        raise ValueError(f"{what!r} cannot happen to a whole robot, only {', '.join(DEEDS)}")
    if not number:
        return Order(what)
    try:
        value = float(number)
    except ValueError:
        raise ValueError(f"{what}: {number!r} is no number") from None
    bounds = {"clock_jump": (-3e8, 3e8), "flood": (1e-3, 1e4)}  # ROS' stamps end in 2038
    low, high = bounds.get(what, (0.0, 1e9))
    if not low <= value <= high:
        raise ValueError(f"{what}: {number} must be between {low:g} and {high:g}")
    if what == "clock_jump":
        return Order(what, by=value)
    return Order(what, rate=value) if what == "flood" else Order(what, length=value)


def order(fleet: Fleet, robot: str, wanted: Order) -> Iterator[Happening]:
    """Let it happen to the robot now. Raises KeyError for a robot that is not there."""
    return DEEDS[wanted.what](fleet, fleet.member(robot), wanted, fleet.now)


def _join(fleet: Fleet, member: Member, _: Order, now: float) -> Iterator[Happening]:
    fleet.start(member, now)
    yield from ()


def _leave(fleet: Fleet, member: Member, wanted: Order, now: float) -> Iterator[Happening]:
    """It says goodbye."""
    fleet.stop(member, State.OFF)
    yield from _vanish(member, now)
    if wanted.length:
        fleet.start(member, now + wanted.length)


def _reboot(fleet: Fleet, member: Member, wanted: Order, now: float) -> Iterator[Happening]:
    yield from _leave(fleet, member, wanted._replace(length=wanted.length or BOOT_TIME), now)


def _crash(fleet: Fleet, member: Member, wanted: Order, now: float) -> Iterator[Happening]:
    """Without goodbye: the graph believes in it until its lease is over."""
    fleet.stop(member, State.OFF)
    _vanish_later(fleet, member, now)
    if wanted.length:
        fleet.start(member, now + wanted.length)
    yield from ()


def _hang(fleet: Fleet, member: Member, wanted: Order, now: float) -> Iterator[Happening]:
    """It stands still; DDS' own threads go on telling the graph that it is there."""
    if member.state is State.OFF:
        return
    fleet.stop(member, State.PAUSED)
    life = member.life

    def go_on(then: float) -> Iterator[Happening]:
        if member.life == life:
            yield from _resume(fleet, member, wanted, then)

    if wanted.length:
        fleet.plan(now + wanted.length, go_on)
    yield from ()


def _resume(fleet: Fleet, member: Member, _: Order, now: float) -> Iterator[Happening]:
    """Only what hangs can go on: a robot that is off has to join."""
    if member.state is State.PAUSED:
        fleet.resume(member, now)
    yield from ()


def _lose_network(fleet: Fleet, member: Member, wanted: Order, now: float) -> Iterator[Happening]:
    """It goes on, numbers its messages and drains its batteries, and nobody hears it."""
    member.networks += 1
    latest = member.networks
    _disconnect(fleet, member, now)

    def end(then: float) -> Iterator[Happening]:
        if member.networks == latest:
            yield from _connect(member, then)

    if wanted.length:
        fleet.plan(now + wanted.length, end)
    yield from ()


def _find_network(_: Fleet, member: Member, __: Order, now: float) -> Iterator[Happening]:
    member.networks += 1
    yield from _connect(member, now)


def _flap(fleet: Fleet, member: Member, wanted: Order, now: float) -> Iterator[Happening]:
    """Its network comes and goes."""
    member.networks += 1
    latest = member.networks

    def turn(rest: float, then: float) -> Iterator[Happening]:
        if member.networks != latest:
            return
        if not rest or not member.online:
            yield from _connect(member, then)
        else:
            _disconnect(fleet, member, then)
        if rest:
            step = min(rest, wanted.period)
            fleet.plan(then + step, lambda after: turn(rest - step, after))

    yield from turn(wanted.length, now)


def _connect(member: Member, now: float) -> Iterator[Happening]:
    member.online = True
    yield from appear(member, now)


def _disconnect(fleet: Fleet, member: Member, now: float) -> None:
    member.online = False
    _vanish_later(fleet, member, now)


def _jump(fleet: Fleet, member: Member, wanted: Order, now: float) -> Iterator[Happening]:
    member.robot.clock_offset += wanted.by

    def back(_: float) -> Iterator[Happening]:
        member.robot.clock_offset -= wanted.by
        yield from ()

    if wanted.length:
        fleet.plan(now + wanted.length, back)
    yield from ()


def _flood(fleet: Fleet, member: Member, wanted: Order, now: float) -> Iterator[Happening]:
    usual = load_kind(member.spec.kind).period
    member.period = 1 / wanted.rate
    member.floods += 1
    latest = member.floods

    def calm(_: float) -> Iterator[Happening]:
        if member.floods == latest:
            member.period = usual
        yield from ()

    if wanted.length:
        fleet.plan(now + wanted.length, calm)
    yield from ()


DEEDS: dict[str, Deed] = {
    "join": _join,
    "leave": _leave,
    "reboot": _reboot,
    "crash": _crash,
    "hang": _hang,
    "resume": _resume,
    "network_loss": _lose_network,
    "network_back": _find_network,
    "flap": _flap,
    "clock_jump": _jump,
    "flood": _flood,
}


def _vanish(member: Member, now: float) -> Iterator[Happening]:
    if member.present:
        member.present = False
        yield Presence(now, member.spec.name, present=False)


def _vanish_later(fleet: Fleet, member: Member, now: float) -> None:
    """When the lease is over, unless the robot was heard again in between."""
    member.silences += 1
    silence = member.silences

    def lease_over(then: float) -> Iterator[Happening]:
        silent = member.state is State.OFF or not member.online
        if silent and member.silences == silence:
            yield from _vanish(member, then)

    fleet.plan(now + LEASE, lease_over)
