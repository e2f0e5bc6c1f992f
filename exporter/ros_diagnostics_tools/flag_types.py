"""What flags may have as values, and how it is written."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, Generic, TypeVar

import click

PATH = click.Path(path_type=Path)
_PORTS = 65_535
_UNITS = {"kB": 1_000, "MB": 1_000_000}
T = TypeVar("T")


class Written(click.ParamType[T], Generic[T]):
    """A value that ``read`` makes of its text. Where it raises ValueError, the flag is wrong."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> T:
        """The value; one that is no text is a default, and stays as it is."""
        try:
            return self.read(value) if isinstance(value, str) else value
        except ValueError as error:
            self.fail(str(error), param, ctx)

    def read(self, text: str) -> T:
        """The value that is written."""
        raise NotImplementedError


class Address(Written[tuple[str, int]]):
    """A host and a port; its value is both."""

    name = "host:port"

    def read(self, text: str) -> tuple[str, int]:
        """Both of them."""
        host, _, port = text.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) <= _PORTS:
            raise ValueError(f"{text!r} is not an address such as localhost:25")
        return host.removeprefix("[").removesuffix("]"), int(port)


class NamedPair(Written[tuple[str, str]]):
    """A name and its value.

    Args:
        name: What it is, in lower case.
        written: How it is written, and an example: for the error.
    """

    def __init__(self, name: str, written: str) -> None:
        self.name = name
        self._written = written

    def read(self, text: str) -> tuple[str, str]:
        """The name and the value."""
        name, separator, of = text.partition("=")
        if not (name and separator):
            raise ValueError(f"{text!r} is not {self._written}")
        return name, of


class Size(Written[int]):
    """A size as 100kB; its value in bytes."""

    name = "size"

    def read(self, text: str) -> int:
        """The bytes."""
        found = re.fullmatch(r"([0-9]{1,6}) ?(kB|MB)", text)
        if found is None:
            raise ValueError(f"{text!r} is not a size such as 100kB or 2MB")
        return int(found[1]) * _UNITS[found[2]]


class Checked(Written[T]):
    """What ``check`` makes of a text that it accepts."""

    name = "text"

    def __init__(self, check: Callable[[Any], T]) -> None:
        self._check = check

    def read(self, text: str) -> T:
        """The value."""
        return self._check(text)
