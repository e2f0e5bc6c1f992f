"""The state of one component: its variables change with time, faults drive them or set a level.

It does not know its robot, nor ROS.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from random import Random
from typing import NamedTuple

from virtual_robots.model import ERROR, LEVEL_NAMES, OK, STALE, WARN, Status
from virtual_robots.schema.kinds import (
    Battery,
    ComponentModel,
    FaultModel,
    Linear,
    Variable,
    Walk,
)
from virtual_robots.schema.topics import Tree, filled

STARTING_UP = "Node starting up"
FLAP_PERIOD = 2.0


class Fault(NamedTuple):
    """What is wrong with a component since ``since`` (seconds).

    ``what`` is a level's name, `silent` (it reports nothing), `flap` (ERROR and OK in turns of
    ``period`` seconds) or a fault of the component's kind. ``message`` replaces the kind's own.
    """

    what: str
    since: float
    message: str = ""
    period: float = FLAP_PERIOD


class UnknownFaultError(ValueError):
    """A fault that the component does not have; the text lists those that it has."""


@dataclass
class Component:
    """A component with a name of its own; ``rng`` is its share of the robot's seed."""

    model: ComponentModel
    name: str
    hardware_id: str
    rng: Random
    fault: Fault | None = None

    def __post_init__(self) -> None:
        self.variables = {name: self._start(v) for name, v in self.model.variables.items()}
        for name, model in self.model.variables.items():
            if isinstance(model, Battery):
                self.variables[f"{name}_charging"] = 0.0
        self._drive_from = 0.0
        self._return_speed = 0.0  # of a walk that a fault drove out of its range, per second
        self._formats = [(key, text, "{" in text) for key, text in self.model.values.items()]

    def inject(self, fault: Fault | None) -> None:
        """Begin a fault, or end it (None). Raises UnknownFaultError."""
        if fault is not None and fault.what not in self.known_faults():
            known = ", ".join(self.known_faults())
            raise UnknownFaultError(f"{self.name} has no fault {fault.what!r}, only {known}")
        self._end_course()
        self.fault = fault
        if (course := self._course()) and course.drive:
            self._drive_from = self.variables[course.drive]

    def copy_state(self, before: Component) -> None:
        """Take over the variables and the fault of another component, as far as both have them."""
        for name in self.variables.keys() & before.variables.keys():
            self.variables[name] = before.variables[name]
        self._return_speed = before._return_speed
        if before.fault and before.fault.what in self.known_faults():
            self.fault, self._drive_from = before.fault, before._drive_from

    def known_faults(self) -> tuple[str, ...]:
        """Return the names that `inject` accepts."""
        return (*LEVEL_NAMES, "silent", "flap", *self.model.faults)

    def advance(self, now: float, elapsed: float) -> None:
        """Let ``elapsed`` seconds pass for the variables, up to ``now``."""
        for name, model in self.model.variables.items():
            self.variables[name] = self._moved(name, model, elapsed)
        course = self._course()
        if self.fault and course and course.drive:
            share = min(1.0, (now - self.fault.since) / course.over) if course.over else 1.0
            self.variables[course.drive] = self._drive_from + share * (course.to - self._drive_from)

    def status(self, now: float) -> Status | None:
        """What the component reports at ``now``; None while it is silent."""
        if self.fault and self.fault.what == "silent":
            return None
        level, message = self._level_and_message(now)
        template_values = self._template_values()
        values = tuple(
            (key, text.format_map(template_values) if is_format else text)
            for key, text, is_format in self._formats
        )
        return Status(level, self.name, message, self.hardware_id, values)

    def fields(self) -> Tree | None:
        """The fields that it publishes, filled in; None while it is silent."""
        topic = self.model.publishes
        if topic is None or (self.fault and self.fault.what == "silent"):
            return None
        return filled(topic.fields, self._template_values())

    def extreme_fields(self) -> Iterator[Tree]:
        """The fields that it publishes with each variable where it can be, one after the other."""
        for name, model in self.model.variables.items():
            start = self.variables[name]
            driven = (each.to for each in self.model.faults.values() if each.drive == name)
            for self.variables[name] in (start, *_ends(model), *driven):
                yield self.fields()
            self.variables[name] = start

    def starting_up(self) -> Status:
        """Return what diagnostic_updater sends for a task before its first run."""
        return Status(OK, self.name, STARTING_UP)

    def _end_course(self) -> None:
        """Release a driven variable: it returns as fast as it went; a battery must be charged."""
        course = self._course()
        if course is None or course.drive is None:
            return
        if course.over:
            speed = abs(course.to - self._drive_from) / course.over
            # A second fault of the same kind did not move it: it returns as from the first.
            self._return_speed = speed or self._return_speed
        else:
            self.variables[course.drive] = self._drive_from

    def _course(self) -> FaultModel | None:
        return self.model.faults.get(self.fault.what) if self.fault else None

    def _level_and_message(self, now: float) -> tuple[int, str]:
        if self.fault and (fixed := self._fixed_by_fault(self.fault, now)):
            return fixed
        for rule in self.model.rules:
            if rule.holds(self.variables[rule.variable]):
                own = self.fault.message if self.fault and rule.level != "ok" else ""
                return LEVEL_NAMES[rule.level], own or rule.message
        return OK, self._ok_message()

    def _fixed_by_fault(self, fault: Fault, now: float) -> tuple[int, str] | None:
        """Level and message of a fault that sets them itself; None of one that has a course."""
        course = self._course()
        if course and not course.level:
            return None
        if fault.what == "flap":
            faulty = int((now - fault.since) / fault.period) % 2 == 0
            level = ERROR if faulty else OK
        else:
            level = LEVEL_NAMES[course.level if course and course.level else fault.what]
        if level == OK:
            return OK, self._ok_message()
        own = course.message if course else ""
        return level, fault.message or own or self._message_of(level)

    def _message_of(self, level: int) -> str:
        return {WARN: self.model.warn, ERROR: self.model.error, STALE: "Stale"}[level]

    def _ok_message(self) -> str:
        return self.model.message.format_map(self._template_values())

    def _template_values(self) -> Mapping[str, float | str]:
        """What the templates may name."""
        if not self.model.texts:
            return self.variables
        chosen = {
            name: choice.then if choice.holds(self.variables[choice.variable]) else choice.otherwise
            for name, choice in self.model.texts.items()
        }
        return {**self.variables, **chosen}

    def _start(self, model: Variable) -> float:
        if isinstance(model, Linear):
            return model.at_100
        if isinstance(model.start, tuple):
            return self.rng.uniform(*model.start)
        return model.start

    def _moved(self, name: str, model: Variable, elapsed: float) -> float:
        value = self.variables[name]
        if isinstance(model, Walk):
            return self._walked(value, model, elapsed)
        if isinstance(model, Battery):
            return self._charged(name, value, model, elapsed)
        if isinstance(model, Linear):
            share = self.variables[model.follows] / 100
            return model.at_0 + share * (model.at_100 - model.at_0)
        return value + model.count * elapsed

    def _walked(self, value: float, model: Walk, elapsed: float) -> float:
        """A random step; or one back, from where a fault drove it."""
        bound = min(max(value, model.low), model.high)
        if value != bound:
            step = min(self._return_speed * elapsed, abs(bound - value))
            return value + step if bound > value else value - step
        value += (self.rng.random() * 2 - 1) * model.walk * elapsed
        return min(max(value, model.low), model.high)

    def _charged(self, name: str, value: float, model: Battery, elapsed: float) -> float:
        charging = f"{name}_charging"
        if value <= model.dock_at:
            self.variables[charging] = 1.0
        elif value >= model.leave_at:
            self.variables[charging] = 0.0
        rate = model.charge if self.variables[charging] else -model.drain
        return min(100.0, max(0.0, value + rate * elapsed / 3600))


def _ends(model: Variable) -> tuple[float, ...]:
    """Between which values a variable is; none of what grows."""
    if isinstance(model, Walk):
        return model.low, model.high
    if isinstance(model, Battery):
        return 0.0, 100.0
    return (model.at_0, model.at_100) if isinstance(model, Linear) else ()
