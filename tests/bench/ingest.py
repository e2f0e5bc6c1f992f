"""What receiving one decoded array costs: 16 statuses with 64 values, decode excluded.

The yardstick of the same run is the same array deserialized by rclpy.
"""

from __future__ import annotations

import time

from rclpy.serialization import serialize_message

from bench.robots import aggregated_array
from ros_diagnostics_exporter.config.fleet import Fleet, Robot, Source
from ros_diagnostics_exporter.ingest.ros import decode
from ros_diagnostics_exporter.model import Array, Instant, Topic
from ros_diagnostics_exporter.state.state import State
from support.ros_publisher import message

ROUNDS = 5_000
TOPIC = Topic(0, "/robot/diagnostics_agg")


def _state() -> State:
    robot = Robot("robot", topic_agg=TOPIC.name, source=Source.AGG)
    return State(Fleet("bench", (robot,)), Instant(0.0, 0.0))


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


def _decode(data: bytes) -> float:
    begin = time.process_time()
    for _ in range(ROUNDS // 5):
        decode(data)
    return (time.process_time() - begin) / (ROUNDS // 5) * 1e6


def main() -> None:
    """Print the table; best of three, because machines are shared."""
    decoding = min(_decode(_message(aggregated_array(0))) for _ in range(3))
    # two equal arrays that are not the same objects, as they come from the wire
    same = min(_ingest([aggregated_array(1), aggregated_array(1)]) for _ in range(3))
    every = min(_ingest([aggregated_array(turn) for turn in range(97)]) for _ in range(3))
    levels = min(_ingest([aggregated_array(1, level=n) for n in (0, 1)]) for _ in range(3))
    print("one array of 16 components, 64 values, 4 groups   us CPU   of decoding")
    for what, cost in (
        ("decoding (rclpy and our types), the yardstick", decoding),
        ("state, nothing changed      (target 100 us)", same),
        ("state, every value changed  (target 250 us)", every),
        ("state, every level changed", levels),
    ):
        print(f"{what:<50}{cost:>6.0f}   {cost / decoding:>6.2f}")


if __name__ == "__main__":
    main()
