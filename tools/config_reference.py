"""docs/reference/configuration.md: every key of fleet.yml, from the models."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from config_schema import schema
from ros_diagnostics_exporter.config.fleet import Fleet

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "configuration.md"
_HEAD = """# Keys of fleet.yml

Every key of [fleet.yml](../configuration.md), by its part of the file. What a duration, a name or
words are: [kinds of values](../configuration.md#kinds-of-values). `./run generate` writes this
page.
"""
SHORT = 12  # words of a meaning that is said again
_TYPES = {"boolean": "`true` or `false`", "integer": "whole number", "number": "number"}


def files() -> dict[Path, str]:
    """The page."""
    whole = schema(Fleet)
    said: dict[tuple[str, str], str] = {}
    parts = [_section(part, said) for part in (whole, *whole["definitions"].values())]
    return {PAGE: "\n".join([_HEAD, *parts])}


def _section(part: dict[str, Any], said: dict[tuple[str, str], str]) -> str:
    links = re.sub(r"\]\((?=\w)(?!https?:)", "](../", _table(part, said))  # are of docs/
    return f"## {part['title']}\n\n{part['description']}\n\n{links}"


def _table(part: dict[str, Any], said: dict[tuple[str, str], str]) -> str:
    """A row for each key; ``said`` is which part before has one of this name and meaning."""
    rows = ["| key | value | default | meaning |", "|---|---|---|---|"]
    for key, described in part["properties"].items():
        default = _yaml(described["default"]) if "default" in described else ""
        if key in part.get("required", ()):
            default = "*required*"
        example = " ".join(_yaml(each) for each in described["examples"])
        meaning, title = described["description"], part["title"]
        first = said.setdefault((key, meaning), title)
        if first != title and len(meaning.split()) > SHORT:
            meaning = f"As of [{first}](#{first.lower()})."
        meaning = f"{meaning} Example: {example}"
        cells = (f"`{key}`", _type(described), default, meaning)
        rows.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"


def _type(described: dict[str, Any]) -> str:
    """What kind of value a key takes, in words."""
    if "$ref" in described:
        name = schema(Fleet)["definitions"][described["$ref"].rpartition("/")[2]]["title"]
        return f"[{name}](#{name.lower()})"
    if "enum" in described:
        return ", ".join(f"`{word}`" for word in described["enum"] if word is not None)
    if "title" in described:
        return str(described["title"])
    if "anyOf" in described:
        return " or ".join(_type(each) for each in described["anyOf"] if each.get("type") != "null")
    return _type_by_form(described)


def _type_by_form(described: dict[str, Any]) -> str:
    kind = next(each for each in _listed(described["type"]) if each != "null")
    if kind == "array":
        return f"list: {_type(described['items'])}"
    if kind == "object":
        key, value = described["propertyNames"], described["additionalProperties"]
        return f"mapping: {_type(key)} → {_type(value)}"
    return _TYPES.get(kind, "text") + _range(described)


def _range(described: dict[str, Any]) -> str:
    if "minimum" not in described:
        return ""
    return f", {described['minimum']} to {described['maximum']}"


def _listed(types: str | list[str]) -> list[str]:
    return [types] if isinstance(types, str) else types


def _yaml(value: Any) -> str:
    """A value as one would write it into the file, on one line."""
    return f"`{_flow(value)}`"


def _flow(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(inner)}" for key, inner in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(_flow, value)) + "]"
    if isinstance(value, str) and re.fullmatch(r"[\w./-][\w. :/()%-]*", value):
        return value
    return json.dumps(value, ensure_ascii=False)
