"""Text of fleet.yml that is matched against what robots say -> compiled patterns.

Robots' strings are not trusted, the config's author is: so expressions that can take exponential
time on a hostile string are refused here, and lookups cut what they search (see `lookup`).
"""

from __future__ import annotations

import re
from typing import Annotated, Any

from pydantic import PlainValidator, WithJsonSchema

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.scalars import shown, text

MAX_PATTERN = 500  # characters
_REPEAT = re.compile(r"[*+]|\{\d*,\}")  # a repetition without an upper bound
_TOKEN = re.compile(
    r"\\.|\[\^?\]?(?:\\.|[^\]\\])*\]|\(|\)|[*+?]\??|\{\d*(?:,\d*)?\}\??|.", re.DOTALL
)


def expression(source: Any) -> re.Pattern[str]:
    """A regular expression, compiled, if it is valid and cannot run away."""
    found = text(source)
    if len(found) > MAX_PATTERN:
        what = f"the regular expression has {len(found)} characters"
        raise WrongValueError(what, f"use at most {MAX_PATTERN}")
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
    if _runs_away(found):
        raise WrongValueError(
            f"{shown(found)} repeats a group that repeats itself, which can take for ever",
            "repeat only once, as (ab)+ in place of (a*b*)+",
        )
    return compiled


def _runs_away(source: str) -> bool:
    """Whether an unbounded repetition stands inside a group that is itself repeated unboundedly.

    That is the shape of exponential backtracking, `(a+)+`. Refuses some harmless ones as well.
    """
    inside = [False]  # for each open group: has it an unbounded repetition so far?
    closed = False  # ... and had the group that was closed just now?
    for part in _TOKEN.findall(source):
        if part == "(":
            inside.append(False)
        elif part == ")":
            closed = inside.pop()
            inside[-1] = inside[-1] or closed
            continue
        elif _REPEAT.match(part):
            if closed:
                return True
            inside[-1] = True
        closed = False
    return False


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
    """A whole text in which `*` stands for anything; or {regex: ...}; both for fullmatch."""
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


_REGEX = {
    "type": "object",
    "properties": {"regex": {"type": "string", "maxLength": MAX_PATTERN}},
    "required": ["regex"],
    "additionalProperties": False,
}
_ONE = [{"type": "string", "minLength": 1, "maxLength": MAX_PATTERN}, _REGEX]
_MANY = [*_ONE, {"type": "array", "minItems": 1, "items": {"anyOf": _ONE}}]

Words = Annotated[
    tuple[re.Pattern[str], ...],
    PlainValidator(words),
    WithJsonSchema({"title": "words", "anyOf": _MANY}),
]
Wildcards = Annotated[
    tuple[re.Pattern[str], ...],
    PlainValidator(wildcards),
    WithJsonSchema({"title": "texts with *", "anyOf": _MANY}),
]
Wildcard = Annotated[
    re.Pattern[str],
    PlainValidator(wildcard),
    WithJsonSchema({"title": "text with *", "anyOf": _ONE}),
]
