"""The schema of a kind file: components, their variables, rules and faults.

No time and no randomness: simulation/components.py runs these models.
"""

from __future__ import annotations

import string
from typing import Annotated, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from virtual_robots.model import LEVEL_NAMES
from virtual_robots.schema.actions import ActionModel
from virtual_robots.schema.conditions import Choice, LevelName, Name, Rule
from virtual_robots.schema.documents import Document
from virtual_robots.schema.topics import Element, TopicModel, Tree, leaves

Percent = Annotated[float, Field(ge=0, le=100)]
RESERVED = frozenset({*LEVEL_NAMES, "silent", "flap"})


class Walk(Document):
    """A quantity that drifts between ``low`` and ``high`` by at most ``walk`` a second."""

    walk: float = Field(ge=0)
    start: float
    low: float
    high: float

    @model_validator(mode="after")
    def _start_lies_between(self) -> Walk:
        if not self.low <= self.start <= self.high:
            raise ValueError(f"start {self.start} must lie between low and high")
        return self


class Battery(Document):
    """A charge in percent: it drains, is charged from ``dock_at`` up to ``leave_at``, drains again.

    ``drain`` and ``charge`` in percent an hour. ``start`` may be a range, drawn for each robot.
    """

    battery: Literal[True]
    start: Percent | tuple[Percent, Percent]
    drain: float = Field(ge=0)
    charge: float = Field(ge=0)
    dock_at: float = Field(ge=-1, le=100)
    leave_at: float = Field(ge=0, le=100)


class Linear(Document):
    """A quantity that follows another one: ``at_0`` and ``at_100`` are its ends."""

    follows: Name
    at_0: float
    at_100: float


class Count(Document):
    """A quantity that grows by ``count`` a second."""

    count: float
    start: float = 0


def _variable_type(raw: object) -> str | None:
    """Return the first key that only one type has, so that errors are about that type."""
    keys = raw if isinstance(raw, dict) else {}
    return next((key for key in ("walk", "battery", "follows", "count") if key in keys), None)


Variable = Annotated[
    Annotated[Walk, Tag("walk")]
    | Annotated[Battery, Tag("battery")]
    | Annotated[Linear, Tag("follows")]
    | Annotated[Count, Tag("count")],
    Discriminator(
        _variable_type,
        custom_error_type="variable",
        custom_error_message="needs 'walk', 'battery', 'follows' or 'count'",
    ),
]


class FaultModel(Document):
    """A fault by name: it drives a variable ``to`` a value ``over`` seconds, or sets a level."""

    drive: Name | None = None
    to: float = 0
    over: float = Field(default=0, ge=0)
    level: LevelName | None = None
    message: str = ""

    @model_validator(mode="after")
    def _does_something(self) -> FaultModel:
        if (self.drive is None) == (self.level is None):
            raise ValueError("needs 'drive' (with 'to' and 'over') or 'level' (with 'message')")
        return self


class ComponentModel(Document):
    """One or ``count`` components; ``{n}`` in name and hardware_id is the number.

    ``message``, and the texts in ``values``, may use the variables, as in ``{temperature:.1f}``,
    and the ``texts``, which depend on variables. A battery `level` also gives `level_charging` (1
    while it is charged, else 0). ``warn`` and ``error`` are the messages of a fault that brings
    none of its own; of the ``rules`` the first that holds counts. What ``publishes`` a topic is in
    no array.
    """

    name: Name
    count: int = Field(default=1, ge=0)
    hardware_id: str = ""
    message: str = "OK"
    warn: str = "Warning"
    error: str = "Error"
    variables: dict[str, Variable] = Field(default_factory=dict)
    texts: dict[str, Choice] = Field(default_factory=dict)
    values: dict[str, str] = Field(default_factory=dict)
    rules: tuple[Rule, ...] = ()
    publishes: TopicModel | None = None
    faults: dict[str, FaultModel] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _names_are_known(self) -> ComponentModel:
        known = self._numbers()
        conditions = (*self.rules, *self.texts.values(), *self._elements())
        used = {condition.variable for condition in conditions}
        used |= {fault.drive for fault in self.faults.values() if fault.drive}
        used |= {v.follows for v in self.variables.values() if isinstance(v, Linear)}
        for template in self._templates():
            used |= {name for _, name, _, _ in string.Formatter().parse(template) if name}
        used -= set(self.texts)
        if used - known:
            raise ValueError(f"{self.name}: no variable {', '.join(sorted(used - known))}")
        self._try_templates()
        if taken := RESERVED & set(self.faults):
            raise ValueError(f"{self.name}: a fault cannot be called {', '.join(sorted(taken))}")
        return self

    def _numbers(self) -> set[str]:
        batteries = {name for name, v in self.variables.items() if isinstance(v, Battery)}
        return {*self.variables, *(f"{name}_charging" for name in batteries)}

    def _leaves(self) -> tuple[Tree, ...]:
        return () if self.publishes is None else tuple(leaves(self.publishes.fields))

    def _elements(self) -> tuple[Element, ...]:
        return tuple(each for each in self._leaves() if isinstance(each, Element))

    def _templates(self) -> tuple[str, ...]:
        fields = (each for each in self._leaves() if isinstance(each, str))
        return (self.message, *self.values.values(), *fields)

    def _try_templates(self) -> None:
        """Fill the templates in once, so that an error shows now and not at the first message."""
        values: dict[str, float | str] = {**dict.fromkeys(self._numbers(), 1.0)}
        values |= dict.fromkeys(self.texts, "")
        try:
            for template in self._templates():
                template.format_map(values)
            for numbered in (self.name, self.hardware_id):
                numbered.format(n=1)
        except (KeyError, IndexError, ValueError) as error:
            raise ValueError(f"{self.name}: a text cannot be filled in: {error}") from error


class KindModel(Document):
    """A kind of robot; ``analyzers`` is the diagnostics.yaml beside this file.

    One whose components all publish topics of their own has no diagnostics, and no analyzers.
    ``actions`` are those that it serves.
    """

    description: str = ""
    components: tuple[ComponentModel, ...]
    actions: tuple[ActionModel, ...] = ()
    analyzers: Name | None = None
    period: float = Field(default=1.0, gt=0)

    @property
    def has_diagnostics(self) -> bool:
        """Whether any component is in arrays."""
        return any(each.publishes is None for each in self.components)

    @model_validator(mode="after")
    def _has_analyzers_for_diagnostics(self) -> KindModel:
        if self.has_diagnostics != (self.analyzers is not None):
            what = "needs analyzers" if self.has_diagnostics else "has analyzers and no diagnostics"
            raise ValueError(what)
        return self

    @model_validator(mode="after")
    def _actions_need_what_is_there(self) -> KindModel:
        names = {
            each.name.format(n=n) for each in self.components for n in range(1, each.count + 1)
        }
        for action in self.actions:
            if action.needs is not None and action.needs not in names:
                known = ", ".join(sorted(names))
                raise ValueError(
                    f"{action.name}: needs: {action.needs!r} is no component of {known}"
                )
        if names & (actions := {each.name for each in self.actions}):
            raise ValueError(f"{', '.join(names & actions)} is a component and an action")
        return self
