"""A program that plays a fleet of any size: aggregated arrays over DDS; every value changes.

Arrays are serialized once for all robots, so that it costs little beside what is measured. The
first component's last value is the message's number, so that a receiver can count lost messages.
`python -m experiments.fleet --robots 100`, in the domain of ROS_DOMAIN_ID, until it is stopped.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import defaultdict
from collections.abc import Iterator

from rclpy.serialization import serialize_message

from ros_diagnostics_exporter.model import Status
from support.ros_publisher import message, publisher

PER_GROUP = 4  # components
MOST = 500  # robots of one process: one DDS participant
PACE = 0.01  # seconds between two bursts


def commands(
    robots: int, components: int, values: int, rate: float, faults: int
) -> Iterator[list[str]]:
    """Yield the commands of the processes that play a fleet."""
    for first in range(0, robots, MOST):
        numbers = {
            "robots": min(MOST, robots - first),
            "first": first,
            "fleet": robots,
            "components": components,
            "values": values,
            "faults": faults,
        }
        options = [f"--{name}={value}" for name, value in numbers.items()]
        yield [sys.executable, "-m", "experiments.fleet", *options, f"--rate={rate}"]


def faulty_components(robots: int, components: int, faults: int) -> dict[int, frozenset[int]]:
    """Return which components are CRITICAL, by the robot's number.

    They are spread over robots and components, so that they have no common cause.
    """
    found: dict[int, set[int]] = defaultdict(set)
    for number in range(faults):
        turn, robot = divmod(number, robots)
        found[robot].add((robot + 5 * turn) % components)
    return {robot: frozenset(parts) for robot, parts in found.items()}


def array(turn: int, components: int, values: int, faulty: frozenset[int]) -> bytes:
    """Return a serialized aggregated array: groups of four components, then those."""
    statuses: list[Status] = []
    for first in range(0, components, PER_GROUP):
        parts = range(first, min(first + PER_GROUP, components))
        group = f"/Group {first // PER_GROUP}"
        level = 2 if faulty & set(parts) else 0
        rows = tuple((f"driver: part {part}", "OK") for part in parts)
        statuses.append(Status(level, group, "OK", "", rows))
        statuses.extend(_component(turn, group, part, values, part in faulty) for part in parts)
    return bytes(serialize_message(message(statuses)))


def _component(turn: int, group: str, part: int, values: int, faulty: bool) -> Status:
    pairs = [(f"Voltage {key} (V)", f"{turn % 97 + key / 8}") for key in range(values)]
    if part == 0:
        pairs.append(("Sequence", str(turn)))
    level, text = (2, "broken") if faulty else (0, "OK")
    return Status(level, f"{group}/driver: part {part}", text, f"hw-{part}", tuple(pairs))


def main() -> None:
    """Publish until the process is stopped, the robots spread evenly over each period."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="number of the first robot")
    parser.add_argument("--components", type=int, default=16)
    parser.add_argument("--values", type=int, default=4, help="of a component")
    parser.add_argument("--rate", type=float, default=1.0, help="arrays a second of a robot")
    parser.add_argument("--faults", type=int, default=0, help="components that are CRITICAL")
    parser.add_argument("--fleet", type=int, help="robots of all processes, which share the faults")
    options = parser.parse_args()
    fleet_size = options.fleet or options.robots
    faulty = faulty_components(fleet_size, options.components, options.faults)
    with publisher(int(os.environ["ROS_DOMAIN_ID"])) as fleet:
        numbers = range(options.first, options.first + options.robots)
        topics = [f"/unit_{number}/diagnostics_agg" for number in numbers]
        for topic in topics:
            fleet.offer(topic, depth=1)  # as diagnostic_updater and aggregator
        print("ready", flush=True)
        begin, sent = time.monotonic(), 0
        arrays: dict[frozenset[int], bytes] = {}
        while True:
            due = int((time.monotonic() - begin) * options.robots * options.rate)
            while sent < due:
                turn, robot = divmod(sent, options.robots)
                if robot == 0:
                    arrays = {}
                parts = faulty.get(options.first + robot, frozenset())
                if parts not in arrays:
                    arrays[parts] = array(turn, options.components, options.values, parts)
                fleet.send_bytes(topics[robot], arrays[parts])
                sent += 1
            time.sleep(PACE)


if __name__ == "__main__":
    main()
