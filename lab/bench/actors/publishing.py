"""Publishes arrays over DDS or zenoh on this machine: a normal fleet, and hostile robots.

Arrays are serialized before they are published, so that an attack costs the attacker little: the
cores belong to the exporter.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import count
from struct import pack_into

from rclpy.serialization import serialize_message
from sensor_msgs.msg import JointState

from bench.actors.pace import ticks
from bench.robots import COMPONENTS, GROUPS, aggregated_array
from ros_diagnostics_exporter.model import Status
from support.ros_publisher import Publisher, message, publisher
from support.zenoh_robots import Bridge
from testbed.polling import until

HOSTILE_TOPIC = "/hostile/diagnostics_agg"
FAULTY_TOPIC = "/hostile_faulty/diagnostics_agg"
FAILS_AFTER = 15  # arrays of the robot that has a fault
MATCHED = 120.0  # seconds until the exporter has subscribed a whole fleet
ALL = range(GROUPS * COMPONENTS)
STAMP_AT = 4  # offset of header.stamp.sec in a serialized array
LONGEST_TEXT = 4096  # characters of a text that the exporter keeps


def topic_of(robot: int) -> str:
    """The aggregated topic of one of the fleet's robots."""
    return f"/robot_{robot}/diagnostics_agg"


@contextmanager
def robots_at(where: str) -> Iterator[Publisher | Bridge]:
    """Robots in a ROS domain, or with a session at the zenoh router of an endpoint."""
    if where.isdigit():
        with publisher(int(where)) as made:
            yield made
        return
    bridge = Bridge(where)
    try:
        yield bridge
    finally:
        bridge.close()


def publish_fleet(
    where: str, robots: range, seconds: float, changing: Collection[int] = ALL
) -> None:
    """Publish each robot's array once a second, the robots evenly spread over the second.

    Begins when each topic has a subscription, and ends when all is acknowledged. The values of the
    components numbered ``changing`` differ from turn to turn, and in any case the stamp.
    """
    with robots_at(where) as fleet:
        topics = [topic_of(robot) for robot in robots]
        for topic in topics:
            fleet.offer(topic, depth=10)
        until(lambda: all(map(fleet.listeners, topics)), "subscriptions", MATCHED)
        worst = 0.0
        for tick, late in ticks(len(topics), seconds):
            turn, robot = divmod(tick, len(topics))
            if robot == 0:
                data = bytearray(serialize(_partly_changed(turn, changing)))
                print(f"turn {turn}, late at worst {worst:.3f} s", flush=True)
            pack_into("<I", data, STAMP_AT, int(time.time()))
            fleet.send_bytes(topics[robot], bytes(data))
            worst = max(worst, late)
        fleet.wait_for_acknowledgements()
        print(f"all of {int(seconds)} turns acknowledged, late at worst {worst:.3f} s", flush=True)


def publish_joints(where: str, robots: range, rate: float, seconds: float) -> None:
    """Publish each robot's joints so many times a second, evenly spread, subscribed or not."""
    names = [f"joint_{number}" for number in range(10)]
    with publisher(int(where)) as fleet:
        topics = [f"/robot_{robot}/joint_states" for robot in robots]
        for topic in topics:
            fleet.offer(topic, kind=JointState, depth=10)
        for tick, late in ticks(rate * len(topics), seconds):
            turn, robot = divmod(tick, len(topics))
            if robot == 0:
                efforts = [number + turn / 1000 for number in range(len(names))]
                data = bytes(serialize_message(JointState(name=names, effort=efforts)))
            if tick % int(rate * len(topics)) == 0:
                print(f"{tick} messages sent, late {late:.3f} s", flush=True)
            fleet.send_bytes(topics[robot], data)


def _partly_changed(turn: int, changing: Collection[int]) -> list[Status]:
    """The array of this turn as far as it concerns these components, and that of turn 0."""
    now, first = aggregated_array(turn).statuses, aggregated_array(0).statuses
    components = count()
    return [
        new if "/" in new.name[1:] and next(components) in changing else old
        for new, old in zip(now, first, strict=True)
    ]


@dataclass(frozen=True)
class Flood:
    """Arrays that are published in turn, ``rate`` times a second."""

    rate: float
    variants: int
    statuses: Callable[[int], list[Status]]  # of one variant
    topic: str = HOSTILE_TOPIC
    ends: bool = False  # with the last variant, which is sent from then on

    def variant(self, tick: int) -> int:
        """Which is sent."""
        return min(tick, self.variants - 1) if self.ends else tick % self.variants


def publish_flood(where: str, name: str, seconds: float) -> None:
    """Publish one of FLOODS on its topic."""
    flood = FLOODS[name]
    arrays = [serialize(flood.statuses(variant)) for variant in range(flood.variants)]
    with robots_at(where) as hostile:
        # Deep: what the exporter's kernel drops is sent again until the exporter has it.
        hostile.offer(flood.topic)
        hostile.wait_for_listeners()
        for tick, _ in ticks(flood.rate, seconds):
            if tick % max(1, int(flood.rate)) == 0:
                print(f"{tick} arrays of {len(arrays[0]) / 1e3:,.0f} kB sent", flush=True)
            hostile.send_bytes(flood.topic, arrays[flood.variant(tick)])


def serialize(statuses: list[Status] | tuple[Status, ...]) -> bytes:
    """An array of these statuses as it is sent."""
    return bytes(serialize_message(message(statuses)))


def _aggregated(components: list[Status]) -> list[Status]:
    """The components below one header row, as an aggregator writes them."""
    rows = tuple((component.name, "OK") for component in components)
    below = [component._replace(name=f"/Hostile/{component.name}") for component in components]
    return [Status(0, "/Hostile", "OK", "", rows), *below]


def big(components: int, variant: int) -> list[Status]:
    """Components of 0.5 kB, of which every value changes."""
    values = tuple((f"Voltage {key:02} (V)", f"{variant}.{key:02}") for key in range(16))
    return _aggregated(
        [Status(0, f"Part {number:05}", "OK", "hw-1", values) for number in range(components)]
    )


def _equal_keys(variant: int) -> list[Status]:
    """500 components with 200 equal keys each: values change each time, the key every other."""
    key = ("Voltage (V)", "Current (A)")[variant // 2]
    values = tuple((key, f"{variant}.{number:03}") for number in range(200))
    return _aggregated([Status(0, f"Part {number}", "OK", "hw-1", values) for number in range(500)])


def _flapping(variant: int) -> list[Status]:
    """15 components that change their level each time, with the longest text there is."""
    text = "\N{ROBOT FACE}" * LONGEST_TEXT
    return _aggregated([Status(variant, f"Part {n}", text, "hw-1") for n in range(15)])


def _levels(variant: int) -> list[Status]:
    """100 components whose levels go round, with the longest text there is."""
    text = "x" * LONGEST_TEXT
    return _aggregated([Status((n + variant) % 3, f"Part {n}", text, "hw-1") for n in range(100)])


def _faulty(variant: int) -> list[Status]:
    """A component that fails for good."""
    return _aggregated([Status(2 * (variant == FAILS_AFTER), "Motor", "Hot", "hw-1")])


FLOODS = {
    "fast": Flood(60, 2, lambda variant: big(475, variant)),
    "equal-keys": Flood(1, 4, _equal_keys),
    "huge": Flood(20, 2, lambda variant: big(4_850, variant)),
    "flapping": Flood(60, 2, _flapping),
    "levels": Flood(10, 3, _levels),
    "heavy": Flood(20, 2, lambda variant: big(1_500, variant)),
    "faulty": Flood(1, FAILS_AFTER + 1, _faulty, FAULTY_TOPIC, ends=True),
}
