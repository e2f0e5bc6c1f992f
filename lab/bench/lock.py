"""How long the one lock of the state is held at a time, with 1,000 robots of 16 components.

CPU milliseconds of the thread that holds it, so that other programs do not count, and without
Python's garbage collection, which stops all threads, whoever holds the lock. The yardstick is a
scrape in which nothing has changed. Each line is the longest of all holds of that work.
"""

from __future__ import annotations

import argparse
import gc
import time
from collections.abc import Callable, Iterable
from dataclasses import replace

from bench.robots import aggregated_array
from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    FaultSettings,
    Fleet,
    Profile,
    Robot,
    Source,
)
from ros_diagnostics_exporter.faults.model import Row
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.model import Downtime, Instant, Topic

TARGET = 50.0  # ms
NO_CAUSE = CauseSettings(number=1_000_000, share=1.0)  # each robot has a fault of its own


class MeasuredLock:
    """A lock in the place of another one, which notes its longest hold."""

    def __init__(self, lock: object) -> None:
        self._lock = lock
        self._depth = 0
        self._since = 0.0
        self.longest = 0.0

    def __enter__(self) -> None:
        self._lock.__enter__()  # type: ignore[attr-defined]
        self._depth += 1
        if self._depth == 1:
            self._since = time.thread_time()

    def __exit__(self, *error: object) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.longest = max(self.longest, (time.thread_time() - self._since) * 1e3)
        self._lock.__exit__(*error)  # type: ignore[attr-defined]


class Bench:
    """A fleet whose robots are received, and whose time passes as the bench says."""

    def __init__(self, robots: int) -> None:
        self.now = Instant(0.0, 1.7e9)
        self.fleet = self.fleet_of(robots, Profile(confirm_after=2.0))
        self.state = FleetState(self.fleet, self.now)
        self.lock = MeasuredLock(self.state._lock)
        self.state._lock = self.lock  # type: ignore[assignment]
        self.exposition = Exposition(self.state)

    @staticmethod
    def fleet_of(robots: int, profile: Profile) -> Fleet:
        """Robots in ten sites."""
        return Fleet(
            "bench",
            tuple(
                Robot(
                    f"robot_{n}",
                    topic_agg=f"/robot_{n}/diagnostics_agg",
                    source=Source.AGG,
                    labels={"site": f"site_{n % 10}"},
                    profile=profile,
                )
                for n in range(robots)
            ),
            faults=FaultSettings(site=NO_CAUSE, common=NO_CAUSE),
        )

    def longest(self, work: Callable[[], object]) -> float:
        """The longest hold while ``work`` is done, in ms."""
        self.lock.longest = 0.0
        gc.collect()
        gc.disable()
        try:
            work()
        finally:
            gc.enable()
        return self.lock.longest

    def pass_time(self, seconds: float) -> None:
        """Let time pass, ticking as often as the exporter does."""
        until = self.now.mono + seconds
        while self.now.mono < until:
            self.now = Instant(self.now.mono + 0.25, self.now.wall + 0.25)
            self.state.tick(self.now)
            self.state.take_events()

    def receive_all(self, turn: int, of: Iterable[int] = ()) -> None:
        """An array of each robot; the components numbered ``of`` are ERROR."""
        array = aggregated_array(turn, level=2, of=tuple(of))
        for robot in self.fleet.robots:
            self.state.receive(Topic(0, robot.topic_agg or ""), array, self.now)

    def rows(self) -> list[Row]:
        """The rows of all faults that changed."""
        return self.state.take_fault_rows(self.now)


def measure(robots: int) -> dict[str, float]:
    """Milliseconds by work, the yardstick first."""
    bench = Bench(robots)
    state = bench.state
    bench.receive_all(1)
    bench.pass_time(1.0)
    bench.exposition.render()
    found = {"a scrape, nothing changed: the yardstick": _cpu(bench.exposition.render)}

    def hold(what: str, work: Callable[[], object]) -> None:
        found[what] = bench.longest(work)

    hold("arrays in which a component of each robot breaks", lambda: bench.receive_all(2, [5]))
    rows: list[Row] = []
    hold("new faults of all robots, a tick", lambda: bench.pass_time(3.0))
    hold("rows for the database", lambda: rows.extend(bench.rows()))
    hold("all problems", lambda: state.problems(bench.now))
    hold("what is served", state.served)
    hold("a scrape with them", bench.exposition.render)
    profile = Profile(confirm_after=3.0)
    hold(
        "reload, a profile of all robots changed",
        lambda: state.configure(bench.fleet_of(robots, profile), bench.now),
    )
    hold(
        "reload, nothing changed",
        lambda: state.configure(bench.fleet_of(robots, profile), bench.now),
    )
    downtimes = [Downtime(f"robot_{n}", "", 1.7e9, 1.8e9, "", "") for n in range(robots)]
    hold("downtimes of all robots", lambda: state.plan(downtimes, bench.now))
    hold("... end", lambda: state.plan((), bench.now))
    bench.now = Instant(bench.now.mono + 60.0, bench.now.wall + 60.0)
    hold("all robots silent", lambda: bench.pass_time(5.0))
    others = replace(bench.fleet, robots=bench.fleet_of(2 * robots, profile).robots[robots:])
    hold("reload, all robots others", lambda: state.configure(others, bench.now))
    return found


def _cpu(work: Callable[[], object]) -> float:
    """Milliseconds, the best of five."""
    spent = []
    for _ in range(5):
        begin = time.thread_time()
        work()
        spent.append((time.thread_time() - begin) * 1e3)
    return min(spent)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=1000)
    options = parser.parse_args()
    found = measure(options.robots)
    yardstick = next(iter(found.values()))
    print(f"{options.robots} robots (target {TARGET:g} ms)   ms CPU   of a scrape")
    for what, cost in found.items():
        print(f"{what:<50}{cost:>6.1f}   {cost / yardstick:>6.2f}")


if __name__ == "__main__":
    main()
