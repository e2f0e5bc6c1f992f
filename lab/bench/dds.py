"""What receiving a whole fleet over DDS costs: CPU and memory of the exporter, and lost messages.

Robots publish arrays of 16 components with 64 values once a second, evenly spread over the second,
from several processes on this machine. Each case has a fresh exporter, scraped as the shipped
Prometheus does, and another share of components whose values change: none, a quarter, all.

The yardstick of the same run is a process that takes the same messages with rclpy, ten times a
second as the exporter does, and does nothing with them. CPU is user and system time of the whole
process with the middleware's threads; "DDS" is these threads' part. Messages are counted from the
first to the last: those sent against `robot_messages_total`. "ms" is the time of a scrape on
average, "most" that of the slowest. With `--no-recordings` each case is measured a second time, by
an exporter that keeps no recordings.
"""

from __future__ import annotations

import argparse
import re
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from statistics import mean
from typing import NamedTuple

from bench.actors.publishing import topic_of
from bench.hostile import peak_megabytes
from bench.scraper import MESSAGES, total
from bench.sim import cpu_seconds, resident_megabytes
from bench.site import BenchSite, running
from testbed import http
from testbed.polling import until
from testbed.processes import Process

EXPORTER = (Path(sys.executable).with_name("ros-diagnostics-exporter"),)
WITHOUT_RECORDINGS = (sys.executable, "-m", "bench.without_recordings")
LIMITS = "limits: {robots: 10000}\n"
CHANGING = {"nothing changes": 0, "a quarter changes": 4, "every value changes": 16}
THREADS = ("dds.", "acc-", "app-", "net-", "rx-", "tx-")  # of Fast DDS; of zenoh
BEGIN = 300.0  # seconds until all robots are matched
SETTLE = 15.0  # seconds from the first message to the measurement
CALM = 5.0  # seconds without a message after the last that is acknowledged: the rest is lost
YARDSTICK = 60.0  # seconds at most for the yardstick, whose cost is the same all the time
SCRAPES = (("/metrics?collect[]=faults", 2.0), ("/metrics?exclude[]=faults", 15.0))


class Cost(NamedTuple):
    """Of one process: cores, those of the middleware's threads, MB at the end and at most.

    ``received`` are all messages, ``rate`` those in a second of the measurement, ``scrapes`` the
    seconds that each scrape took.
    """

    cpu: float
    middleware: float
    resident: float
    peak: float
    received: int
    rate: float
    scrapes: tuple[float, ...] = ()


class Fleet:
    """The robots, in several processes that publish until all is acknowledged."""

    def __init__(
        self, site: BenchSite, options: argparse.Namespace, changing: int, seconds: float
    ) -> None:
        self._share = -(-options.robots // options.processes)
        self._turns = int(SETTLE + seconds + SETTLE)
        self.sent = options.robots * self._turns
        self._processes = [
            site.start_actor(
                "fleet",
                site.where,
                str(min(self._share, options.robots - first)),
                f"--first={first}",
                f"--changing={changing}",
                seconds=self._turns,
            )
            for first in range(0, options.robots, self._share)
        ]

    def wait_until_all_publish(self) -> None:
        """Until each process has found its subscriptions."""
        for each in self._processes:
            each.wait_for_output("turn 0", BEGIN)

    def wait_for_end(self) -> None:
        """Until all is sent and acknowledged."""
        for each in self._processes:
            until(partial(_has_ended, each), each.describe, 2 * SETTLE + BEGIN)
            if each.exit_code:
                raise RuntimeError(each.describe())


def _has_ended(process: Process) -> bool:
    return not process.alive


def measure(process: Process, seconds: float) -> tuple[float, float]:
    """(cores of the whole process, of the middleware's threads) for so many seconds."""
    before, of_threads = cpu_seconds(process.pid), middleware_seconds(process.pid)
    begin = time.monotonic()
    time.sleep(seconds)
    took = time.monotonic() - begin
    spent = cpu_seconds(process.pid) - before, middleware_seconds(process.pid) - of_threads
    return spent[0] / took, spent[1] / took


def middleware_seconds(pid: int) -> float:
    """User and system time so far of the threads that Fast DDS or zenoh has named as its own."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    own = [each.name for each in tasks if (each / "comm").read_text().startswith(THREADS)]
    return sum(cpu_seconds(f"{pid}/task/{task}") for task in own)


def taking(options: argparse.Namespace) -> Cost:
    """What it costs to take the messages alone."""
    seconds = min(options.seconds, YARDSTICK)
    lasting = 2 * BEGIN + seconds
    with running(seconds=lasting, more=LIMITS) as site:
        taker = site.start_actor("taker", site.where, str(options.robots), seconds=lasting)
        fleet = Fleet(site, options, CHANGING["every value changes"], seconds)
        fleet.wait_until_all_publish()
        time.sleep(SETTLE)
        cpu, middleware = measure(taker, seconds)
        resident, peak = resident_megabytes(taker.pid), peak_megabytes(taker.pid)
        fleet.wait_for_end()
        pattern = rf"{fleet.sent} arrays taken"
        taker.wait_for_output(pattern, SETTLE)
        return Cost(cpu, middleware, resident, peak, fleet.sent, options.robots)


def exporting(
    options: argparse.Namespace,
    changing: int,
    *,
    zenoh: bool = False,
    program: Sequence[str | Path] = EXPORTER,
) -> tuple[Cost, Fleet]:
    """What the exporter costs with the same messages."""
    # Discovered ones are found in steps, each when those before have published something; here they
    # publish once all are subscribed.
    place = 'zenoh: "/"' if zenoh else "domain_id: DOMAIN"
    declared = "".join(
        f"  - {{name: robot_{number}, topic: {topic_of(number)}, {place}}}\n"
        for number in range(options.robots)
    )
    fleet_yml = f"{LIMITS}robots:\n{declared}"
    with running(zenoh=zenoh, seconds=2 * BEGIN + options.seconds, more=fleet_yml) as site:
        server = site.exporter
        exporter, address = server.process, server.address
        exporter.argv = [*map(str, program), *exporter.argv[1:]]
        site.start(server).wait_until_ready(BEGIN)
        fleet = Fleet(site, options, changing, options.seconds)
        fleet.wait_until_all_publish()
        with scraping(address) as scrapes:
            time.sleep(SETTLE)
            begin, before = time.monotonic(), count_received(address)
            cpu, middleware = measure(exporter, options.seconds)
            rate = (count_received(address) - before) / (time.monotonic() - begin)
            resident, peak = resident_megabytes(exporter.pid), peak_megabytes(exporter.pid)
            fleet.wait_for_end()
        received = count_received(address)
        while received < fleet.sent and (more := count_after(address, CALM)) > received:
            received = more
        return Cost(cpu, middleware, resident, peak, received, rate, tuple(scrapes)), fleet


def count_after(address: str, seconds: float) -> int:
    """`count_received` after a pause."""
    time.sleep(seconds)
    return count_received(address)


def count_received(address: str) -> int:
    """The messages of all robots."""
    return total(MESSAGES, http.get(address, "/metrics", seconds=60))


@contextmanager
def scraping(address: str) -> Iterator[list[float]]:
    """Scrape as the shipped Prometheus does; the seconds that each scrape took."""
    stop = threading.Event()
    took: list[float] = []

    def scrape(path: str, interval: float) -> None:
        while not stop.wait(interval):
            begin = time.monotonic()
            http.get(address, path, seconds=60)
            took.append(time.monotonic() - begin)

    threads = [threading.Thread(target=scrape, args=each) for each in SCRAPES]
    for each in threads:
        each.start()
    try:
        yield took
    finally:
        stop.set()
        for each in threads:
            each.join()


def parser_for(bench: str, description: str | None) -> argparse.ArgumentParser:
    """The options of a fleet; those of a bench are added to them."""
    parser = argparse.ArgumentParser(
        f"./run bench {bench}",
        description=description,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--processes", type=int, default=4, help="that the robots are spread over")
    return parser


def main() -> None:
    """Print a line for each case."""
    parser = parser_for("dds", __doc__)
    parser.add_argument(
        "--seconds", type=float, default=60.0, help=f"of each case; {YARDSTICK:g} at most of taking"
    )
    parser.add_argument(
        "--changing", type=re.compile, default=re.compile(""), help="only cases that match this"
    )
    parser.add_argument(
        "--no-recordings", action="store_true", help="measure each case without recordings, too"
    )
    options = parser.parse_args()
    processes = f"in {options.processes} processes"
    print(f"{options.robots} robots at 1 Hz {processes}, {options.seconds:g} s a case")
    columns = "".join(f"{each:>6}" for each in ("DDS", "MB", "peak", "lost", "ms", "most"))
    print(f"{'':<28}{'CPU':>6}{'of taking':>11}{columns}")
    yardstick = taking(options)
    print_row("taking alone", yardstick, yardstick, 0)
    for what, changing in CHANGING.items():
        if options.changing.search(what):
            cost, fleet = exporting(options, changing)
            print_row(what, cost, yardstick, fleet.sent - cost.received)
            if options.no_recordings:
                cost, fleet = exporting(options, changing, program=WITHOUT_RECORDINGS)
                print_row("  without recordings", cost, yardstick, fleet.sent - cost.received)


def print_row(what: str, cost: Cost, yardstick: Cost, lost: int) -> None:
    """One case."""
    ratio = cost.cpu / yardstick.cpu
    scrapes = [1000 * each for each in cost.scrapes]
    times = f"{mean(scrapes):>6.0f}{max(scrapes):>6.0f}" if scrapes else ""
    print(
        f"{what:<28}{cost.cpu:>6.1%}{ratio:>11.2f}{cost.middleware:>6.1%}"
        f"{cost.resident:>6.0f}{cost.peak:>6.0f}{lost:>6}{times}",
        flush=True,
    )


if __name__ == "__main__":
    main()
