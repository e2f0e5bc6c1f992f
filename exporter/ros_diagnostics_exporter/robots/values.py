"""Key-value strings -> numbers with units.

Owns the one question "is this string a number, and in which unit?". All strings come from drivers,
so whatever could be something else than a measurement (a date, an address, a version, a serial
number, 1,234) is rejected rather than misread.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from typing import NamedTuple

from ros_diagnostics_exporter.robots.units import canonical_unit, unit_in_name

MAX_ELEMENTS = 32  # of one list; a longer one is a dump, not a measurement


class Number(NamedTuple):
    """One number out of a key-value; ``unit`` is "" where none is given.

    ``key`` is the key as published without blanks and colons at its end; an element of a list
    has its index in brackets behind it.
    """

    key: str
    unit: str
    value: float


_NUMBER = re.compile(
    r"([+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"(?: ?([^0-9 ].{0,15}))?"  # what stands behind it, perhaps a unit
)
# What most drivers write: neither a unit nor anything that could be misread.
_PLAIN = re.compile(r"-?(?:0|[1-9][0-9]{0,14})(?:\.[0-9]{1,17})?")
_SPECIAL = {
    sign + word: float(sign + word)
    for sign in ("", "+", "-")
    for word in ("inf", "infinity", "nan")
}
_BOOLEAN = {"true": 1.0, "false": 0.0, "yes": 1.0, "no": 0.0, "on": 1.0, "off": 0.0}
_HEXADECIMAL = re.compile(r"0[xX]([0-9a-fA-F]{1,16})")
_LIST = re.compile(r"[\[(](.*)[\])]")
# An identifier is no measurement, however many digits it has.
_IDENTIFIER = re.compile(
    r"(?<![a-z])(?:serial(?:[ _-]?(?:number|num|no))?|s/n|sn|uuid|guid|mac|ip|address|version"
    r"|firmware|fw|hw|revision|device[ _-]?id|hardware[ _-]?id|model)(?![a-z])",
    re.IGNORECASE,
)
# Doubles hold integers exactly up to 2**53; a longer one is a time stamp or an identifier.
_MAX_DIGITS = 15


def parse_numbers(key: str, text: str) -> tuple[Number, ...]:
    """All numbers in one key-value: none, one, or one for each element of a list.

    Args:
        key: diagnostic_msgs/KeyValue.key as published.
        text: diagnostic_msgs/KeyValue.value as published.
    """
    describe = _describe if len(key) <= _MAX_CACHED_KEY else _describe.__wrapped__
    name, key_unit, is_identifier = describe(key)
    if is_identifier:
        return ()
    text = text.strip(" \t\r\n")
    found = _scalar(text)
    if found is not None:
        number, unit = found
        return (Number(name, unit or key_unit, number),)
    brackets = _LIST.fullmatch(text)
    if brackets is None:
        return ()
    return _elements(name, key_unit, brackets[1])


def parse_plain(text: str) -> float | None:
    """The number in the text of a value, where it is nothing but a decimal number.

    None also for some that `parse_numbers` reads: this is to be fast.
    """
    return None if _PLAIN.fullmatch(text) is None else float(text)


_MAX_CACHED_KEY = 256  # characters of a key that is cached, which limits the cache


@lru_cache(maxsize=65_536)
def _describe(key: str) -> tuple[str, str, bool]:
    """(key for the label, its unit, whether it names an identifier)."""
    name = key.strip().rstrip(":").rstrip()
    return name, unit_in_name(name), _IDENTIFIER.search(name) is not None


def _elements(name: str, key_unit: str, inside: str) -> tuple[Number, ...]:
    parts = inside.split(",")
    if len(parts) > MAX_ELEMENTS:
        return ()
    found = []
    for index, part in enumerate(parts):
        scalar = _scalar(part.strip())
        if scalar is None:  # a list that is only partly numbers is not a list of numbers
            return ()
        found.append(Number(f"{name}[{index}]", scalar[1] or key_unit, scalar[0]))
    return tuple(found)


def _scalar(text: str) -> tuple[float, str] | None:
    """(number, unit in the text) of one value without blanks around it, or None."""
    match = _NUMBER.fullmatch(text)
    if match is None:
        return _word(text)
    digits, suffix = match[1], match[2]
    unit = ""
    if suffix is not None:
        unit = canonical_unit(suffix) or ""
        if not unit:
            return _word(text)  # 0x1F begins like a number, too
    return None if _is_misleading(digits) else (float(digits), unit)


def _word(text: str) -> tuple[float, str] | None:
    lowered = text.lower()
    if lowered in _SPECIAL:
        return _SPECIAL[lowered], ""
    if lowered in _BOOLEAN:
        return _BOOLEAN[lowered], ""
    hexadecimal = _HEXADECIMAL.fullmatch(text)
    if hexadecimal is not None and (value := int(hexadecimal[1], 16)) < 2**53:
        return float(value), ""
    return None


def _is_misleading(digits: str) -> bool:
    """Numbers that are rather names: too long for a double, or with leading zeros."""
    whole = digits.lstrip("+-")
    if whole.isdigit():
        return len(whole) > _MAX_DIGITS or (len(whole) > 1 and whole[0] == "0")
    if whole[:1] == "0" and whole[1:2].isdigit():
        return True
    return math.isinf(float(digits))
