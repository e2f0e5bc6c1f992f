"""The schema of a kind file: components, their variables, rules and faults.

No time and no randomness: simulation/components.py runs these models.
"""

from __future__ import annotations

import string
from typing import Annotated, Literal

from pydantic import Discriminator, Field, StringConstraints, Tag, model_validator

from virtual_robots.model import LEVEL_NAMES
from virtual_robots.schema.documents import Document

LevelName = Literal["ok", "warn", "error", "stale"]
Name = Annotated[str, StringConstraints(min_length=1)]
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


class Condition(Document):
    """Whether a variable is above, or below, a limit."""

    variable: Name = Field(alias="if")
    above: float | None = None
    below: float | None = None

    @model_validator(mode="after")
    def _has_one_limit(self) -> Condition:
        if (self.above is None) == (self.below is None):
            raise ValueError("needs 'above' or 'below', and not both")
        return self

    def holds(self, value: float) -> bool:
        """Whether it holds for this value of the variable."""
        if self.above is not None:
            return value > self.above
        return self.below is not None and value < self.below


class Rule(Condition):
    """A level and a message while the condition holds."""

    level: LevelName
    message: str


class Choice(Condition):
    """One text while the condition holds, another otherwise."""

    then: str
    otherwise: str


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


class TopicModel(Document):
    """A topic of a component's own: a message of ``type``, whose ``fields`` are texts.

    What is ``latched`` is published when it changes, and kept for late joiners.
    """

    topic: Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*(/[a-z][a-z0-9_]*)*$")]
    type: Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*/msg/[A-Z][A-Za-z0-9]*$")]
    fields: dict[str, str]
    latched: bool = False


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
        used = {condition.variable for condition in (*self.rules, *self.texts.values())}
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

    def _templates(self) -> tuple[str, ...]:
        fields = {} if self.publishes is None else self.publishes.fields
        return (self.message, *self.values.values(), *fields.values())

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
    """

    description: str = ""
    components: tuple[ComponentModel, ...]
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
