"""The settings file of the thesis robot: its parameters, and how they change the kind.

The thesis drew levels again and again, up to 100,000 times, until the numbers matched; here they
are drawn directly.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from random import Random
from typing import Any

from pydantic import Field, model_validator

from virtual_robots.schema.conditions import Rule
from virtual_robots.schema.documents import Document, DocumentError, parse, read_mapping
from virtual_robots.schema.kinds import Battery, ComponentModel, KindModel

COUNTS = {
    "Motor {n}": "number_of_motors",
    "Sensor {n}": "number_of_sensors",
    "Laser {n}": "number_of_lasers",
    "Cam {n}": "number_of_cameras",
}
BATTERY_LEVEL = "level"


class ThesisSettings(Document):
    """How many components there are, and how many of them are faulty after each refresh.

    ``refresh_interval`` in seconds, battery levels in percent. Batteries follow their level: they
    are not among the components that are drawn.
    """

    total_errors: int = Field(default=0, ge=0)
    total_warnings: int = Field(default=0, ge=0)
    refresh_interval: float = Field(default=60.0, gt=0)
    number_of_motors: int = Field(default=3, ge=0)
    number_of_sensors: int = Field(default=2, ge=0)
    number_of_lasers: int = Field(default=2, ge=0)
    number_of_cameras: int = Field(default=1, ge=0)
    initial_battery_level: float = Field(default=90.0, ge=0, le=100)
    error_battery_level: float = Field(default=15.0, ge=0, le=100)
    warn_battery_level: float = Field(default=30.0, ge=0, le=100)

    @model_validator(mode="after")
    def _can_be_drawn(self) -> ThesisSettings:
        components = sum(getattr(self, name) for name in COUNTS.values())
        faulty = self.total_errors + self.total_warnings
        if faulty > components:
            raise ValueError(
                f"total_errors + total_warnings is {faulty}, but there are only {components}"
                " components beside the batteries"
            )
        if self.error_battery_level > self.warn_battery_level:
            raise ValueError("error_battery_level must not be above warn_battery_level")
        return self


def load_settings(path: Path) -> ThesisSettings:
    """Read a settings file. Raises DocumentError."""
    return parse(ThesisSettings, read_mapping(path), str(path))


def with_settings(kind: KindModel, settings: ThesisSettings) -> KindModel:
    """The kind with the settings' numbers of components and battery levels.

    Raises DocumentError for a kind that is not the thesis'.
    """
    names = {component.name for component in kind.components}
    if missing := set(COUNTS) - names:
        raise DocumentError(
            f"settings are for the kind thesis; this one has no {', '.join(sorted(missing))}"
        )
    components = tuple(_component_with(component, settings) for component in kind.components)
    return kind.model_copy(update={"components": components})


def draw(settings: ThesisSettings, rng: Random, names: Sequence[str]) -> dict[str, str]:
    """Which of ``names`` are at `error` and `warn` until the next refresh: exactly so many."""
    faulty = rng.sample(names, settings.total_errors + settings.total_warnings)
    return {
        name: "error" if index < settings.total_errors else "warn"
        for index, name in enumerate(faulty)
    }


def _component_with(component: ComponentModel, settings: ThesisSettings) -> ComponentModel:
    if component.name in COUNTS:
        count = getattr(settings, COUNTS[component.name])
        return component.model_copy(update={"count": count})
    battery = component.variables.get(BATTERY_LEVEL)
    if not isinstance(battery, Battery):
        return component
    changed: dict[str, Any] = {
        "start": settings.initial_battery_level,
        # Both thresholds are passed before it is charged.
        "dock_at": settings.error_battery_level / 2,
    }
    return component.model_copy(
        update={
            "variables": {
                **component.variables,
                BATTERY_LEVEL: battery.model_copy(update=changed),
            },
            "rules": tuple(_rule_with(rule, settings) for rule in component.rules),
        }
    )


def _rule_with(rule: Rule, settings: ThesisSettings) -> Rule:
    limits = {"error": settings.error_battery_level, "warn": settings.warn_battery_level}
    if rule.variable != BATTERY_LEVEL or rule.level not in limits:
        return rule
    return rule.model_copy(update={"below": limits[rule.level]})
