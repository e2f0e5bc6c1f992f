"""What keeping the state costs: 1,000 robots of 16 components, a write a second.

Also how long it takes to find events in a database that is as large as it may get.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Collection
from pathlib import Path
from statistics import median
from typing import NamedTuple

from bench.robots import aggregated_array
from ros_diagnostics_exporter.config.fleet import Fleet, Limits, Robot, Source
from ros_diagnostics_exporter.events import Event, EventLog, Wanted
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Instant, Topic
from ros_diagnostics_exporter.storage.storage import Storage

ROBOTS, SECONDS = 1000, 60
WALL = 1.7e9


class Cost(NamedTuple):
    """Of one write: CPU and elapsed milliseconds, kilobytes to the disk."""

    cpu: float
    elapsed: float
    written: float


class Site:
    """A fleet whose robots are all well, and its database."""

    def __init__(self, path: Path, robots: int = ROBOTS) -> None:
        self._robots = range(robots)
        declared = (
            Robot(f"r{number}", topic_agg=f"/r{number}", source=Source.AGG)
            for number in self._robots
        )
        self._second = 0
        fleet = Fleet("bench", tuple(declared), limits=Limits(robots=robots))
        self.state = FleetState(fleet, self._now())
        self.log = EventLog()
        self.storage = Storage(path)

    def _now(self) -> Instant:
        return Instant(float(self._second), WALL + self._second)

    def pass_second(self, changed: Collection[int], of: Collection[int]) -> Cost:
        """All robots send; these change the level of some components; all is written."""
        self._second += 1
        level = self._second % 2 * 2
        well, ill = aggregated_array(0), aggregated_array(0, level=level, of=of)
        for number in self._robots:
            array = ill if number in changed else well
            self.state.receive(Topic(0, f"/r{number}"), array, self._now())
        self.state.tick(self._now())
        for event in self.state.take_events():
            self.log.record(event)
        written, cpu, begin = _written(), time.thread_time(), time.perf_counter()
        self.storage.save(self.state, self.log, self._now())
        cpu, elapsed = time.thread_time() - cpu, time.perf_counter() - begin
        assert self.storage.successful
        return Cost(cpu * 1e3, elapsed * 1e3, (_written() - written) / 1e3)


def _written() -> int:
    """Bytes that this process caused to be written to a disk."""
    lines = Path("/proc/self/io").read_text().splitlines()
    return int(dict(line.split(": ") for line in lines)["write_bytes"])


def _print(what: str, costs: list[Cost]) -> None:
    cpu, elapsed, written = zip(*costs, strict=True)
    print(
        f"{what:<52}{median(cpu):>8.1f}{median(elapsed):>8.1f}{max(elapsed):>8.0f}"
        f"{sum(written) / len(written):>9.0f}"
    )


def _find(folder: Path) -> None:
    storage = Storage(folder / "events.db")
    state, log, second = FleetState(Fleet("bench"), Instant(0.0, WALL)), EventLog(), 0.0
    storage.save(state, log, Instant(0.0, WALL))
    number, size = 0, 0
    while size < 256e6:
        second += 1
        for _ in range(10_000):
            number += 1
            robot, part = f"robot_{number % ROBOTS}", f"node_{number % 4}: part {number % 16}"
            log.record(Event(WALL + second, "level", robot, "/Group", part, "OK", "ERROR", "hot"))
        storage.save(state, log, Instant(second, WALL + second))
        size = (folder / "events.db").stat().st_size
    print(f"{number} events, {size / 1e6:.0f} MB                          ms")
    for what, wanted in (
        ("the last 100", Wanted()),
        ("100 of a robot", Wanted(robot="robot_7", before=number // 2)),
        ("all of a component that there is not", Wanted(component="none")),
        ("those of one second long ago", Wanted(since=WALL + 5, until=WALL + 6)),
    ):
        begin = time.perf_counter()
        found = len(list(storage.find_events(wanted)))
        print(f"{what:<45}{(time.perf_counter() - begin) * 1e3:>8.1f}   {found} found")


def main() -> None:
    """Print the tables."""
    with tempfile.TemporaryDirectory(dir=os.environ.get("BENCH_FOLDER")) as name:
        site = Site(Path(name, "exporter.db"))
        print(
            f"{ROBOTS} robots, 16 components each; of one write   CPU ms      ms  max ms       kB"
        )
        _print("the first write, everything", [site.pass_second((), ())])
        _print("nothing changes", [site.pass_second((), ()) for _ in range(SECONDS)])
        few = [range(turn * 50 % ROBOTS, turn * 50 % ROBOTS + 50) for turn in range(SECONDS)]
        one = [site.pass_second(robots, (turn % 16,)) for turn, robots in enumerate(few)]
        _print("5 % of the robots change one component", one)
        every = [
            site.pass_second(range(0, ROBOTS, 5), range(turn % 4, 16, 4)) for turn in range(SECONDS)
        ]
        _print("5 % of the components change, of 200 robots", every)
        _find(Path(name))


if __name__ == "__main__":
    main()
