"""Publishes arrays over DDS on this machine: a normal fleet, and hostile robots.

Arrays are serialized before they are published, so that an attack costs the attacker little: the
cores belong to the exporter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from rclpy.serialization import serialize_message

from bench.actors.pace import ticks
from bench.robots import aggregated_array
from ros_diagnostics_exporter.model import Status
from support.ros_publisher import message, publisher

HOSTILE_TOPIC = "/hostile/diagnostics_agg"
LONGEST_TEXT = 4096  # characters of a text that the exporter keeps


def topic_of(robot: int) -> str:
    """The aggregated topic of one of the fleet's robots."""
    return f"/robot_{robot}/diagnostics_agg"


def publish_fleet(domain_id: int, robots: int, seconds: float, first: int = 0) -> None:
    """Publish each robot's array once a second, the robots evenly spread over the second."""
    with publisher(domain_id) as fleet:
        for robot in range(robots):
            fleet.offer(topic_of(first + robot), depth=10)
        worst = 0.0
        for tick, late in ticks(robots, seconds):
            turn, robot = divmod(tick, robots)
            if robot == 0:
                data = _serialize(aggregated_array(turn).statuses)
                print(f"turn {turn}, late at worst {worst:.3f} s", flush=True)
            fleet.send_bytes(topic_of(first + robot), data)
            worst = max(worst, late)


@dataclass(frozen=True)
class Flood:
    """Arrays that are published in turn, ``rate`` times a second."""

    rate: float
    variants: int
    statuses: Callable[[int], list[Status]]  # of one variant


def publish_flood(domain_id: int, name: str, seconds: float) -> None:
    """Publish one of FLOODS on the hostile robot's topic."""
    flood = FLOODS[name]
    arrays = [_serialize(flood.statuses(variant)) for variant in range(flood.variants)]
    with publisher(domain_id) as hostile:
        # Deep: what the exporter's kernel drops is sent again until the exporter has it.
        hostile.offer(HOSTILE_TOPIC)
        hostile.wait_for_listeners()
        for tick, _ in ticks(flood.rate, seconds):
            if tick % max(1, int(flood.rate)) == 0:
                print(f"{tick} arrays of {len(arrays[0]) / 1e3:,.0f} kB sent", flush=True)
            hostile.send_bytes(HOSTILE_TOPIC, arrays[tick % len(arrays)])


def _serialize(statuses: list[Status] | tuple[Status, ...]) -> bytes:
    return bytes(serialize_message(message(statuses)))


def _aggregated(components: list[Status]) -> list[Status]:
    """The components below one header row, as an aggregator writes them."""
    rows = tuple((component.name, "OK") for component in components)
    below = [component._replace(name=f"/Hostile/{component.name}") for component in components]
    return [Status(0, "/Hostile", "OK", "", rows), *below]


def _big(components: int, variant: int) -> list[Status]:
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


FLOODS = {
    "fast": Flood(60, 2, lambda variant: _big(475, variant)),
    "equal-keys": Flood(1, 4, _equal_keys),
    "huge": Flood(20, 2, lambda variant: _big(4_850, variant)),
    "flapping": Flood(60, 2, _flapping),
}
