"""The models of fleet.yml as JSON Schema, for editors.

The schema is looser than the loader: it describes the shape of a file, not the relations between
entries. It is of draft 7, which yaml-language-server reads, and shipped in the package's config/.
"""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter
from pydantic.json_schema import DEFAULT_REF_TEMPLATE, GenerateJsonSchema, JsonSchemaValue
from pydantic_core import core_schema

from ros_diagnostics_exporter import config
from ros_diagnostics_exporter.config.fleet import Fleet, Maintenance, Query, Robot
from ros_diagnostics_exporter.durations import written

# file name -> what it describes: fleet.yml, and the files of the folders
SCHEMAS: dict[str, Any] = {
    "fleet.schema.json": Fleet,
    "robots.schema.json": Robot | list[Robot],
    "maintenance.schema.json": Maintenance | list[Maintenance],
    "queries.schema.json": Query | list[Query],
}


class _Draft7(GenerateJsonSchema):
    """pydantic's schema without noise: no titles made of keys, no `default: null`."""

    schema_dialect = "http://json-schema.org/draft-07/schema#"

    def sort(self, value: JsonSchemaValue, parent_key: str | None = None) -> JsonSchemaValue:  # noqa: ARG002
        return value  # the models' order is the one to read

    def field_title_should_be_set(self, schema: Any) -> bool:  # noqa: ARG002 - pydantic's
        return False

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        """A key that has a default may be there without a value, as if it were not."""
        found = self.generate_inner(schema["schema"])
        default = schema.get("default")
        if found.get("title") == "duration" and isinstance(default, float):
            default = written(default)
        elif isinstance(default, float) and default.is_integer():
            default = int(default)
        found = _or_null(found)
        if isinstance(default, str | int | float) and default != "":
            return {**found, "default": default}
        return found

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return _or_null(self.generate_inner(schema["schema"]))

    def dict_schema(self, schema: core_schema.DictSchema) -> JsonSchemaValue:
        names = self.generate_inner(schema["keys_schema"])
        values = self.generate_inner(schema["values_schema"])
        return {"type": "object", "propertyNames": names, "additionalProperties": values}


def _or_null(inner: JsonSchemaValue) -> JsonSchemaValue:
    if "const" in inner:
        inner = {"enum": [inner.pop("const")], **inner}
    if "enum" in inner and None not in inner["enum"]:
        inner = {**inner, "enum": [*inner["enum"], None]}
    if isinstance(inner.get("type"), str):
        return {**inner, "type": [inner["type"], "null"]}
    null = {"type": "null"}
    if null in inner.get("anyOf", []) or "null" in inner.get("type", []):
        return inner
    if "anyOf" in inner:
        return {**inner, "anyOf": [*inner["anyOf"], null]}
    return {"anyOf": [inner, null]}


@cache
def schema(model: Any) -> dict[str, Any]:
    """The JSON Schema of a model, with its parts under `definitions`."""
    made = TypeAdapter(model).json_schema(
        schema_generator=_Draft7, ref_template=DEFAULT_REF_TEMPLATE, mode="validation"
    )
    text = json.dumps({"$schema": _Draft7.schema_dialect, **made}, ensure_ascii=False)
    renamed: dict[str, Any] = json.loads(text.replace("$defs", "definitions"))
    return renamed


def rendered(model: Any) -> str:
    """The content of a schema file."""
    return json.dumps(schema(model), ensure_ascii=False, indent=2) + "\n"


def files() -> dict[Path, str]:
    """The shipped schemas."""
    folder = Path(config.__file__).parent
    return {folder / name: rendered(model) for name, model in SCHEMAS.items()}
