"""What is wrong with a config: each problem with its place and the way out, all of them at once.

Knows nothing of YAML or pydantic; they are translated before they come here.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from ros_diagnostics_exporter.texts import printable

LISTED = 20  # problems, or warnings, that are listed one by one
MOST = 1000  # problems of entries that are worked out; a wrong file may have any number
_MOST_SAID = 250  # characters of each part of a problem


def shortened(text: str) -> str:
    """`text`, or its begin where it is too long for a line of the log."""
    return text if len(text) <= _MOST_SAID else text[: _MOST_SAID - 3] + "..."


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
        key = f"{shortened(self.key)}: " if self.key else ""
        return printable(f"{place}: {key}{shortened(self.what)}; {shortened(self.remedy)}")


class ConfigError(ValueError):
    """The config cannot be used; ``str()`` has a line for each of the first ``LISTED`` problems.

    ``sources`` are the files and folders that were looked at, so that a change of any of them
    can be noticed although they did not make a Fleet.
    """

    def __init__(self, problems: Iterable[Problem], sources: Iterable[Path] = ()) -> None:
        self.problems = tuple(sorted(set(problems), key=_place))
        self.sources = tuple(sources)
        super().__init__(self.text(LISTED))

    def text(self, listed: int) -> str:
        """The first ``listed`` problems, one line each, and how many more there are."""
        lines = [str(problem) for problem in self.problems[:listed]]
        more = len(self.problems) - listed
        if more > 0:
            least = "at least " if len(self.problems) >= MOST else ""
            lines.append(f"and {least}{more} more problems, listed once these are mended")
        return "\n".join(lines)


def _place(problem: Problem) -> tuple[str, int, str]:
    return (str(problem.file), problem.line or 0, str(problem))
