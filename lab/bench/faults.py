"""What the fault engine costs: 1,000 robots of 16 components, 5 % of them in trouble.

An array in which nothing changed does not come here at all. The yardstick of the same run is one
array of 16 statuses deserialized by rclpy.
"""

from __future__ import annotations

import time
import tracemalloc
from collections.abc import Callable
from itertools import cycle

from rclpy.serialization import serialize_message

from bench.robots import aggregated_array
from ros_diagnostics_exporter.config.fleet import FaultSettings
from ros_diagnostics_exporter.faults.engine import Faults
from ros_diagnostics_exporter.faults.model import (
    ComponentName,
    ComponentReport,
    ComponentSettings,
    RobotSettings,
)
from ros_diagnostics_exporter.model import Instant, Level
from ros_diagnostics_exporter.sources.dds import decode
from support.ros_publisher import message

ROBOTS = [f"robot_{number}" for number in range(1000)]
PARTS = range(16)
SETTINGS = ComponentSettings()
ROUNDS = 5_000


def _decode() -> None:
    decode(_DATA)


_DATA = bytes(serialize_message(message(aggregated_array(0).statuses)))


def _reports(robot: str, part: int, level: Level) -> list[ComponentReport]:
    # 50 kinds of robots, so that faults here and there have nothing in common
    kind = int(robot.removeprefix("robot_")) // 20
    name = ComponentName(f"/group_{part % 4}", f"component {part} of kind {kind}")
    return [ComponentReport(name, level, SETTINGS)]


class _Fleet:
    """A fleet in which every 20th component is in trouble, and a clock."""

    def __init__(self) -> None:
        self.second = 0.0
        self.faults = Faults(FaultSettings())
        self.faults.started(self.now(), 0.0)
        for robot in ROBOTS:
            settings = RobotSettings({"site": "hall", "team": "red"})
            self.faults.configure_robot(robot, settings, self.now(), declared=True)
            self.faults.robot_back(robot, self.now())
        for number, (robot, part) in enumerate((r, p) for r in ROBOTS for p in PARTS):
            if number % 20 == 0:
                self.change(robot, part, Level.ERROR if number % 320 else Level.WARN)
        self.wait(60.0)
        self._robots = cycle(ROBOTS[1::7])  # which of them changes next

    def now(self) -> Instant:
        return Instant(self.second, self.second + 1e9)

    def wait(self, seconds: float) -> None:
        self.second += seconds
        self.faults.advance(self.now())

    def change(self, robot: str, part: int, level: Level) -> None:
        self.faults.components_changed(robot, _reports(robot, part, level), len(PARTS), self.now())

    def fail_and_recover(self) -> None:
        """Two changes of a component, too short for a fault."""
        robot = next(self._robots)
        self.second += 0.01
        self.change(robot, 3, Level.ERROR)
        self.change(robot, 3, Level.OK)

    def begin_and_end(self) -> None:
        """A fault: two changes, the timer between them, and the rows of all that."""
        robot = next(self._robots)
        self.change(robot, 3, Level.WARN)
        self.wait(11.0)
        self.change(robot, 3, Level.OK)
        self.faults.take_rows(self.now())

    def tick(self) -> None:
        """Time passes and nothing is due."""
        self.faults.advance(self.now())

    def fall_silent_and_return(self) -> None:
        robot = next(self._robots)
        self.second += 0.01
        self.faults.robot_silent(robot, self.now(), self.now())
        self.faults.robot_back(robot, self.now())


def _cost(what: Callable[[], None], rounds: int) -> float:
    """CPU microseconds each, the best of three, because machines are shared."""
    best = float("inf")
    for _ in range(3):
        begin = time.process_time()
        for _ in range(rounds):
            what()
        best = min(best, (time.process_time() - begin) / rounds * 1e6)
    return best


def main() -> None:
    """Print the table."""
    tracemalloc.start()
    fleet = _Fleet()
    size, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    decoding = _cost(_decode, ROUNDS // 5)
    print(f"{len(list(fleet.faults.faults()))} faults, {size / 1e6:.1f} MB")
    print("1,000 robots, 16,000 components, 5 % in trouble     us CPU   of decoding")
    for what, cost in (
        ("decoding (rclpy and our types), the yardstick", decoding),
        ("time passes, nothing is due", _cost(fleet.tick, ROUNDS)),
        ("component fails and recovers, two changes", _cost(fleet.fail_and_recover, ROUNDS)),
        ("fault begins and ends, rows included", _cost(fleet.begin_and_end, ROUNDS // 10)),
        ("robot falls silent and returns", _cost(fleet.fall_silent_and_return, ROUNDS // 5)),
    ):
        print(f"{what:<50}{cost:>8.1f}   {cost / decoding:>6.2f}")


if __name__ == "__main__":
    main()
