"""A Nagios plug-in that asks the robot itself: a fresh ROS process that waits for one message.

This is how the 2014 thesis checked its robots, written for ROS 2 and as cheap as rclpy allows: no
services, no executor. It is compared with `check_ros_diagnostics`, which asks the exporter.
"""

from __future__ import annotations

import argparse
import sys
import time

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile

TIMEOUT = 10.0  # seconds
PAUSE = 0.02
STATES = ("OK", "WARNING", "CRITICAL", "UNKNOWN")
EXIT_CODES = {0: 0, 1: 1, 2: 2, 3: 2}  # of a level; STALE counts as CRITICAL


def main() -> int:
    """Check the components of a robot whose name contains a text; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-H", dest="robot", required=True)
    parser.add_argument("-N", dest="name", default="", help="text in the components' names")
    options = parser.parse_args()
    array = _receive(f"/{options.robot}/diagnostics_agg")
    if array is None:
        print(f"UNKNOWN - no message of {options.robot} in {TIMEOUT:g} s")
        return 3
    levels = [each.level[0] for each in array.status if options.name in each.name]
    code = max((EXIT_CODES.get(level, 3) for level in levels), default=3)
    print(f"{STATES[code]} - {len(levels)} sensors")
    return code


def _receive(topic: str) -> DiagnosticArray | None:
    """Return the first array that arrives; None after the time-out."""
    rclpy.init()
    node = rclpy.create_node(
        "check",
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter("start_type_description_service", value=False)],
    )
    subscription = node.create_subscription(
        DiagnosticArray, topic, lambda _array: None, QoSProfile(depth=1)
    )
    deadline = time.monotonic() + TIMEOUT
    try:
        while time.monotonic() < deadline:
            with subscription.handle:
                taken = subscription.handle.take_message(DiagnosticArray, False)
            if taken is not None:
                return taken[0]
            time.sleep(PAUSE)
        return None
    finally:
        node.destroy_node()
        rclpy.shutdown()


if __name__ == "__main__":
    sys.exit(main())
