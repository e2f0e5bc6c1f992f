"""Text of fleet.yml that is matched against what robots say -> compiled patterns.

Robots' strings are not trusted, the config's author is: so expressions that can take exponential
time on a hostile string are refused here, and lookups cut what they search (see `lookup`).
"""

from __future__ import annotations

import re
import sys
from typing import Annotated, Any

from pydantic import PlainValidator, WithJsonSchema

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.scalars import shown, text

MAX_PATTERN = 500  # characters
MAX_REPEATS = 3  # without a bound; with four, 256 hostile characters take 15 s, with three 0.8 s
_TOKEN = re.compile(
    r"\\."  # an escaped sign
    r"|\[\^?\]?(?:\\.|[^\]\\])*\]"  # a set of signs
    r"|\(\?[^:=!<>)]*[:=!<>)]?|\(|\)"  # the begin of a group, (?i), the end of a group
    r"|\{\d*(?:,\d*)?\}|.",
    re.DOTALL,
)
_AMBIGUOUS = re.compile(r"\[\^?\[|\[.+(?:--|&&|~~|\|\|)", re.DOTALL)
_COUNT = re.compile(r"\{(\d*)(,?)(\d*)\}")
_MANY = 8  # as often is as bad as without a bound


def expression(source: Any) -> re.Pattern[str]:
    """A regular expression, compiled, if it is valid and cannot run away."""
    found = text(source)
    if len(found) > MAX_PATTERN:
        what = f"the regular expression has {len(found)} characters"
        raise WrongValueError(what, f"use at most {MAX_PATTERN}")
    # Python warns of these sets, which it may read as operations on sets one day.
    if any(_AMBIGUOUS.match(part) for part in _TOKEN.findall(found)):
        what = f"{shown(found)} has a set of signs with [, --, &&, ~~ or || in it"
        raise WrongValueError(what, "put a backslash before each of them")
    try:
        compiled = re.compile(found)
    except (re.error, OverflowError, RecursionError) as error:
        position = getattr(error, "pos", None)
        place = "" if position is None else f" at character {position + 1}"
        reason = getattr(error, "msg", str(error))
        raise WrongValueError(
            f"{shown(found)} is not a regular expression ({reason}{place})",
            "mend it, or write plain text without regex:",
        ) from None
    danger = "uses (?x)" if compiled.flags & re.VERBOSE else _danger(found)
    if danger:
        remedy = "write it without: a robot's text could make it search for ever"
        raise WrongValueError(f"{shown(found)} {danger}", remedy)
    return compiled


def _danger(source: str) -> str | None:
    """What makes a valid expression take exponential or too much time on a hostile string.

    Exponential is a repeated group of which one text can be read in several ways, `(a+)+`: here a
    repeated group with a repetition, an option or alternatives in it. That refuses some harmless
    ones as well. Many repetitions side by side, `.*.*.*.*`, take a high power of the length.
    """
    choice = [False]  # for each open group: can one text be read in several ways in it?
    closed = False  # ... and in the group that was closed just now?
    repeats = 0
    for part in _TOKEN.findall(source):
        if part == ")":
            closed = choice.pop()
            choice[-1] = choice[-1] or closed
            continue
        least, most = _times(part)
        if closed and most >= _MANY:
            return "repeats a group that can match one text in several ways"
        closed = False
        if part.startswith("(") and not part.endswith(")"):
            choice.append(False)
        elif most > least or part == "|":
            choice[-1] = True
            repeats += most - least >= _MANY
    return f"has more than {MAX_REPEATS} repetitions" if repeats > MAX_REPEATS else None


def _times(part: str) -> tuple[int, int]:
    """How often, at least and at most, this part of an expression takes what is before it."""
    if part in ("*", "+", "?"):
        return 0, 1 if part == "?" else sys.maxsize
    count = _COUNT.fullmatch(part)
    if count is None:
        return 1, 1
    least, comma, most = count.groups()
    if comma and not most:
        return int(least or 0), sys.maxsize
    return int(least or 0), int(most or least or 0)


def _plain_or_expression(value: Any, plain: Any) -> re.Pattern[str]:
    if isinstance(value, dict):
        if set(value) != {"regex"}:
            raise WrongValueError(
                f"{shown(value)} is not a pattern", 'write text or {regex: "..."}'
            )
        return expression(value["regex"])
    found = text(value)
    if not found.strip():
        raise WrongValueError(
            "is empty text, which would match everything", "leave it out or fill it in"
        )
    if len(found) > MAX_PATTERN:
        raise WrongValueError(f"the text has {len(found)} characters", f"use at most {MAX_PATTERN}")
    made: re.Pattern[str] = plain(found)
    return made


def word(value: Any) -> re.Pattern[str]:
    """A word to be searched anywhere, case ignored; or {regex: ...}, to be searched as it is."""
    return _plain_or_expression(value, lambda word: re.compile(re.escape(word), re.IGNORECASE))


def wildcard(value: Any) -> re.Pattern[str]:
    """A whole text in which `*` stands for anything; or {regex: ...}; both for fullmatch.

    A whole number is taken as it would be written, as for the value of a label.
    """
    if isinstance(value, int) and not isinstance(value, bool):
        value = str(value)
    return _plain_or_expression(value, _from_wildcard)


def _from_wildcard(source: str) -> re.Pattern[str]:
    if source.count("*") > 3:
        raise WrongValueError(
            f"{shown(source)} has more than three *", "use fewer, or {regex: ...}"
        )
    return re.compile(".*".join(map(re.escape, source.split("*"))), re.DOTALL)


def _listed(value: Any, one: Any) -> tuple[re.Pattern[str], ...]:
    items = value if isinstance(value, list) else [value]
    if not items:
        raise WrongValueError("is an empty list", "leave it out or fill it in")
    return tuple(one(item) for item in items)


def words(value: Any) -> tuple[re.Pattern[str], ...]:
    """One word or a list of them."""
    return _listed(value, word)


def wildcards(value: Any) -> tuple[re.Pattern[str], ...]:
    """One text with wildcards or a list of them."""
    return _listed(value, wildcard)


_REGEX: dict[str, Any] = {
    "type": "object",
    "properties": {"regex": {"type": "string", "maxLength": MAX_PATTERN}},
    "required": ["regex"],
    "additionalProperties": False,
}
_WORD = [{"type": "string", "minLength": 1, "maxLength": MAX_PATTERN}, _REGEX]
_TEXT = [*_WORD, {"type": "integer"}]


def _one_or_more(one: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [*one, {"type": "array", "minItems": 1, "items": {"anyOf": one}}]


Words = Annotated[
    tuple[re.Pattern[str], ...],
    PlainValidator(words),
    WithJsonSchema({"title": "words", "anyOf": _one_or_more(_WORD)}),
]
Wildcards = Annotated[
    tuple[re.Pattern[str], ...],
    PlainValidator(wildcards),
    WithJsonSchema({"title": "texts with *", "anyOf": _one_or_more(_TEXT)}),
]
