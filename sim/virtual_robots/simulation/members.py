"""The nouns of a fleet: what is asked for, who is in it, what comes out of it."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from random import Random
from typing import NamedTuple

from virtual_robots.aggregator import Aggregator
from virtual_robots.model import Status
from virtual_robots.schema.thesis import ThesisSettings
from virtual_robots.simulation.robot import Robot


class Topic(Enum):
    """The topics of a robot, below its namespace."""

    RAW = "diagnostics"
    AGGREGATED = "diagnostics_agg"
    TOPLEVEL = "diagnostics_toplevel_state"


class Message(NamedTuple):
    """Something published: ``at`` and ``stamp`` in seconds since the fleet's start.

    ``statuses`` has exactly one element on TOPLEVEL.
    """

    at: float
    robot: str
    topic: Topic
    statuses: tuple[Status, ...]
    stamp: float


class Presence(NamedTuple):
    """A robot comes into the ROS graph, or is gone from it."""

    at: float
    robot: str
    present: bool


class Note(NamedTuple):
    """Something of the story that a person who watches wants to read."""

    at: float
    text: str


Happening = Message | Presence | Note


class RobotSpec(NamedTuple):
    """A robot to be made: its name, which is also its namespace, and the file of its kind.

    ``settings`` is the settings file of a thesis' robot. One that is ``absent`` waits to join.
    """

    name: str
    kind: Path
    settings: Path | None = None
    absent: bool = False


class State(Enum):
    """What a robot's computer does; one that reboots is OFF, and its next start is planned."""

    OFF = "off"
    RUNNING = "running"
    PAUSED = "paused"  # it hangs: nothing is published, DDS' own threads still answer


@dataclass
class Member:
    """A robot in the fleet and what is around it: its aggregator, its network, its life.

    ``life`` is raised when the robot stops, so that nothing planned for the life before happens in
    the next. ``online`` is its network. ``present`` is whether it is in the ROS graph: always while
    it is online and not OFF, and for the time of a lease after it crashed or lost its network.
    ``silences`` counts how often it fell silent without goodbye; ``networks`` and ``floods`` count
    the orders to its network and its rate, so that an order's end does not end a later order.
    ``drawn`` are the components whose level the settings' last refresh decided.
    """

    spec: RobotSpec
    robot: Robot
    period: float
    rng: Random
    aggregator: Aggregator | None = None
    settings: ThesisSettings | None = None
    life: int = 0
    state: State = State.OFF
    online: bool = True
    present: bool = False
    silences: int = 0
    networks: int = 0
    floods: int = 0
    drawn: frozenset[str] = field(default_factory=frozenset)
