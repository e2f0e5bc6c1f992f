"""Simulated fleets for tests, and access to their outputs."""

from collections.abc import Iterable
from pathlib import Path

from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.kinds import kind_path
from virtual_robots.simulation.outputs import Message, Output, Topic
from virtual_robots.simulation.robots import RobotSpec


def fleet_of(kind: str = "thesis", robots: int = 1, seed: int = 0, **options: Path) -> Fleet:
    path = kind_path(kind)
    return Fleet([RobotSpec(f"robot_{n}", path, **options) for n in range(1, robots + 1)], seed)


def of(outputs: Iterable[Output], topic: Topic, robot: str = "robot_1") -> list[Message]:
    messages = [m for m in outputs if isinstance(m, Message)]
    return [m for m in messages if m.topic is topic and m.robot == robot]


def level_of(message: Message, name: str) -> int:
    return next(status.level for status in message.statuses if status.name == name)


def number_of(message: Message) -> int:
    """The message's own number: the highest in it, because a stale status keeps an old one."""
    return max(int(v) for s in message.statuses for k, v in s.values if k == "Sequence")
