"""The tables of docs/configuration.md, from the models.

`python -m ros_diagnostics_exporter.config.reference docs/configuration.md` renews what stands
between `<!-- keys of Robot -->` and `<!-- end -->`; the prose around it is written by hand.
"""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

from ros_diagnostics_exporter.config.model import FleetFile
from ros_diagnostics_exporter.config.schema import schema

_BLOCK = re.compile(r"(<!-- keys of (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
_TYPES = {"boolean": "`true` or `false`", "integer": "whole number", "number": "number"}


def renewed(document: str) -> str:
    """The document with every table as the models have it.

    Raises:
        ValueError: a part of fleet.yml has no table, or a table no part.
    """
    tables = _tables()
    named = [match[2] for match in _BLOCK.finditer(document)]
    if sorted(named) != sorted(tables):
        raise ValueError(f"the document has tables for {sorted(named)}, not for {sorted(tables)}")
    return _BLOCK.sub(lambda match: match[1] + tables[match[2]] + match[3], document)


def _tables() -> dict[str, str]:
    whole = schema(FleetFile)
    parts = [whole, *whole["definitions"].values()]
    return {part["title"]: _table(part) for part in parts}


def _table(part: dict[str, Any]) -> str:
    rows = ["| key | value | default | meaning |", "|---|---|---|---|"]
    for key, told in part["properties"].items():
        default = _yaml(told["default"]) if "default" in told else ""
        if key in part.get("required", ()):
            default = "*required*"
        example = " ".join(_yaml(each) for each in told["examples"])
        meaning = f"{told['description']} Example: {example}"
        cells = (f"`{key}`", _type(told), default, meaning)
        rows.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"


def _type(told: dict[str, Any]) -> str:
    """What kind of value a key takes, in words."""
    if "$ref" in told:
        name = told["$ref"].rpartition("/")[2].removesuffix("Entry")
        return f"[{name}](#{name.lower()})"
    if "enum" in told:
        return ", ".join(f"`{word}`" for word in told["enum"] if word is not None)
    if "title" in told:
        return str(told["title"])
    if "anyOf" in told:
        return " or ".join(_type(each) for each in told["anyOf"] if each.get("type") != "null")
    return _type_by_form(told)


def _type_by_form(told: dict[str, Any]) -> str:
    kind = next(each for each in _listed(told["type"]) if each != "null")
    if kind == "array":
        return f"list: {_type(told['items'])}"
    if kind == "object":
        return f"mapping: {_type(told['propertyNames'])} → {_type(told['additionalProperties'])}"
    return _TYPES.get(kind, "text") + _range(told)


def _range(told: dict[str, Any]) -> str:
    if "minimum" not in told:
        return ""
    return f", {told['minimum']} to {told['maximum']}"


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


def main(arguments: list[str]) -> None:
    """Renew the tables of the documents that are named."""
    for name in arguments:
        path = Path(name)
        path.write_text(renewed(path.read_text(encoding="utf-8")), encoding="utf-8")


if __name__ == "__main__":
    main(sys.argv[1:])
