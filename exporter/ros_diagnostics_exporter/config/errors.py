"""What is wrong with a config: each problem with its place and the way out, all of them at once.

pydantic's errors are put into plain words here.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from ros_diagnostics_exporter.config.keys import Where, keys_at
from ros_diagnostics_exporter.texts import nearest, printable

LISTED = 20  # problems, or warnings, that are listed one by one
MOST = 1000  # problems that are collected; a file may have any number
_LONGEST = 250  # characters of each part of a problem


def shortened(text: str) -> str:
    """`text`, or its beginning if it is too long for a log line."""
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


def quoted(value: object) -> str:
    """A value as an error quotes it: as in the file, on one line, shortened."""
    found = "nothing" if value is None else json.dumps(value, ensure_ascii=False, default=str)
    found = printable(found)
    return found if len(found) <= 60 else found[:57] + "..."


def first_error(error: ValidationError, whole: str = "it") -> str:
    """The first thing that is wrong with data of a program; ``whole`` names all of them."""
    first = error.errors(include_url=False, include_input=False, include_context=False)[0]
    place = ".".join(map(str, first["loc"])) or whole
    return f"{place:.60}: {first['msg']:.120}"


class WrongValueError(ValueError):
    """One value is not acceptable: ``what`` is wrong with it, and what would be right.

    ``below`` leads from the value to the part of it that is wrong.
    """

    def __init__(self, what: str, remedy: str, below: Where = ()) -> None:
        super().__init__(f"{what}; {remedy}")
        self.what = what
        self.remedy = remedy
        self.below = below


class Finding(NamedTuple):
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

    ``sources`` are the files and folders that were read, so that they can be watched for a change.
    """

    def __init__(self, problems: Iterable[Finding], sources: Iterable[Path] = ()) -> None:
        self.problems = tuple(sorted(set(problems), key=_place))
        self.sources = tuple(sources)
        super().__init__(self.text(LISTED))

    def text(self, listed: int) -> str:
        """The first ``listed`` problems, one line each, and how many more there are."""
        lines = [str(problem) for problem in self.problems[:listed]]
        more = len(self.problems) - listed
        if more > 0:
            least = "at least " if len(self.problems) >= MOST else ""
            lines.append(f"and {least}{more} more problems, listed once these are fixed")
        return "\n".join(lines)


def _place(problem: Finding) -> tuple[str, int, str]:
    return (str(problem.file), problem.line or 0, str(problem))


_QUOTES = "put it in quotes"
_PLAIN = "write digits without quotes"
_PAIRS = "write it as key: value"
_KINDS = {
    "string_type": ("text", _QUOTES),
    "int_type": ("a whole number", _PLAIN),
    "float_type": ("a number", _PLAIN),
    "finite_number": ("a finite number", _PLAIN),
    "bool_type": ("true or false", "write true or false"),
    "list_type": ("a list", "start each entry with a dash"),
    "dict_type": ("a mapping", _PAIRS),
    "model_type": ("a mapping", _PAIRS),
    "dataclass_type": ("a mapping", _PAIRS),
}
_PROFILE = ("profiles", "default")
RENAMED = {"behind": "depends_on", "capsules": "recordings"}
_LIMITS = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}


class Explanation(NamedTuple):
    """An error in plain words; ``where`` is relative to the value that was validated."""

    where: Where
    what: str
    remedy: str


def explanation(error: ErrorDetails, model: type) -> Explanation:
    """One error of validating against `model`, explained."""
    where = tuple(part for part in error["loc"] if part != "[key]")
    wrong = error.get("ctx", {}).get("error")
    if isinstance(wrong, WrongValueError):
        return Explanation((*where, *wrong.below), wrong.what, wrong.remedy)
    if error["type"] == "missing":
        return Explanation(where, "is missing", f"add {where[-1]}: ...")
    if error["type"] in ("extra_forbidden", "unexpected_keyword_argument"):
        key = str(where[-1])
        if len(where) == 1 and key in keys_at(model, _PROFILE):
            return Explanation(where, "is a key of profiles", f"write it in {'.'.join(_PROFILE)}")
        return Explanation(where, *_unknown(key, keys_at(model, where[:-1])))
    return Explanation(where, *_about_value(error))


def _unknown(key: str, known: list[str]) -> tuple[str, str]:
    if RENAMED.get(key) in known:
        return f"is now called {RENAMED[key]}", "rename it"
    return "is not a key", suggestion(key, known)


def _about_value(error: ErrorDetails) -> tuple[str, str]:
    kind, value, context = error["type"], quoted(error["input"]), error.get("ctx", {})
    if kind == "literal_error":
        allowed = re.findall(r"'([^']+)'", context["expected"])
        return f"{value} is not allowed", _one_of(allowed)
    if kind in _KINDS:
        expected, remedy = _KINDS[kind]
        return f"{value} is not {expected}", remedy
    for limit, words in _LIMITS.items():
        if limit in context:
            return f"{value} is out of range", f"use {words} {context[limit]}"
    return f"{value} is not valid", error["msg"][:1].lower() + error["msg"][1:]


def suggestion(word: str, known: Iterable[str]) -> str:
    """The remedy for an unknown word: the most similar known one, or a list of all."""
    words = list(known)
    best = nearest(word[:100], words)  # the time of a comparison is quadratic
    if best:
        return f"did you mean {best}?"
    return _one_of(words) if words else "remove it"


def _one_of(words: list[str]) -> str:
    return f"use {words[0]}" if len(words) == 1 else f"use one of {', '.join(words)}"
