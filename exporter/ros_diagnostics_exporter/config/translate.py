"""pydantic's errors in the project's words: where, what is wrong, what would be right."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable
from typing import Annotated, Any, NamedTuple, get_args, get_origin

from pydantic import BaseModel
from pydantic_core import ErrorDetails

from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.scalars import shown

Where = tuple[str | int, ...]

_QUOTES = "put it in quotes"
_PLAIN = "write digits without quotes"
_PAIRS = "write it as key: value"
_KINDS = {
    "string_type": ("text", _QUOTES),
    "int_type": ("a whole number", _PLAIN),
    "float_type": ("a number", _PLAIN),
    "finite_number": ("a finite number", _PLAIN),
    "bool_type": ("true or false", "write true or false"),
    "list_type": ("a list", "begin each entry with a dash"),
    "dict_type": ("a mapping", _PAIRS),
    "model_type": ("a mapping", _PAIRS),
}
_BOUNDS = {"ge": "at least", "gt": "more than", "le": "at most", "lt": "less than"}


class Told(NamedTuple):
    """An error in words; ``where`` is below the value that was validated."""

    where: Where
    what: str
    remedy: str


def told(error: ErrorDetails, model: type[BaseModel]) -> Told:
    """One error of validating against `model`."""
    where = tuple(part for part in error["loc"] if part != "[key]")
    wrong = error.get("ctx", {}).get("error")
    if isinstance(wrong, WrongValueError):
        return Told(where, wrong.what, wrong.remedy)
    if error["type"] == "missing":
        return Told(where, "is missing", f"add {where[-1]}: ...")
    if error["type"] == "extra_forbidden":
        return Told(where, "is not a key", meant(str(where[-1]), _keys(model, where[:-1])))
    return Told(where, *_about_value(error))


def _about_value(error: ErrorDetails) -> tuple[str, str]:
    kind, value, context = error["type"], shown(error["input"]), error.get("ctx", {})
    if kind == "literal_error":
        allowed = re.findall(r"'([^']+)'", context["expected"])
        return f"{value} is not one of the words", _one_of(allowed)
    if kind in _KINDS:
        noun, remedy = _KINDS[kind]
        return f"{value} is not {noun}", remedy
    for bound, words in _BOUNDS.items():
        if bound in context:
            return f"{value} is out of range", f"use {words} {context[bound]}"
    return f"{value} is not valid", error["msg"][:1].lower() + error["msg"][1:]


def meant(word: str, known: Iterable[str]) -> str:
    """The remedy for a word that is not known: the one that it resembles, or all."""
    words, word = list(known), word[:100]  # comparing takes the square of the length
    close = difflib.get_close_matches(word.lower(), {each.lower(): each for each in words}, n=1)
    if close:
        best = next(each for each in words if each.lower() == close[0])
        return f"did you mean {best}?"
    return _one_of(words) if words else "remove it"


def _one_of(words: list[str]) -> str:
    return f"use {words[0]}" if len(words) == 1 else f"use one of {', '.join(words)}"


def _keys(model: Any, where: Where) -> list[str]:
    """The keys that the model at `where` below `model` knows."""
    for part in where:
        model = _model(model)
        if isinstance(model, type) and issubclass(model, BaseModel):
            field = model.model_fields.get(str(part))
            model = field.annotation if field else None
        else:  # list[item], dict[key, value]
            model = get_args(model)[-1] if get_args(model) else None
    model = _model(model)
    is_model = isinstance(model, type) and issubclass(model, BaseModel)
    return list(model.model_fields) if is_model else []


def _model(annotation: Any) -> Any:
    """An annotation without `Annotated[...]` and `| None`."""
    while True:
        if get_origin(annotation) is Annotated:
            annotation = get_args(annotation)[0]
        elif type(None) in get_args(annotation):
            annotation = next(arg for arg in get_args(annotation) if arg is not type(None))
        else:
            return annotation
