"""What happens to the robots of a soak test: a scenario of `virtual-robots` as long as the test.

The first half of the fleet never stops publishing; only its components fail. So every message that
it sends has to be received. Everything happens to the second half: it crashes, hangs, leaves, loses
its network, flaps, sends too much, and some of its components come and go.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import yaml

COMPONENT_EVERY = 20.0  # seconds between two faults of components
ROBOT_EVERY = 60.0  # seconds between two events of robots
QUIET = 120.0  # seconds at the end in which nothing begins, so that every fault can end
COMPONENTS = {  # of each kind, those that fail
    "robot": ("Motor 1", "Motor 2", "Motor 3", "Sensor 1", "Sensor 2", "Laser 1", "Cam 1"),
    "kobuki": ("*Cliff Sensor", "*Wall Sensor", "*Wheel Drop", "*Motor Current", "*Gyro Sensor"),
}
SETTINGS = "settings.yaml"  # of a tenth of the robots; changed while they run
# What begins, and how many seconds it may last.
FAULTS = (("error", 15, 90), ("warn", 15, 90), ("silent", 15, 60), ("flap", 20, 60))
EVENTS = (
    ("crash", 15, 60),
    ("hang", 10, 60),
    ("leave", 15, 60),
    ("reboot", 10, 30),
    ("network_loss", 10, 60),
    ("flap", 20, 60),
    ("clock_jump", 20, 60),
    ("flood", 5, 10),
)


class Fleet(NamedTuple):
    """How many robots there are of each sort, in the order of their numbers."""

    steady: int  # thesis robots that never stop publishing
    kobukis: int
    others: int  # thesis robots
    changing: int  # thesis robots with the settings file

    def steady_robots(self) -> list[str]:
        """Return the names of those that never stop."""
        return [f"robot_{n + 1}" for n in range(self.steady)]

    def failing_robots(self) -> list[str]:
        """Return the names of those whose components fail: not those whose components change."""
        return [*self.steady_robots(), *self._kobukis(), *self._others()]

    def absent_robots(self) -> list[str]:
        """Return the names of those that are not always there."""
        first = self.steady + self.kobukis + self.others + 1
        changing = [f"robot_{n}" for n in range(first, first + self.changing)]
        return [*self._kobukis(), *self._others(), *changing]

    def _kobukis(self) -> list[str]:
        return [f"kobuki_{n}" for n in range(self.steady + 1, self.steady + 1 + self.kobukis)]

    def _others(self) -> list[str]:
        first = self.steady + self.kobukis + 1
        return [f"robot_{n}" for n in range(first, first + self.others)]


def fleet_of(robots: int) -> Fleet:
    """Return the fleet of so many robots, at least ten."""
    steady, kobukis, changing = robots // 2, robots // 5, robots // 10
    return Fleet(steady, kobukis, robots - steady - kobukis - changing, changing)


def write(folder: Path, robots: int, seconds: float, seed: int) -> Path:
    """Write the scenario and the settings file that it names; return its path."""
    random, fleet = Random(seed), fleet_of(robots)
    write_settings(folder, motors=3)
    events = [*_faults(random, fleet, seconds), *_events(random, fleet, seconds)]
    path = folder / "scenario.yaml"
    scenario = {
        "description": "soak test",
        "seed": seed,
        "robots": [
            {"kind": "thesis", "count": fleet.steady},
            {"kind": "kobuki", "count": fleet.kobukis, "name": "kobuki_{n}"},
            {"kind": "thesis", "count": fleet.others},
            {"kind": "thesis", "count": fleet.changing, "settings": SETTINGS},
        ],
        "events": sorted(events, key=lambda each: each["at"]),
    }
    path.write_text(yaml.safe_dump(scenario, sort_keys=False))
    return path


def write_settings(folder: Path, motors: int) -> None:
    """Let the last tenth of the robots have so many motors."""
    (folder / SETTINGS).write_text(yaml.safe_dump({"number_of_motors": motors}))


def _faults(random: Random, fleet: Fleet, seconds: float) -> Iterator[dict[str, Any]]:
    for number in range(1, 1 + int((seconds - QUIET) / COMPONENT_EVERY)):
        what, least, most = random.choice(FAULTS)
        robot = random.choice(fleet.failing_robots())
        yield {
            "at": round(number * COMPONENT_EVERY + random.uniform(0, 10), 1),
            "robot": robot,
            "component": random.choice(COMPONENTS[robot.partition("_")[0]]),
            "what": what,
            "for": round(random.uniform(least, most), 1),
        }


def _events(random: Random, fleet: Fleet, seconds: float) -> Iterator[dict[str, Any]]:
    for number in range(1, 1 + int((seconds - QUIET) / ROBOT_EVERY)):
        what, least, most = random.choice(EVENTS)
        event: dict[str, Any] = {
            "at": round(number * ROBOT_EVERY + random.uniform(0, 30), 1),
            "robot": random.choice(fleet.absent_robots()),
            "what": what,
            "for": round(random.uniform(least, most), 1),
        }
        if what == "flood":
            event["rate"] = 20
        yield event
