"""A scenario file: its robots and its events.

Owns the file's schema and errors; fleet.py and robot_events.py carry the events out.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

from pydantic import Field, model_validator

from virtual_robots.schema.conditions import Name
from virtual_robots.schema.documents import Document, DocumentError, parse, read_mapping
from virtual_robots.simulation.actions import Action
from virtual_robots.simulation.components import FLAP_PERIOD as COMPONENT_FLAP_PERIOD
from virtual_robots.simulation.components import Component, Fault
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.kinds import kind_path
from virtual_robots.simulation.outputs import Note, Output
from virtual_robots.simulation.robot_events import EVENTS, FLAP_PERIOD, RobotEvent, trigger
from virtual_robots.simulation.robots import RobotSpec


class RobotsModel(Document):
    """Some robots of one kind; ``{n}`` in ``name`` is a number, counted over all entries.

    ``settings`` is the settings file of a thesis robot; ``absent`` robots start with `join`.
    """

    kind: Name = "thesis"
    count: int = Field(default=1, ge=1)
    name: Name = "robot_{n}"
    settings: Name | None = None
    absent: bool = False

    @model_validator(mode="after")
    def _is_a_namespace(self) -> RobotsModel:
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", self.name.replace("{n}", "1")):
            raise ValueError(
                f"name: {self.name!r} cannot be a ROS namespace; use letters, digits and _,"
                " a letter first, and {n} for the number"
            )
        return self


class EventModel(Document):
    """An event at second ``at``, for all robots (and components) that match.

    Without ``component`` it is an event of the whole robot. ``for`` is its length in seconds.
    """

    at: float = Field(ge=0)
    robot: Name
    component: Name | None = None
    what: Name
    message: str = ""
    length: float = Field(default=0.0, ge=0, alias="for")
    by: float = Field(default=3600.0, ge=-3e8, le=3e8)  # ROS' stamps end in 2038
    rate: float = Field(default=100.0, gt=0, le=10_000)
    period: float | None = Field(default=None, ge=0.01)

    @model_validator(mode="after")
    def _is_known(self) -> EventModel:
        if self.component is None and self.what not in EVENTS:
            known = ", ".join(EVENTS)
            raise ValueError(f"what: {self.what!r} cannot happen to a whole robot, only {known}")
        return self


class ScenarioModel(Document):
    """The file. ``duration`` in seconds: the command ends then (absent: it runs until stopped)."""

    description: str = ""
    seed: int = 0
    duration: float | None = Field(default=None, gt=0)
    robots: tuple[RobotsModel, ...] = (RobotsModel(count=10),)
    events: tuple[EventModel, ...] = ()


class Scenario(NamedTuple):
    """A parsed scenario: its file, and one RobotSpec for each robot."""

    path: Path
    model: ScenarioModel
    specs: tuple[RobotSpec, ...]


def load_scenario(path: Path) -> Scenario:
    """Read a scenario file; files that it names lie relative to it. Raises DocumentError."""
    model = parse(ScenarioModel, read_mapping(path), str(path))
    specs = tuple(_specs(model, path))
    names = [spec.name for spec in specs]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise DocumentError(f"{path}: robots: {', '.join(twice)} is there twice; use {{n}}")
    return Scenario(path, model, specs)


def schedule_events(scenario: Scenario, fleet: Fleet) -> None:
    """Schedule the scenario's events. Raises DocumentError for one that matches nothing."""
    for number, event in enumerate(scenario.model.events):
        where = f"{scenario.path}: events.{number}"
        robots = [name for name in fleet.robots if fnmatchcase(name, event.robot)]
        if not robots:
            raise DocumentError(f"{where}: robot: no robot is called {event.robot!r}")
        for robot in robots:
            if event.component is None:
                _schedule_robot_event(fleet, robot, event)
            else:
                _schedule_faults(fleet, robot, event, where)


def _specs(model: ScenarioModel, path: Path) -> Iterator[RobotSpec]:
    number = 0
    for robots in model.robots:
        try:
            kind = kind_path(robots.kind, path.parent)
        except DocumentError as error:
            raise DocumentError(f"{path}: robots: {error}") from error
        settings = path.parent / robots.settings if robots.settings else None
        for _ in range(robots.count):
            number += 1
            yield RobotSpec(robots.name.replace("{n}", str(number)), kind, settings, robots.absent)


def _schedule_robot_event(fleet: Fleet, robot: str, event: EventModel) -> None:
    period = event.period or FLAP_PERIOD
    robot_event = RobotEvent(event.what, event.length, event.by, event.rate, period)

    def begin(now: float) -> Iterator[Output]:
        yield Note(now, f"{robot}: {event.what}")
        yield from trigger(fleet, robot, robot_event)

    fleet.schedule(event.at, begin)


def _schedule_faults(fleet: Fleet, robot: str, event: EventModel, where: str) -> None:
    parts = fleet.robot(robot).driver.parts
    matching = [each for each in parts if fnmatchcase(each.name, event.component or "")]
    if not matching:
        known = ", ".join(each.name for each in parts)
        raise DocumentError(f"{where}: component: {robot} has only {known}")
    for component in matching:
        if event.what not in component.known_faults():
            known = ", ".join(component.known_faults())
            raise DocumentError(f"{where}: what: {component.name} knows only {known}")
        _schedule_fault(fleet, robot, component.name, event)


def _schedule_fault(fleet: Fleet, robot: str, component: str, event: EventModel) -> None:
    def begin(now: float) -> Iterator[Output]:
        if not found():
            yield Note(now, f"{robot}, {component}: no longer exists since the settings changed")
            return
        if event.what == "ok":
            yield from change(now, None)
            return
        period = event.period or COMPONENT_FLAP_PERIOD
        fault = Fault(event.what, now, event.message, period)
        yield from change(now, fault)
        if event.length:
            fleet.schedule(now + event.length, lambda then: end(then, fault))

    def change(now: float, fault: Fault | None) -> Iterator[Output]:
        text = f"{fault.what} {fault.message}".rstrip() if fault else "ok"
        yield Note(now, f"{robot}, {component}: {text}")
        fleet.inject(robot, component, fault)

    def end(now: float, fault: Fault) -> Iterator[Output]:
        """End the event's own fault, unless another has begun or the component is gone."""
        if any(each.fault is fault for each in found()):
            yield from change(now, None)

    def found() -> list[Component | Action]:
        return [each for each in fleet.robot(robot).driver.parts if each.name == component]

    fleet.schedule(event.at, begin)
