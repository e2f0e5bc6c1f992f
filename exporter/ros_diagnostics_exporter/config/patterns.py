"""Patterns and templates of fleet.yml -> compiled expressions.

`Motor`, `amr_*` and {regex: "..."} for names of components, keys and robots; templates with
`{robot}` for topics, names, hosts and shared topics.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Annotated, Any

from ros_diagnostics_exporter.config.errors import WrongValueError, quoted
from ros_diagnostics_exporter.config.keys import Value
from ros_diagnostics_exporter.config.scalars import MAX_NAME, MAX_TOPIC, matching, text
from ros_diagnostics_exporter.regex import Pattern, RegexError, escape

MAX_PATTERN = 500  # characters
ROBOT = "{robot}"
# Every topic; a robot's name is the last part of its namespace.
INNERMOST = re.compile(r"(?:/[A-Za-z0-9_]+)*/(?P<robot>[A-Za-z0-9_]+)/[A-Za-z0-9_]+")
_TOPIC = r"(?:/(?:[A-Za-z_][A-Za-z0-9_]*|[A-Za-z0-9_]*\{robot\}[A-Za-z0-9_]*|\*))+"
_KEY = r"/|(?:[A-Za-z0-9_.:-]|\{robot\})+(?:/(?:\*|(?:[A-Za-z0-9_.:-]|\{robot\})+))*"
_NAME = r"(?:[A-Za-z0-9_.:-]|\{robot\}|\{domain_id\})+"


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
            f"{quoted(found)} is not a regular expression of RE2, Prometheus' dialect ({error})",
            "correct it (RE2 has no lookaround and no backreferences), "
            "or write plain text without regex:",
        ) from None


def _plain_or_expression(value: Any, plain: Any) -> Pattern:
    if isinstance(value, dict):
        if set(value) != {"regex"}:
            raise WrongValueError(
                f"{quoted(value)} is not a pattern", 'write text or {regex: "..."}'
            )
        return expression(value["regex"])
    found = text(value)
    if not found.strip():
        raise WrongValueError(
            "is empty text, which would match everything", "remove it or fill it in"
        )
    if len(found) > MAX_PATTERN:
        raise WrongValueError(f"the text has {len(found)} characters", f"use at most {MAX_PATTERN}")
    made: Pattern = plain(found)
    return made


def word(value: Any) -> Pattern:
    """A word, found anywhere, case ignored; or {regex: ...}, searched as it is."""
    return _plain_or_expression(value, lambda word: Pattern(escape(word), ignore_case=True))


def wildcard(value: Any) -> Pattern:
    """A whole text in which `*` stands for anything; or {regex: ...}; both for fullmatch.

    A whole number becomes text, as in the value of a label.
    """
    if isinstance(value, int) and not isinstance(value, bool):
        value = str(value)
    return _plain_or_expression(value, _from_wildcard)


def _from_wildcard(source: str, *, ignore_case: bool = False) -> Pattern:
    parts = map(escape, source.split("*"))
    return Pattern(".*".join(parts), ignore_case=ignore_case, dot_all=True)


def equal(value: Any) -> Pattern:
    """A whole text, case ignored, in which `*` stands for anything; or {regex: ...}.

    A whole number, true and false become text, as drivers publish them.
    """
    if isinstance(value, bool | int):
        value = str(value)
    return _plain_or_expression(value, lambda text: _from_wildcard(text, ignore_case=True))


def written(patterns: Iterable[Pattern]) -> str:
    """Patterns as in fleet.yml: without escapes, * for anything."""
    texts = (re.sub(r"\\(\W)", r"\1", each.pattern.replace(".*", "*")) for each in patterns)
    return " or ".join(texts)


def topic_template(value: Any) -> str:
    """A topic in which one part may contain `{robot}`, and `*` is a part of any name."""
    remedy = "write a topic as /{robot}/diagnostics_agg, with * for a part of any name"
    found = matching(value, _TOPIC, "is not a pattern for topics", remedy, MAX_TOPIC)
    if found.count(ROBOT) > 1:
        raise WrongValueError(
            f"{quoted(found)} has {ROBOT} twice", "keep one and write * for the other"
        )
    return found


def key_template(value: Any) -> str:
    """The beginning of zenoh keys with `{robot}` or `*`, as topics begin; see `key_prefix`."""
    remedy = "write it as customer_a/{robot}, or / where the keys begin with the topic"
    found = matching(value, _KEY, "is not the beginning of zenoh keys", remedy, MAX_TOPIC)
    return "" if found == "/" else f"/{found}"


def topic_pattern(template: str, prefix: str = "") -> re.Pattern[str]:
    """The pattern (fullmatch on topics) of a valid template; group "robot" if it has {robot}.

    ``prefix`` is of zenoh's keys; with no template every topic after it matches.
    """
    topic = _template_pattern(template, "[A-Za-z0-9_]+") if template else INNERMOST.pattern
    return re.compile(_template_pattern(prefix, "[A-Za-z0-9_.:-]+") + topic)


def _template_pattern(template: str, part: str) -> str:
    source = re.escape(template).replace(re.escape(ROBOT), f"(?P<robot>{part})")
    return source.replace(r"\*", part)


def name_template(value: Any) -> str:
    """A name or a host made of `{robot}` and `{domain_id}`."""
    remedy = "use letters, digits, - _ . : and {robot}, {domain_id}"
    return matching(value, _NAME, "is not a template for names", remedy, MAX_NAME)


def split(value: Any) -> Pattern:
    """How a status names its robot: a template, or {regex: ...} with a group "robot"."""
    if isinstance(value, dict) and set(value) == {"regex"}:
        made = expression(value["regex"])
        groups = made.groups
        twice = any(made.pattern.count(f"<{group}>") > 1 for group in groups)
        if twice or "robot" not in groups or groups - {"robot", "component"}:
            what = f"{quoted(made.pattern)} does not have the named groups robot and component"
            raise WrongValueError(
                what, "name the robot's part (?P<robot>...), the rest (?P<component>...), each once"
            )
        return made
    found = text(value)
    source = escape(found[: MAX_PATTERN + 1])
    for group, inner in (("robot", ".+?"), ("component", ".+")):
        source = source.replace(rf"\{{{group}\}}", f"(?P<{group}>{inner})", 1)
    if len(found) > MAX_PATTERN or "(?P<robot>" not in source or r"\{" in source:
        remedy = "write it with {robot} and {component}, each once, as {robot}/{component}"
        raise WrongValueError(f"{quoted(found)} does not show where the robot's name is", remedy)
    return Pattern(source, dot_all=True)


_REGEX: dict[str, Any] = {
    "type": "object",
    "properties": {"regex": {"type": "string", "maxLength": MAX_PATTERN}},
    "required": ["regex"],
    "additionalProperties": False,
}
_WORD = [{"type": "string", "minLength": 1, "maxLength": MAX_PATTERN}, _REGEX]
_TEXT = [*_WORD, {"type": "integer"}]
_PUBLISHED = [*_TEXT, {"type": "boolean"}]


def _one_or_more(one: Any, title: str, schemas: list[dict[str, Any]]) -> Value:
    """One pattern or a list of them, each made by ``one``."""

    def made(value: Any) -> tuple[Pattern, ...]:
        items = value if isinstance(value, list) else [value]
        if not items:
            raise WrongValueError("is an empty list", "remove it or fill it in")
        return tuple(one(item) for item in items)

    listed = {"type": "array", "minItems": 1, "items": {"anyOf": schemas}}
    return Value(made, title, anyOf=[*schemas, listed])


Words = Annotated[tuple[Pattern, ...], _one_or_more(word, "words", _WORD)]
Wildcards = Annotated[tuple[Pattern, ...], _one_or_more(wildcard, "texts with *", _TEXT)]
Equals = Annotated[tuple[Pattern, ...], _one_or_more(equal, "published texts", _PUBLISHED)]
TopicTemplate = Annotated[
    str, Value(topic_template, "topic with {robot}", type="string", pattern=f"^{_TOPIC}$")
]
KeyTemplate = Annotated[
    str,
    Value(key_template, "beginning of keys with {robot}", type="string", pattern=f"^(?:{_KEY})$"),
]
NameTemplate = Annotated[
    str, Value(name_template, "text with {robot}", type="string", pattern=f"^{_NAME}$")
]
Split = Annotated[
    Pattern,
    Value(
        split,
        "text with {robot} and {component}",
        anyOf=[{"type": "string", "pattern": r"\{robot\}", "maxLength": MAX_PATTERN}, _REGEX],
    ),
]
