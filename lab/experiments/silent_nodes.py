"""The robots of `experiments.silent`: real nodes of rclpy, that can be killed, hung, renamed.

    python -m experiments.silent_nodes robots NAME...
    python -m experiments.silent_nodes node ROBOT NAME [best_effort] [COMPONENT]

The first is one process with a node `driver` of each robot, which publishes diagnostics and
subscribes to the topic `data`; the second a node that publishes `data`, and diagnostics of a
COMPONENT and, in a thread of their own, of a motor. Both begin at SIGUSR2, so that a restart takes
no longer than a robot's. At SIGUSR1 the node's executor hangs: that thread and the middleware's go
on.
"""

from __future__ import annotations

import signal
import sys
import threading
import time
from collections.abc import Sequence

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

PERIOD = 0.2  # seconds between two messages
TOPIC = "data"


def _array(component: str) -> DiagnosticArray:
    return DiagnosticArray(status=[DiagnosticStatus(name=component, level=bytes(1), message="OK")])


def robots(names: Sequence[str]) -> None:
    """Publish the diagnostics of so many robots until the process ends."""
    nodes = [rclpy.create_node("driver", namespace=f"/{name}") for name in names]
    publishers = [each.create_publisher(DiagnosticArray, "diagnostics", 10) for each in nodes]
    for each in nodes:
        each.create_subscription(String, TOPIC, lambda _message: None, 10)
    print("ready", flush=True)
    while True:
        for each in publishers:
            each.publish(_array("Motor"))
        time.sleep(PERIOD)


def node(robot: str, name: str, *, best_effort: bool, component: str) -> None:
    """Be one node until the process ends."""
    made = rclpy.create_node(name, namespace=f"/{robot}")
    reliability = ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE
    data = made.create_publisher(String, TOPIC, QoSProfile(depth=10, reliability=reliability))
    own = made.create_publisher(DiagnosticArray, "diagnostics", 10) if component else None
    hung = []
    signal.signal(signal.SIGUSR1, lambda *_arguments: hung.append(True))

    def work() -> None:
        while hung:
            time.sleep(PERIOD)
        data.publish(String(data=name))
        if own is not None:
            own.publish(_array(component))

    def go_on() -> None:
        while own is not None:
            own.publish(_array("Motor"))
            time.sleep(PERIOD)

    threading.Thread(target=go_on, daemon=True).start()
    made.create_timer(PERIOD, work)
    print("ready", flush=True)
    rclpy.spin(made)


if __name__ == "__main__":
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGUSR2])
    print("imported", flush=True)
    signal.sigwait([signal.SIGUSR2])
    rclpy.init()
    kind, *rest = sys.argv[1:]
    if kind == "robots":
        robots(rest)
    else:
        robot, name, *options = rest
        components = [each for each in options if each != "best_effort"]
        node(
            robot,
            name,
            best_effort="best_effort" in options,
            component=components[0] if components else "",
        )
