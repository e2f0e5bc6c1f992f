"""What every model of fleet.yml has in common, and how one of its keys is written down."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


class Entry(BaseModel):
    """A mapping in fleet.yml: unknown keys are errors, nothing is converted behind one's back."""

    model_config = ConfigDict(
        extra="forbid",
        strict=True,
        frozen=True,
        allow_inf_nan=False,
        model_title_generator=lambda model: model.__name__.removesuffix("Entry"),
    )


def optional(description: str, *, example: Any, default: Any = None) -> Any:
    """An optional key; ``default`` is what `resolve` takes where the key is not given.

    The default is told to readers (schema, documentation), while the model keeps None for
    "not given": `resolve` looks for it in the profile that is extended, for instance.
    """
    extra = {} if default is None else {"default": default}
    return Field(
        default=None, description=description, examples=[example], json_schema_extra=extra or None
    )


def required(description: str, *, example: Any) -> Any:
    """A key that has to be given."""
    return Field(description=description, examples=[example])
