"""A scenario file: which robots there are, and what happens to them when.

Owns the file's form and its errors; fleet.py and life.py do what it says.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import NamedTuple

from pydantic import Field, model_validator

from virtual_robots.schema.documents import Document, DocumentError, parse, read_mapping
from virtual_robots.schema.kinds import Name
from virtual_robots.simulation.components import FLAP_PERIOD as COMPONENT_FLAP_PERIOD
from virtual_robots.simulation.components import Fault
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.kinds import kind_path
from virtual_robots.simulation.life import DEEDS, FLAP_PERIOD, Order, order
from virtual_robots.simulation.members import Happening, Note, RobotSpec


class RobotsModel(Document):
    """Some robots of one kind; ``{n}`` in ``name`` is a number that goes on over all entries.

    ``settings`` is the settings file of a thesis' robot; ``absent`` ones wait for a `join`.
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
    """What happens ``at`` some second to all robots (and components) that match.

    Without ``component`` it happens to the robot as a whole. ``for`` ends it after so many seconds.
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
        if self.component is None and self.what not in DEEDS:
            known = ", ".join(DEEDS)
            raise ValueError(f"what: {self.what!r} cannot happen to a whole robot, only {known}")
        return self


class ScenarioModel(Document):
    """The file. ``duration`` in seconds: the command ends then (absent: it goes on)."""

    description: str = ""
    seed: int = 0
    duration: float | None = Field(default=None, gt=0)
    robots: tuple[RobotsModel, ...] = (RobotsModel(count=10),)
    events: tuple[EventModel, ...] = ()


class Scenario(NamedTuple):
    """A scenario that was read: its file, and its robots one by one."""

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


def plan(scenario: Scenario, fleet: Fleet) -> None:
    """Plan the scenario's events in its fleet. Raises DocumentError for one that cannot be."""
    for number, event in enumerate(scenario.model.events):
        where = f"{scenario.path}: events.{number}"
        robots = [name for name in fleet.members if fnmatchcase(name, event.robot)]
        if not robots:
            raise DocumentError(f"{where}: robot: no robot is called {event.robot!r}")
        for robot in robots:
            if event.component is None:
                _plan_order(fleet, robot, event)
            else:
                _plan_fault(fleet, robot, event, where)


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


def _plan_order(fleet: Fleet, robot: str, event: EventModel) -> None:
    period = event.period or FLAP_PERIOD
    wanted = Order(event.what, event.length, event.by, event.rate, period)

    def happen(now: float) -> Iterator[Happening]:
        yield Note(now, f"{robot}: {event.what}")
        yield from order(fleet, robot, wanted)

    fleet.plan(event.at, happen)


def _plan_fault(fleet: Fleet, robot: str, event: EventModel, where: str) -> None:
    components = fleet.member(robot).robot.components
    matching = [c for c in components if fnmatchcase(c.name, event.component or "")]
    if not matching:
        known = ", ".join(fleet.member(robot).robot.component_names())
        raise DocumentError(f"{where}: component: {robot} has only {known}")
    for component in matching:
        if event.what not in component.known_faults():
            known = ", ".join(component.known_faults())
            raise DocumentError(f"{where}: what: {component.name} knows only {known}")
        _plan_change(fleet, robot, component.name, event)


def _plan_change(fleet: Fleet, robot: str, component: str, event: EventModel) -> None:
    def begin(now: float) -> Iterator[Happening]:
        if component not in fleet.member(robot).robot.component_names():
            yield Note(now, f"{robot}, {component}: is there no more since its settings changed")
            return
        if event.what == "ok":
            yield from change(now, None)
            return
        period = event.period or COMPONENT_FLAP_PERIOD
        fault = Fault(event.what, now, event.message, period)
        yield from change(now, fault)
        if event.length:
            fleet.plan(now + event.length, lambda then: end(then, fault))

    def change(now: float, fault: Fault | None) -> Iterator[Happening]:
        told = f"{fault.what} {fault.message}".rstrip() if fault else "ok"
        yield Note(now, f"{robot}, {component}: {told}")
        fleet.inject(robot, component, fault)

    def end(now: float, fault: Fault) -> Iterator[Happening]:
        """End the event's own fault: another may have begun since, or the component have gone."""
        found = [c for c in fleet.member(robot).robot.components if c.name == component]
        if found and found[0].fault is fault:
            yield from change(now, None)

    fleet.plan(event.at, begin)
