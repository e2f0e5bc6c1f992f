"""Text of fleet.yml that is matched against what robots say -> compiled patterns.

Robots' strings are not trusted: RE2 takes linear time on all of them, and lookups cut what they
search (see `lookup`).
"""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import PlainValidator, WithJsonSchema

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.regex import Pattern, RegexError, escape
from ros_diagnostics_exporter.config.scalars import shown, text

MAX_PATTERN = 500  # characters


def expression(source: Any) -> Pattern:
    """A regular expression in RE2's syntax, compiled."""
    found = text(source)
    if len(found) > MAX_PATTERN:
        what = f"the regular expression has {len(found)} characters"
        raise WrongValueError(what, f"use at most {MAX_PATTERN}")
    try:
        return Pattern(found)
    except RegexError as error:
        raise WrongValueError(
            f"{shown(found)} is not a regular expression of RE2, Prometheus' dialect ({error})",
            "mend it (RE2 has no lookaround and no backreferences), "
            "or write plain text without regex:",
        ) from None


def _plain_or_expression(value: Any, plain: Any) -> Pattern:
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
    made: Pattern = plain(found)
    return made


def word(value: Any) -> Pattern:
    """A word to be searched anywhere, case ignored; or {regex: ...}, to be searched as it is."""
    return _plain_or_expression(value, lambda word: Pattern(escape(word), ignore_case=True))


def wildcard(value: Any) -> Pattern:
    """A whole text in which `*` stands for anything; or {regex: ...}; both for fullmatch.

    A whole number is taken as it would be written, as for the value of a label.
    """
    if isinstance(value, int) and not isinstance(value, bool):
        value = str(value)
    return _plain_or_expression(value, _from_wildcard)


def _from_wildcard(source: str) -> Pattern:
    return Pattern(".*".join(map(escape, source.split("*"))), dot_all=True)


def _listed(value: Any, one: Any) -> tuple[Pattern, ...]:
    items = value if isinstance(value, list) else [value]
    if not items:
        raise WrongValueError("is an empty list", "leave it out or fill it in")
    return tuple(one(item) for item in items)


def words(value: Any) -> tuple[Pattern, ...]:
    """One word or a list of them."""
    return _listed(value, word)


def wildcards(value: Any) -> tuple[Pattern, ...]:
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
    tuple[Pattern, ...],
    PlainValidator(words),
    WithJsonSchema({"title": "words", "anyOf": _one_or_more(_WORD)}),
]
Wildcards = Annotated[
    tuple[Pattern, ...],
    PlainValidator(wildcards),
    WithJsonSchema({"title": "texts with *", "anyOf": _one_or_more(_TEXT)}),
]
