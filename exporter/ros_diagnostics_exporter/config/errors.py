"""What is wrong with a config: each problem with its place and the way out, all of them at once.

Knows nothing of YAML or pydantic; they are translated before they come here.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from ros_diagnostics_exporter.texts import printable


class WrongValueError(ValueError):
    """One value is not acceptable: ``what`` is wrong with it, and what would be right."""

    def __init__(self, what: str, remedy: str) -> None:
        super().__init__(f"{what}; {remedy}")
        self.what = what
        self.remedy = remedy


class Problem(NamedTuple):
    """One thing wrong in one place; ``line`` counts from 1, ``key`` may be empty (a whole file)."""

    file: Path
    line: int | None
    key: str
    what: str
    remedy: str

    def __str__(self) -> str:
        place = str(self.file) if self.line is None else f"{self.file}:{self.line}"
        key = f"{self.key}: " if self.key else ""
        return printable(f"{place}: {key}{self.what}; {self.remedy}")


class ConfigError(ValueError):
    """The config cannot be used; ``str()`` is the complete text, one line for each problem.

    ``sources`` are the files and folders that were looked at, so that a change of any of them
    can be noticed although they did not make a Fleet.
    """

    def __init__(self, problems: Iterable[Problem], sources: Iterable[Path] = ()) -> None:
        self.problems = tuple(sorted(set(problems), key=_place))
        self.sources = tuple(sources)
        super().__init__("\n".join(map(str, self.problems)))


def _place(problem: Problem) -> tuple[str, int, str]:
    return (str(problem.file), problem.line or 0, str(problem))
