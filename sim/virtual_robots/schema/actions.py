"""The schema of an action that a robot serves, and of the goals that a client sends to it."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field, StringConstraints, model_validator

from virtual_robots.schema.conditions import Name
from virtual_robots.schema.documents import Document

Type = Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*/action/[A-Z][A-Za-z0-9]*$")]
# Of Nav2, of a sourced ROS, of the package index: the status of goals is the same for all.
TYPES = (
    "nav2_msgs/action/NavigateToPose",
    "tf2_msgs/action/LookupTransform",
    "test_msgs/action/Fibonacci",
)


class ActionModel(Document):
    """An action: the first of ``types`` that is installed is its type.

    A client sends goals, which take ``takes`` seconds, with ``pause`` seconds in between. While the
    component ``needs`` has a fault, goals are aborted, and after ``tries`` of these none is sent.
    """

    name: Annotated[str, StringConstraints(pattern=r"^[a-z][a-z0-9_]*(/[a-z][a-z0-9_]*)*$")]
    types: Annotated[tuple[Type, ...], Field(min_length=1)] = TYPES
    takes: tuple[float, float] = (4.0, 8.0)
    pause: float = Field(default=4.0, ge=1)
    needs: Name | None = None
    tries: int = Field(default=2, ge=1)

    @model_validator(mode="after")
    def _takes_a_range(self) -> ActionModel:
        shortest, longest = self.takes
        if not 1 <= shortest <= longest:
            raise ValueError(f"takes: {shortest:g} to {longest:g} seconds; write [4, 8], 1 or more")
        return self
