"""Mappings of a YAML file as frozen dataclasses, in which each key is described once.

A field that is `described` is a key of the file; any other is made of those. The description is the
documentation: docs/reference/configuration.md and the JSON Schema are generated from it.
`validated` checks what a file has; the constructors of the classes, which programs and tests use,
check nothing.
"""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass
from functools import cache, partial
from types import MappingProxyType
from typing import Annotated, Any, ClassVar, TypeVar, get_args, get_origin

from pydantic import BaseModel, ConfigDict, Field, GetCoreSchemaHandler, PlainValidator, TypeAdapter
from pydantic.json_schema import SkipJsonSchema
from pydantic_core import CoreSchema, PydanticCustomError, core_schema
from typing_extensions import dataclass_transform

T = TypeVar("T")
Where = tuple[str | int, ...]


def described(
    text: str,
    *,
    example: Any,
    default: Any = MISSING,
    default_factory: Any = MISSING,
    key: str | None = None,
    written: Any = MISSING,
) -> Any:
    """A key of the file: what it means, an example, its default (without one it is required).

    ``key`` is its name in the file, where that is not the attribute's. ``written`` is the default
    as it is written there, where the attribute's has another form; None is not documented.
    """
    info = Field(
        description=text,
        examples=[example],
        alias=key,
        json_schema_extra=None if written is MISSING else partial(_set_default, written),
    )
    metadata = {"info": info, "key": key, "written": written}
    made: Any = dataclasses.field
    return made(default=default, default_factory=default_factory, metadata=metadata)


def _set_default(written: Any, schema: dict[str, Any]) -> None:
    schema.pop("default", None)
    if written is not None:
        schema["default"] = written


@dataclass(frozen=True)
class Written:
    """What a key is in the file, ``kind``, and what makes its attribute of that, if it is another.

    ``made`` takes the context of the validation, too, if ``in_context``.
    """

    kind: Any
    made: Callable[..., Any] | None = None
    in_context: bool = False

    def __get_pydantic_core_schema__(
        self, _source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        inner, made = handler.generate_schema(self.kind), self.made
        if made is None:
            return inner
        if self.in_context:
            return core_schema.with_info_after_validator_function(
                lambda value, info: made(value, info.context), inner
            )
        return core_schema.no_info_after_validator_function(made, inner)


class Value:
    """A single value of the file: what makes the attribute of it, or raises, and its JSON Schema.

    ``title`` is what the documentation calls it.
    """

    def __init__(self, made: Callable[[Any], Any], title: str, **schema: Any) -> None:
        self._made = made
        self._schema = {"title": title, **schema}

    def __get_pydantic_core_schema__(self, _source: Any, _handler: Any) -> CoreSchema:
        return core_schema.no_info_plain_validator_function(self._made)

    def __get_pydantic_json_schema__(self, _schema: Any, _handler: Any) -> dict[str, Any]:
        return dict(self._schema)


def _no_key(_value: Any) -> Any:
    raise PydanticCustomError("extra_forbidden", "is made of other keys")


_NO_KEY: Any = Annotated[Any, PlainValidator(_no_key), SkipJsonSchema()]  # type: ignore[type-arg]


@dataclass_transform(frozen_default=True, field_specifiers=(described, dataclasses.field))
class Entry:
    """A mapping: unknown keys are errors, types are not converted, null is as if not given.

    Each subclass is a frozen dataclass; ``title`` is its name in the documentation.
    """

    keys: ClassVar[Mapping[str, str]]  # in the file -> attribute
    _required: ClassVar[frozenset[str]]
    _written: ClassVar[Mapping[str, Any]]  # defaults that are written otherwise

    def __init_subclass__(cls, title: str = "") -> None:
        cls.__pydantic_config__ = ConfigDict(  # type: ignore[attr-defined]
            extra="forbid", strict=True, allow_inf_nan=False, title=title or cls.__name__
        )
        for name, kind in inspect.get_annotations(cls).items():
            if isinstance(kind, str):  # `keys_at` would find no keys in it
                raise TypeError(f"{cls.__name__}.{name} has a type as text")
            of_key = getattr(cls.__dict__.get(name), "metadata", {}).get("info")
            cls.__annotations__[name] = Annotated[kind, of_key] if of_key else _NO_KEY
        found = {}
        for each in dataclasses.fields(dataclass(frozen=True)(cls)):  # type: ignore[arg-type]
            if each.metadata:
                found[each.metadata["key"] or each.name] = each
        cls.keys = {name: each.name for name, each in found.items()}
        cls._required = frozenset(
            name
            for name, each in found.items()
            if each.default is MISSING and each.default_factory is MISSING
        )
        written = {name: each.metadata["written"] for name, each in found.items()}
        cls._written = {name: each for name, each in written.items() if each not in (MISSING, None)}

    def completed(self, given: Mapping[str, Any]) -> Any:  # noqa: ARG002 - of those that override
        """The entry with what is made of several keys; ``given`` has those of the file.

        Raises:
            WrongValueError: The keys do not fit one another.
        """
        return self

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        schema: Any = {**handler.resolve_ref_schema(handler(source)), "strict": False}
        # What refers to the class, in place of repeating it, has to mean the whole.
        ref = schema.pop("ref", None)
        return core_schema.no_info_wrap_validator_function(cls._read, schema, ref=ref)

    @classmethod
    def _read(cls, data: Any, handler: Callable[[Any], Any]) -> Any:
        if not isinstance(data, dict):
            return handler(data)
        given = {k: each for k, each in data.items() if each is not None or k in cls._required}
        return handler({**cls._written, **given}).completed(given)


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    return TypeAdapter(kind)


def validated(kind: type[T], data: Any, context: Any = None) -> T:
    """Data of a file as a ``kind``.

    Raises:
        ValidationError: With everything that is wrong.
    """
    adapter = _adapter(kind)  # type: ignore[arg-type]  # a class is hashable
    made: T = adapter.validate_python(data, context=context)
    return made


def keys_at(kind: Any, where: Where) -> list[str]:
    """The keys that a mapping at ``where`` inside of a ``kind`` may have."""
    for part in where:
        kind = _plain(kind)
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            found = kind.model_fields.get(str(part))
            kind = found.annotation if found else None
        elif isinstance(kind, type) and issubclass(kind, Entry):
            attribute = kind.keys.get(str(part), "")
            kind = inspect.get_annotations(kind).get(attribute)
        else:  # list[item], dict[key, value]
            kind = get_args(kind)[-1] if get_args(kind) else None
    kind = _plain(kind)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return list(kind.model_fields)
    return list(kind.keys) if isinstance(kind, type) and issubclass(kind, Entry) else []


def _plain(kind: Any) -> Any:
    """A type as in the file, without `Annotated[...]` and `| None`."""
    while True:
        if get_origin(kind) is Annotated:
            written = [each.kind for each in kind.__metadata__ if isinstance(each, Written)]
            kind = written[-1] if written else kind.__origin__
        elif type(None) in get_args(kind):
            kind = next(each for each in get_args(kind) if each is not type(None))
        else:
            return kind


def nothing() -> Mapping[Any, Any]:
    """The default of a mapping."""
    return MappingProxyType({})
