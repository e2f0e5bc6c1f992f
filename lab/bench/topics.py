"""What fields of small topics cost, beside what diagnostics cost: CPU and memory of the exporter.

Two cases of the same number of robots, each with a fresh exporter. In the first the robots publish
arrays of 16 components once a second, of which every value changes. In the second they have no
diagnostics: each publishes JointState with ten joints ten times a second, and fleet.yml makes a
value of each joint's effort. CPU is user and system time of the whole process with the
middleware's threads; "DDS" is these threads' part. "B/s" is what the exporter says that a robot's
topics take.
"""

from __future__ import annotations

import argparse
import time
from contextlib import ExitStack
from typing import NamedTuple

from bench.dds import BEGIN, LIMITS, SETTLE, exporting, measure, parser_for
from bench.hostile import peak_megabytes
from bench.sim import resident_megabytes
from bench.site import running
from testbed import http
from testbed.polling import until

CHANGING = 16  # components: all
UP, BYTES = "ros_diagnostics_robot_up", "ros_diagnostics_robot_watch_bytes_per_second"
VALUES = "ros_diagnostics_component_value"
JOINTS = 10
COUNTED = 60.0  # seconds over which the exporter counts bytes
FLEET = f"""\
  - {{topic: "/{{robot}}/joint_states", domain_ids: [DOMAIN], source: none, profile: arm}}
profiles:
  arm:
    topics: [{{topic: joint_states, component: Joints, fields: {{"effort[name]": Effort}}}}]
{LIMITS}"""


class Cost(NamedTuple):
    """Of the exporter: cores, those of the middleware's threads, MB at the end and at most."""

    cpu: float
    middleware: float
    resident: float
    peak: float
    bytes_per_second: float = 0.0


def diagnostics(options: argparse.Namespace) -> Cost:
    """Robots with diagnostics."""
    cost, _fleet = exporting(options, CHANGING)
    return Cost(cost.cpu, cost.middleware, cost.resident, cost.peak)


def topics(options: argparse.Namespace) -> Cost:
    """Robots with joints alone."""
    lasting = 2 * BEGIN + 3 * COUNTED + options.seconds
    with running(seconds=lasting, more=FLEET) as site, ExitStack() as actors:
        exporter, address = site.exporter.process, site.exporter.address
        site.start(site.exporter).wait_until_ready(BEGIN)
        share = -(-options.robots // options.processes)
        for first in range(0, options.robots, share):
            number = str(min(share, options.robots - first))
            joints = [site.where, number, str(options.rate), f"--first={first}"]
            actors.callback(site.start_actor("joints", *joints, seconds=lasting).stop)
        wanted = options.robots * JOINTS
        # Seldom: what is asked for ten times a second leaves nothing for what is measured.
        until(lambda: len(samples(VALUES, address)) == wanted, f"{wanted} values", BEGIN, every=5.0)
        time.sleep(SETTLE)
        cpu, middleware = measure(exporter, options.seconds)
        until(
            lambda: len(samples(BYTES, address)) == options.robots,
            "the bytes of a minute",
            2 * COUNTED,
        )
        time.sleep(COUNTED)  # in the first minute not all were subscribed
        if (up := sum(samples(UP, address))) != options.robots:
            raise RuntimeError(f"{up:g} of {options.robots} robots are up")
        memory = resident_megabytes(exporter.pid), peak_megabytes(exporter.pid)
        return Cost(cpu, middleware, *memory, sum(samples(BYTES, address)) / options.robots)


def samples(family: str, address: str) -> list[float]:
    """The values of a family."""
    lines = http.get(address, "/metrics", seconds=60).decode().splitlines()
    return [float(each.rpartition(" ")[2]) for each in lines if each.startswith(f"{family}{{")]


def main() -> None:
    """Print a line for each case."""
    parser = parser_for("topics", __doc__)
    parser.set_defaults(robots=200, processes=2)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each measurement")
    parser.add_argument("--rate", type=float, default=10.0, help="messages a second of a robot")
    options = parser.parse_args()
    print(f"{options.robots} robots, {options.seconds:g} s a case")
    columns = "".join(f"{each:>8}" for each in ("CPU", "DDS", "MB", "peak", "B/s"))
    print(f"{'':<42}{columns}")
    print_row("16 components at 1 Hz, every value changes", diagnostics(options))
    print_row(f"{JOINTS} fields of a topic at {options.rate:g} Hz", topics(options))


def print_row(what: str, cost: Cost) -> None:
    """One case."""
    print(
        f"{what:<42}{cost.cpu:>8.1%}{cost.middleware:>8.1%}{cost.resident:>8.0f}{cost.peak:>8.0f}"
        f"{cost.bytes_per_second:>8.0f}",
        flush=True,
    )


if __name__ == "__main__":
    main()
