"""A program that publishes arrays on real topics at a steady rate, as robots or as an attacker do.

A process of its own, so that what it costs is not the exporter's. It ends by itself.
"""

import argparse
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration
from rclpy.qos import QoSProfile
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions

from ros_diagnostics_exporter.model import Status
from support.ros_publisher import message
from testbed.polling import until


def _array(turn: int, statuses: int, values: int, text: int) -> bytes:
    """One serialized array; a status has ``values`` key-values of ``text`` characters."""
    pairs = tuple(
        (f"Value {number}", f"{number + turn}".rjust(text, "0")) for number in range(values)
    )
    rows = [Status(0, f"driver: part {number}", "OK", "", pairs) for number in range(statuses)]
    return bytes(serialize_message(message(rows)))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("pattern", help="a topic's name, {} stands for its number")
    parser.add_argument("--topics", type=int, default=1)
    parser.add_argument("--publishers", type=int, default=1, help="on each topic")
    parser.add_argument("--rate", type=float, default=1.0, help="arrays a second of a publisher")
    parser.add_argument("--arrays", type=int, default=1_000_000, help="of a publisher, at most")
    parser.add_argument("--seconds", type=float, default=60.0, help="at most")
    parser.add_argument("--statuses", type=int, default=4)
    parser.add_argument("--values", type=int, default=4, help="of a status")
    parser.add_argument("--text", type=int, default=4, help="characters of a value")
    parser.add_argument("--depth", type=int, default=10, help="arrays kept until acknowledged")
    parser.add_argument("--matched", action="store_true", help="wait for a subscription first")
    return parser.parse_args()


def main() -> None:
    """Publish until ``--arrays`` or ``--seconds`` are reached."""
    options = _options()
    # All values change from one to the next: what does not change costs a receiver little.
    arrays = [_array(turn, options.statuses, options.values, options.text) for turn in (0, 1)]
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node("load")
    quality = QoSProfile(depth=options.depth)
    publishers = [
        node.create_publisher(DiagnosticArray, options.pattern.format(number), quality)
        for number in range(options.topics)
        for _ in range(options.publishers)
    ]
    if options.matched:
        until(lambda: all(p.get_subscription_count() for p in publishers), "a subscription")
    print(f"publishing arrays of {len(arrays[0])} bytes", flush=True)
    begin, sent = time.monotonic(), 0
    while sent < options.arrays and time.monotonic() - begin < options.seconds:
        for publisher in publishers:
            publisher.publish(arrays[sent % 2])
        sent += 1
        time.sleep(max(0.0, begin + sent / options.rate - time.monotonic()))
    print(f"sent {sent * len(publishers)} arrays", flush=True)
    if options.matched:
        second = Duration(seconds=1)
        until(lambda: all(p.wait_for_all_acked(second) for p in publishers), "acknowledgements")


if __name__ == "__main__":
    main()
