"""Options that are written NAME=VALUE."""

from __future__ import annotations

import click


class NamedPair(click.ParamType[tuple[str, str]]):
    """A name and its value.

    Args:
        name: What it is, in lower case.
        written: How it is written, and an example: for the error.
    """

    def __init__(self, name: str, written: str) -> None:
        self.name = name
        self._written = written

    def convert(
        self,
        value: str | tuple[str, str],
        param: click.Parameter | None,
        ctx: click.Context | None,
    ) -> tuple[str, str]:
        """The name and the value."""
        if not isinstance(value, str):
            return value
        name, separator, of = value.partition("=")
        if not (name and separator):
            self.fail(f"{value!r} is not {self._written}", param, ctx)
        return name, of
