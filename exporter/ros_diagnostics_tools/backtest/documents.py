"""A text -> the values in it, JSON or YAML, each with its line; what is damaged keeps its place."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from textwrap import dedent
from typing import Any, NamedTuple

import yaml

from ros_diagnostics_tools.backtest.formats import shortened

LONGEST = 16 * 2**20  # characters of one document in YAML
_Loader = getattr(yaml, "CBaseLoader", yaml.BaseLoader)  # every scalar stays a text
_BETWEEN = re.compile(r"(?:\s|---)*")
_NEXT = re.compile(r"\n(?=[\[{]|---)")  # where JSON goes on behind what is damaged
# `ros2 topic echo` prints a notice without a line break before what separates messages.
_LOST = r"(?:A message was lost!!!\n\ttotal count change:.*\n\ttotal count: \d+)?"
_SEPARATOR = re.compile(rf"^{_LOST}---[^\S\n]*$\n?", re.MULTILINE)


class Document(NamedTuple):
    """One value of a file; ``damage`` says why there is none."""

    line: int
    value: Any
    damage: str = ""


def documents(text: str) -> Iterator[Document]:
    """The values of a file, one or many, with ``---`` or nothing between them."""
    if text[:1] in {" ", "\t"}:  # a block of code in Markdown
        text = dedent(text)
    start = _BETWEEN.match(text)
    at = start.end() if start is not None else 0
    return _json(text) if text[at : at + 1] in {"{", "["} else _yaml(text)


def _json(text: str) -> Iterator[Document]:
    decoder, line, counted = json.JSONDecoder(), 1, 0
    at = _after_separators(text, 0)
    while at < len(text):
        line, counted = line + text.count("\n", counted, at), at
        try:
            value, end = decoder.raw_decode(text, at)
        except (ValueError, RecursionError) as error:
            yield Document(line, None, f"is not JSON: {_reason(error)}")
            found = _NEXT.search(text, at)
            end = len(text) if found is None else found.end()
        else:
            yield Document(line, value)
        at = _after_separators(text, end)


def _after_separators(text: str, at: int) -> int:
    found = _BETWEEN.match(text, at)
    return at if found is None else found.end()


def _reason(error: Exception) -> str:
    return error.msg if isinstance(error, json.JSONDecodeError) else shortened(error)


def _yaml(text: str) -> Iterator[Document]:
    line = at = 0
    for found in (*_SEPARATOR.finditer(text), None):
        part = text[at : len(text) if found is None else found.start()]
        if part.strip():
            yield _parsed(part, line)
        if found is not None:
            line += text.count("\n", at, found.end())
            at = found.end()


def _parsed(part: str, before: int) -> Document:
    """One document, which begins after so many lines."""
    line = before + 1 + len(part[: -len(part.lstrip())].splitlines())
    if len(part) > LONGEST:
        return Document(line, None, f"has more than {LONGEST:,} characters")
    try:
        if "*" in part and any(isinstance(e, yaml.AliasEvent) for e in yaml.parse(part, _Loader)):
            return Document(line, None, "has an alias of YAML, which no message has")
        return Document(line, yaml.load(part, _Loader))  # noqa: S506 - makes texts only
    except yaml.MarkedYAMLError as error:
        mark = 0 if error.problem_mark is None else error.problem_mark.line
        return Document(before + 1 + mark, None, f"is not YAML: {error.problem}")
    except (yaml.YAMLError, RecursionError) as error:
        return Document(line, None, f"is not YAML: {shortened(error)}")
