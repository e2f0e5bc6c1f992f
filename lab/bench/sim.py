"""What a fleet of virtual robots costs: CPU and memory of its process, and lost messages.

This process listens to the aggregated topic of every robot, as the exporter does, and counts the
gaps in the messages' numbers. `./run bench sim --robots 1000 --seconds 30`.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
import tempfile
import threading
from collections import defaultdict
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.executors import SingleThreadedExecutor

from testbed import domains
from testbed.processes import Process

BIN = Path(sys.executable).parent
NUMBER = re.compile(rb"Sequence\0\0\0\0[\x02-\x09]\0\0\0(\d+)\0")


class Listener:
    """Counts messages and gaps on each topic, from serialized bytes."""

    def __init__(self, domain_id: int, robots: int) -> None:
        self._context = rclpy.Context()
        self._context.init(domain_id=domain_id)
        self._node = rclpy.create_node("listener", context=self._context, enable_rosout=False)
        self._last: dict[str, int] = {}
        self.messages: dict[str, int] = defaultdict(int)
        self.lost = 0
        for robot in range(1, robots + 1):
            self._listen(f"/robot_{robot}/diagnostics_agg")

    def _listen(self, topic: str) -> None:
        def on_message(data: bytes) -> None:
            numbers = [int(found) for found in NUMBER.findall(data)]
            if numbers:
                last = self._last.get(topic, numbers[-1] - 1)
                self.lost += numbers[-1] - last - 1
                self._last[topic] = numbers[-1]
            self.messages[topic] += 1

        self._node.create_subscription(DiagnosticArray, topic, on_message, 10, raw=True)

    def listen(self, stop: threading.Event) -> None:
        """Until ``stop`` is set."""
        executor = SingleThreadedExecutor(context=self._context)
        executor.add_node(self._node)
        while not stop.is_set():
            executor.spin_once(timeout_sec=0.1)


def cpu_seconds(pid: int | str) -> float:
    """User and system time so far of a process, or of a thread as "PID/task/ID"."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_megabytes(pid: int) -> float:
    """The process' resident memory."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.split("VmRSS:")[1].split()[0]) / 1024


def measure(options: argparse.Namespace, domain_id: int, folder: Path) -> None:
    """Start the fleet, let it settle, measure, print."""
    arguments = [str(BIN / "virtual-robots"), "--robots", str(options.robots)]
    arguments += ["--participants", options.participants]
    robots = Process("robots", arguments, domains.environment(domain_id), folder / "robots.log")
    robots.start()
    robots.wait_for_output("ready: .*\n", 120)
    stop = threading.Event()
    listener = None if options.no_listener else Listener(domain_id, options.robots)
    if listener is not None:
        thread = threading.Thread(target=listener.listen, args=(stop,))
        thread.start()
    stop.wait(options.settle)
    before, received = cpu_seconds(robots.pid), sum(listener.messages.values()) if listener else 0
    stop.wait(options.seconds)
    spent = cpu_seconds(robots.pid) - before
    print(f"{options.robots} robots, {options.seconds:g} s, participants: {options.participants}")
    print(f"CPU of the fleet's process: {spent / options.seconds:.0%} of a core")
    print(f"memory: {resident_megabytes(robots.pid):.0f} MB")
    if listener is not None:
        rate = (sum(listener.messages.values()) - received) / options.seconds
        print(f"received: {rate:.0f} messages a second on {len(listener.messages)} topics")
        print(f"lost, by their numbers: {listener.lost}")
        stop.set()
        thread.join()
    robots.stop()


def main() -> None:
    """Read the options and measure in a domain of its own."""
    parser = argparse.ArgumentParser("./run bench sim", description=__doc__)
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--settle", type=float, default=10.0)
    parser.add_argument("--participants", choices=["fleet", "robot"], default="fleet")
    parser.add_argument("--no-listener", action="store_true", help="nobody subscribes")
    options = parser.parse_args()
    with domains.lease() as domain_id, tempfile.TemporaryDirectory() as folder:
        os.environ.update(domains.environment(domain_id))
        measure(options, domain_id, Path(folder))


if __name__ == "__main__":
    main()
