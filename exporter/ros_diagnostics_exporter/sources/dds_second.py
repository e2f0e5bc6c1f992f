"""A program: a second participant of a domain, which says what it receives of some topics.

    python -m ros_diagnostics_exporter.sources.dds_second DOMAIN SECONDS TOPIC... [--ros-args ...]

It prints each topic of which a message arrives, and ends when all have, or after so many seconds.
It is a process of its own because what is wrong with one participant may be wrong with all that
share its process: Cyclone DDS has one network in it for each domain, Fast DDS one shared memory.
"""

from __future__ import annotations

import signal
import sys
import time
from collections.abc import Sequence

import rclpy
from rclpy.context import Context

from ros_diagnostics_exporter.sources.dds import NODE_NAME, make_guest, subscribe
from ros_diagnostics_exporter.sources.ros_environment import split_arguments

JOINED = 30  # seconds in which it has to join; it is ended where that hangs


def main(arguments: Sequence[str]) -> None:
    """Print the topics that are received."""
    (domain_id, seconds, *topics), for_ros = split_arguments(arguments)
    signal.alarm(JOINED + int(float(seconds)))  # also where the exporter is gone
    context = Context()
    rclpy.init(args=list(for_ros), context=context, domain_id=int(domain_id))
    node = make_guest(f"_{NODE_NAME}_second", context)  # hidden, as tools are
    takes = [(each, subscribe(node, each, reliable=False, depth=1)) for each in topics]
    until = time.monotonic() + float(seconds)
    while takes and time.monotonic() < until:
        received = [topic for topic, (_kept, take) in takes if take() is not None]
        sys.stdout.writelines(f"{each}\n" for each in received)
        sys.stdout.flush()
        takes = [each for each in takes if each[0] not in received]
        time.sleep(0.1)
    node.destroy_node()
    context.try_shutdown()


if __name__ == "__main__":
    main(sys.argv[1:])
