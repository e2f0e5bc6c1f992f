"""YAML files -> frozen models, with errors that a person can act on.

Owns the form of the errors: one line each, `FILE: key.path: what is wrong`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

import yaml
from pydantic import BaseModel, ConfigDict, ValidationError


class DocumentError(ValueError):
    """A file that cannot be used; the text has a line for each thing that is wrong."""


class Document(BaseModel):
    """A frozen part of a file; a key that it does not know is an error."""

    model_config = ConfigDict(frozen=True, extra="forbid", populate_by_name=True)


ModelT = TypeVar("ModelT", bound=BaseModel)


def read_mapping(path: Path) -> Mapping[str, Any]:
    """The file's top-level mapping (empty for an empty file).

    Raises DocumentError where it cannot be read or is no mapping.
    """
    try:
        document = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise DocumentError(f"{path}: cannot be read: {error.strerror}") from error
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise DocumentError(f"{path}: is not YAML: {error}") from error
    if document is None:
        return {}
    if not isinstance(document, dict):
        raise DocumentError(f"{path}: must be a mapping of keys to values, is a {_kind(document)}")
    return document


def parse(model: type[ModelT], raw: Mapping[str, Any], source: str) -> ModelT:
    """The model of a mapping; raises DocumentError with every error in it."""
    try:
        return model.model_validate(raw)
    except ValidationError as error:
        lines = [f"{source}: {_line(e)}" for e in error.errors(include_url=False)]
        raise DocumentError("\n".join(lines)) from error


@contextmanager
def located(where: str) -> Iterator[None]:
    """Let a DocumentError say where it is."""
    try:
        yield
    except DocumentError as error:
        raise DocumentError(f"{where}: {error}") from error


def _line(error: Any) -> str:
    where = ".".join(str(part) for part in error["loc"])
    message = str(error["msg"]).removeprefix("Value error, ")
    if error["type"] == "missing":
        return f"{where}: is missing"
    if error["type"] == "extra_forbidden":
        return f"{where}: is no key that is known here"
    return f"{where}: {message} (is {error['input']!r})" if where else message


def _kind(value: object) -> str:
    names: dict[type, str] = {list: "list", str: "text"}
    return names.get(type(value), type(value).__name__)
