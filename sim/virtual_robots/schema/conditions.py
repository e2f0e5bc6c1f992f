"""What several parts of a kind file are made of: names, levels, and conditions of variables."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints, model_validator

from virtual_robots.schema.documents import Document

LevelName = Literal["ok", "warn", "error", "stale"]
Name = Annotated[str, StringConstraints(min_length=1)]


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
