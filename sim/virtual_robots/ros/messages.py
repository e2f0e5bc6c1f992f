"""Messages of any type: what rclpy publishes them as, and the fields of a kind file -> bytes.

A definition is one of Jazzy's common interfaces, or `msg/PACKAGE/NAME.msg` beside a kind file: the
types of drivers need not be installed.
"""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from virtual_robots.ros.borrowed import borrowed_type
from virtual_robots.schema.documents import DocumentError
from virtual_robots.schema.topics import Tree


class MessageTypes:
    """The types that are known; ``folders`` are those named `msg`."""

    def __init__(self, folders: Iterable[Path]) -> None:
        self._folders = tuple(folders)

    @cached_property
    def _store(self) -> Any:
        store = get_typestore(Stores.ROS2_JAZZY)
        for folder in self._folders:
            store.register(_definitions(folder))
        return store

    def publisher_type(self, name: str) -> Any:
        """What rclpy takes as the type of a publisher. Raises RosError if there is nothing."""
        package, _, kind = name.split("/")
        with suppress(ImportError, AttributeError):
            return getattr(importlib.import_module(f"{package}.msg"), kind)
        return borrowed_type(name)

    def encode(self, name: str, fields: Mapping[str, Tree]) -> bytes:
        """A serialized message; fields that are not named are 0, false or empty.

        Raises DocumentError for a type that is not known, fields that are not the type's, or a
        definition in a folder that cannot be read.
        """
        return bytes(self._store.serialize_cdr(self._message(name, fields), name))

    def _message(self, name: str, fields: Mapping[str, Tree]) -> Any:
        if name not in self._store.fielddefs:
            package, _, kind = name.split("/")
            raise DocumentError(
                f"nothing is known of the type {name}: put its definition into"
                f" msg/{package}/{kind}.msg beside the kind file"
            )
        kinds = dict(self._store.fielddefs[name][1])
        if not isinstance(fields, Mapping) or fields.keys() - kinds.keys():
            raise DocumentError(f"{name} has the fields {', '.join(kinds)}, not {_shown(fields)}")
        values = {each: self._value(kind, fields.get(each)) for each, kind in kinds.items()}
        return self._store.types[name](**values)

    def _value(self, kind: Any, tree: Tree | None) -> Any:
        node, argument = kind
        if node is Nodetype.BASE:
            return _plain(argument[0], tree)
        if node is Nodetype.NAME:
            return self._message(argument, tree or {})
        element, length = argument
        return self._array(element, length if node is Nodetype.ARRAY else 0, tree or ())

    def _array(self, kind: Any, length: int, trees: Any) -> Any:
        if not isinstance(trees, tuple):
            raise DocumentError(f"{trees!r} is no list, as an array needs")
        missing = (None,) * (length - len(trees))
        values = [self._value(kind, each) for each in (*trees, *missing)]
        node, argument = kind
        is_number = node is Nodetype.BASE and argument[0] not in ("string", "wstring")
        return np.array(values, dtype=_NUMPY.get(argument[0], argument[0])) if is_number else values


_NUMPY = {"byte": "uint8", "octet": "uint8", "char": "uint8"}


def _plain(kind: str, tree: Tree | None) -> str | float | int | bool:
    """The value of a plain field, of its text or number in a kind file."""
    if kind in ("string", "wstring"):
        if isinstance(tree, dict | tuple):
            raise DocumentError(f"{tree!r} is no text, as a {kind} is")
        return "" if tree is None else str(tree)
    try:
        number = float(tree or 0)
    except (TypeError, ValueError):
        raise DocumentError(f"{tree!r} is no number, as a {kind} is") from None
    if kind == "bool":
        return bool(number)
    return number if kind.startswith("float") else _whole(kind, number)


def _whole(kind: str, number: float) -> int:
    limits = np.iinfo(_NUMPY.get(kind, kind))
    if not limits.min <= number <= limits.max:
        raise DocumentError(f"{number:g} is beyond a {kind}: {limits.min} to {limits.max}")
    return round(number)


def _definitions(folder: Path) -> dict[str, Any]:
    """The types in a folder `msg`, by name."""
    found: dict[str, Any] = {}
    for path in sorted(folder.glob("*/*.msg")):
        name = f"{path.parent.name}/msg/{path.stem}"
        try:
            found |= get_types_from_msg(path.read_text("utf-8"), name)
        except (OSError, UnicodeDecodeError, TypesysError) as error:
            raise DocumentError(f"{path}: cannot be read: {error}") from error
    return found


def _shown(fields: object) -> str:
    return ", ".join(map(str, fields)) if isinstance(fields, Mapping) else repr(fields)
