"""A virtual robot: its driver, its aggregator, its network, and where it is in the ROS graph."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from random import Random
from typing import NamedTuple

from virtual_robots.aggregator import Aggregator
from virtual_robots.schema.thesis import ThesisSettings
from virtual_robots.simulation.driver import Driver


class RobotSpec(NamedTuple):
    """A robot to create: its name, which is also its namespace, and the file of its kind.

    ``settings`` is the settings file of a thesis robot. An ``absent`` robot starts with `join`.
    """

    name: str
    kind: Path
    settings: Path | None = None
    absent: bool = False


class State(Enum):
    """What a robot's computer does; while it reboots it is OFF and its next start is scheduled."""

    OFF = "off"
    RUNNING = "running"
    PAUSED = "paused"  # it hangs: nothing is published, DDS' own threads still answer


@dataclass
class VirtualRobot:
    """A robot of the fleet.

    ``generation`` increases when the robot stops, so that what was scheduled before does not run
    after the next start. ``online``: it has a network. ``present``: it is in the ROS graph, which
    it is while online and not OFF, and for a lease after it crashed or lost its network.
    ``silence_count`` counts how often it became silent without leaving the graph;
    ``network_changes`` and ``rate_changes`` count the events that changed its network and its
    rate, so that the end of an event does not end a later one. ``drawn`` are the components whose
    level the last refresh of the settings chose.
    """

    spec: RobotSpec
    driver: Driver
    period: float
    rng: Random
    aggregator: Aggregator | None = None
    settings: ThesisSettings | None = None
    generation: int = 0
    state: State = State.OFF
    online: bool = True
    present: bool = False
    silence_count: int = 0
    network_changes: int = 0
    rate_changes: int = 0
    drawn: frozenset[str] = field(default_factory=frozenset)
