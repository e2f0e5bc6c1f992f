"""What a simulated fleet produces: messages, goals, changes of the ROS graph, and notes."""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

from virtual_robots.model import Status
from virtual_robots.schema.actions import ActionModel
from virtual_robots.schema.topics import TopicModel, Tree
from virtual_robots.simulation.actions import Step


class Topic(Enum):
    """The topics of a robot, below its namespace."""

    RAW = "diagnostics"
    AGGREGATED = "diagnostics_agg"
    TOPLEVEL = "diagnostics_toplevel_state"


class Message(NamedTuple):
    """A published message: ``at`` and ``stamp`` in seconds since the fleet's start.

    ``statuses`` has exactly one element on TOPLEVEL.
    """

    at: float
    robot: str
    topic: Topic
    statuses: tuple[Status, ...]
    stamp: float


class FieldMessage(NamedTuple):
    """A message of a topic of its own: its fields, filled in."""

    at: float
    robot: str
    topic: TopicModel
    fields: Tree


class GoalStep(NamedTuple):
    """Something happens to an action of a robot, or to its goal."""

    at: float
    robot: str
    action: ActionModel
    step: Step


class Presence(NamedTuple):
    """A robot enters the ROS graph (``present``) or leaves it."""

    at: float
    robot: str
    present: bool


class Note(NamedTuple):
    """A line for the person who watches: an event of the scenario has begun or ended."""

    at: float
    text: str


Output = Message | FieldMessage | GoalStep | Presence | Note
