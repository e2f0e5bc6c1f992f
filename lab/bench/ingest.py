"""What receiving one array costs: 16 statuses with 64 values, decoded and taken into the state.

The yardstick of the same run is the same array deserialized by rclpy and copied into our types.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.serialization import serialize_message

from bench.robots import aggregated_array
from ros_diagnostics_exporter.config.fleet import Fleet, Robot, Source
from ros_diagnostics_exporter.decode import cdr
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Array, Instant, Topic
from ros_diagnostics_exporter.sources import dds as ros
from support.ros_publisher import message

ROUNDS = 5_000
TOPIC = Topic(0, "/robot/diagnostics_agg")


def _state() -> FleetState:
    robot = Robot("robot", topic_agg=TOPIC.name, source=Source.AGG)
    return FleetState(Fleet("bench", (robot,)), Instant(0.0, 0.0))


def _message(array: Array) -> bytes:
    return bytes(serialize_message(message(array.statuses)))


def _ingest(arrays: list[Array]) -> float:
    """CPU microseconds an array."""
    state = _state()
    state.receive(TOPIC, arrays[0], Instant(0.0, 0.0))
    begin = time.process_time()
    for turn in range(ROUNDS):
        state.receive(TOPIC, arrays[turn % len(arrays)], Instant(turn / 10, turn / 10))
        state.take_events()
    return (time.process_time() - begin) / ROUNDS * 1e6


def _decode(decode: Callable[[bytes], Array], messages: list[bytes]) -> float:
    """CPU microseconds a message."""
    begin = time.process_time()
    for turn in range(ROUNDS // 5):
        decode(messages[turn % len(messages)])
    return (time.process_time() - begin) / (ROUNDS // 5) * 1e6


def main() -> None:
    """Print the table; best of three, because machines are shared."""
    messages = [_message(aggregated_array(turn)) for turn in range(97)]
    yardstick = min(_decode(ros.decode, messages) for _ in range(3))
    decoding = min(_decode(cdr.Decoder().decode, messages) for _ in range(3))
    again = min(_decode(cdr.Decoder().decode, messages[:1]) for _ in range(3))
    # two equal arrays that are not the same objects, as they come from the wire
    same = min(_ingest([aggregated_array(1), aggregated_array(1)]) for _ in range(3))
    every = min(_ingest([aggregated_array(turn) for turn in range(97)]) for _ in range(3))
    levels = min(_ingest([aggregated_array(1, level=n) for n in (0, 1)]) for _ in range(3))
    print("one array of 16 components, 64 values, 4 groups   us CPU   of rclpy")
    for what, cost in (
        ("decoding by rclpy, the yardstick", yardstick),
        ("decoding, every value changed", decoding),
        ("decoding, nothing changed", again),
        ("state, nothing changed      (target 100 us)", same),
        ("state, every value changed  (target 250 us)", every),
        ("state, every level changed", levels),
    ):
        print(f"{what:<50}{cost:>6.0f}   {cost / yardstick:>6.2f}")


if __name__ == "__main__":
    main()
