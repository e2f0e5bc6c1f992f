"""A message of a small topic -> the status that fleet.yml makes of some of its fields. Pure."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from ros_diagnostics_exporter.config.topics import OTHER, TopicEntry
from ros_diagnostics_exporter.model import Level, Status

MOST = 100  # elements of an array that are read
SEVERITY = (Level.OK, Level.WARN, Level.STALE, Level.ERROR)
_STEP = re.compile(r"(\w+)(?:\[([\w*]+)\])?")

Constants = Mapping[str, Mapping[str, str]]  # by short name of a type: name -> text


class NoFieldError(Exception):
    """A message has no such field; the text says which it has."""


class FieldValue(NamedTuple):
    """A field, or an element of one that is an array.

    ``label`` tells the elements apart. ``text`` is what people read, "" where the robot does not
    know the number; ``words`` are all ways to write it, case folded.
    """

    label: str
    text: str
    words: frozenset[str]


def status_of(entry: TopicEntry, message: Any, constants: Constants) -> Status:
    """The status of the component that an entry makes of a message.

    Raises:
        NoFieldError: the message has no such field.
    """
    pairs, missing = [], []
    level, text = int(Level.OK), ""
    for path, key in entry.paths.items():
        values = list(read(message, path, constants))
        if path == entry.field and (entry.levels or entry.error_when):
            level, text = _judge(entry, key, values)
        for each in values:
            name = _key(key, each.label)
            pairs += [(name, each.text)] if each.text else []
            missing += [] if each.text else [name]
    lacks = f"no value: {', '.join(missing)}" if missing else ""
    words = "; ".join(filter(None, (text, lacks))) or "OK"
    return Status(level, entry.component, words, "", tuple(pairs))


def _judge(entry: TopicEntry, key: str, values: Sequence[FieldValue]) -> tuple[int, str]:
    """The worst level of the values, and which it is."""
    judged = [(_level(entry, each), each) for each in values]
    if not judged:
        return int(Level.OK), f"no {key}"
    level, worst = max(judged, key=lambda each: SEVERITY.index(each[0]))
    return int(level), f"{_key(key, worst.label)} is {worst.text or 'NaN'}"


def _key(key: str, label: str) -> str:
    """The key of an element: "Effort (Nm)" of the elbow is "Effort elbow (Nm)"."""
    name, blank, unit = key.rpartition(" (")
    return f"{name} {label}{blank}{unit}" if label and blank else f"{key} {label}".strip()


def _level(entry: TopicEntry, value: FieldValue) -> Level:
    if entry.error_when:
        is_error = any(one.fullmatch(word) for one in entry.error_when for word in value.words)
        return Level.ERROR if is_error else Level.OK
    levels = entry.levels
    found = next((levels[word] for word in value.words if word in levels), None)
    return Level(levels.get(OTHER, int(Level.ERROR)) if found is None else found)


# -- paths -----------------------------------------------------------------------------------


def read(message: Any, path: str, constants: Constants) -> Iterator[FieldValue]:
    """The values at a path.

    Raises:
        NoFieldError: there is no such field.
    """
    for label, owner, name, value in _walk(message, _steps(path), ""):
        yield _value(label, owner, name, value, constants)


@lru_cache(maxsize=1000)
def _steps(path: str) -> tuple[tuple[str, str], ...]:
    return tuple((name, index) for name, index in _STEP.findall(path))


def _walk(
    message: Any, steps: Sequence[tuple[str, str]], label: str
) -> Iterator[tuple[str, Any, str, Any]]:
    """(label, the message that has it, name, value) of each field at the end of a path.

    The value is None where an array is too short.
    """
    (name, index), *rest = steps
    for more, value in _elements(message, name, index):
        both = f"{label} {more}".strip()
        if rest and value is not None:
            yield from _walk(value, rest, both)
        else:
            yield both, message, name, value


def _elements(message: Any, name: str, index: str) -> Iterator[tuple[str, Any]]:
    """The field itself; or the elements of an array that are meant, each with its label."""
    value = _field(message, name)
    if not index:
        yield "", value
    elif not _is_array(value):
        raise NoFieldError(f"{name} is no array: remove [{index}]")
    elif index.isdecimal():
        yield "", value[int(index)] if int(index) < len(value) else None
    else:
        labels = _labels(message, value, index)
        yield from list(zip(labels, value, strict=False))[:MOST]


def _labels(message: Any, value: Sequence[Any], index: str) -> Sequence[str]:
    if index == "*":
        return [str(number) for number in range(len(value))]
    if not value or _fields(value[0]):
        return [str(_field(each, index)) for each in value]
    beside = _field(message, index)
    return [str(each) for each in beside] if _is_array(beside) else []


def _field(message: Any, name: str) -> Any:
    fields = _fields(message)
    if name not in fields:
        known = f"it has {', '.join(fields)}" if fields else "it is no message"
        raise NoFieldError(f"{_type(message)} has no field {name}: {known}")
    return getattr(message, name)


def _fields(message: Any) -> Sequence[str]:
    fields: Sequence[str] = getattr(type(message), "__slots__", ())
    return fields if hasattr(type(message), "_type") else ()


def _type(message: Any) -> str:
    """The short name of a message's type, or that of a number or text in Python."""
    return str(getattr(type(message), "_type", type(message).__name__))


def _is_array(value: Any) -> bool:
    return hasattr(value, "__len__") and not isinstance(value, str)


# -- values ----------------------------------------------------------------------------------


def _value(label: str, owner: Any, name: str, value: Any, constants: Constants) -> FieldValue:
    if _fields(value):
        first = _fields(value)[0]
        raise NoFieldError(f"{name} is a message: name a field of it, such as {name}.{first}")
    if _is_array(value):
        raise NoFieldError(f"{name} is an array: write {name}[0], or {name}[*] for all")
    if isinstance(value, bool):
        text = str(value).lower()
        return FieldValue(label, text, frozenset({text, str(int(value))}))
    if value is None or isinstance(value, float):
        text = "" if value is None or not math.isfinite(value) else f"{value:.7g}"
        return FieldValue(label, text, frozenset({text or "nan"}))
    text = str(value)
    names = _named(name, text, constants.get(_type(owner), {}))
    words = frozenset(each.casefold() for each in (text, *names))
    return FieldValue(label, names[-1] if names else text, words)


def _named(field: str, text: str, constants: Mapping[str, str]) -> tuple[str, ...]:
    """The names of the constant that a field has: in full, and without what they begin with.

    A message may have constants of several fields (BatteryState has three 1s). Those are meant that
    begin with the field's name, with its first words (HEALTH_OK of health_status) or its last
    (MODE_AUTO of operational_mode), or all where no two are the same.
    """
    prefix, own = _constants_of(field, tuple(constants.items()))
    found = next((name for name, number in own.items() if number == text), None)
    if found is None:
        return ()
    short = found.removeprefix(prefix)
    return (found,) if short == found else (found, short)


@lru_cache(maxsize=1000)
def _constants_of(
    field: str, constants: tuple[tuple[str, str], ...]
) -> tuple[str, Mapping[str, str]]:
    words = field.upper().split("_")
    beginnings = ["_".join(words[:count]) for count in range(len(words), 0, -1)]
    for prefix in (f"{each}_" for each in (*beginnings, words[-1])):
        if named := {name: text for name, text in constants if name.startswith(prefix)}:
            return prefix, named
    is_clear = len({text for _name, text in constants}) == len(constants)
    return "", dict(constants) if is_clear else {}
