"""Key-value strings -> numbers with units, as one component exports them and they are judged.

Owns the one question "is this string a number, and in which unit?". All strings come from drivers,
so whatever could be something else than a measurement (a date, an address, a version, a serial
number, 1,234) is rejected rather than misread.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

from ros_diagnostics_exporter.config.fleet import Limits, Threshold, ValueRule
from ros_diagnostics_exporter.robots.limits import SeriesLimit, truncate, unique_name
from ros_diagnostics_exporter.robots.marks import Mark, Marks
from ros_diagnostics_exporter.robots.rejections import Reject, RejectionReason
from ros_diagnostics_exporter.robots.units import canonical_unit, unit_in_name
from ros_diagnostics_exporter.texts import as_sample

MAX_ELEMENTS = 32  # of one list; a longer one is a dump, not a measurement


class Number(NamedTuple):
    """One number out of a key-value; ``unit`` is "" where none is given.

    ``key`` is the key as published without blanks and colons at its end; an element of a list
    has its index in brackets behind it.
    """

    key: str
    unit: str
    value: float


# A comma with three digits behind it may be one of thousands: 1,234.
_COMMA = r"0,[0-9]+|[0-9]+,(?:[0-9]{1,2}|[0-9]{4,})"
_NUMBER = re.compile(
    rf"([+-]?(?:(?:{_COMMA})(?![0-9,])|[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"(?: ?([^0-9 ].{0,15}))?"  # what stands behind it, perhaps a unit
)
# What most drivers write: neither a unit nor anything that could be misread, so `float` reads it.
is_plain = re.compile(r"-?(?:0|[1-9][0-9]{0,14})(?:\.[0-9]{1,17})?").fullmatch
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


def parse_numbers(key: str, text: str, *, is_judged: bool = False) -> tuple[Number, ...]:
    """All numbers in one key-value: none, one, or one for each element of a list.

    Args:
        key: diagnostic_msgs/KeyValue.key as published.
        text: diagnostic_msgs/KeyValue.value as published.
        is_judged: Whether fleet.yml has thresholds for it: then "9,5" is one number without a unit
            too, and not perhaps a list of two.
    """
    describe = _describe if len(key) <= _MAX_CACHED_KEY else _describe.__wrapped__
    name, key_unit, is_identifier = describe(key)
    if is_identifier:
        return ()
    text = text.strip(" \t\r\n")
    found = _scalar(text)
    if found is not None:
        number, unit = found[0], found[1] or key_unit
        return (Number(name, unit, number),) if unit or is_judged or "," not in text else ()
    brackets = _LIST.fullmatch(text)
    if brackets is None:
        return ()
    return _elements(name, key_unit, brackets[1])


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
    digits, suffix = match[1].replace(",", "."), match[2]
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


# -- of one component -------------------------------------------------------------------------

Pairs = Sequence[tuple[str, str]]
FindRule = Callable[[str], "ValueRule | None"]  # key -> the config's rule for it


@dataclass(slots=True)
class ExportedValue:
    """One number as it is exported; ``metric`` is the name that the config gives it, or None.

    ``text`` is that of its sample. ``rejected``: it has another unit than at first and is not
    exported. ``plain``: a text without a unit changes nothing but the number.
    """

    key: str
    unit: str
    text: str
    metric: str | None = None
    rule: ValueRule | None = None
    rejected: bool = False
    plain: bool = False

    @property
    def number(self) -> float:
        """What the text means."""
        return float(self.text)

    @property
    def series(self) -> int:
        """How many series it has, with those of its thresholds."""
        if self.rule is None or not self.rule.thresholds:
            return 1
        return (self.metric is not None) + 1 + len(self.rule.thresholds)

    @property
    def beyond(self) -> list[Threshold]:
        """Its thresholds that it is beyond."""
        number = self.number
        return [
            each
            for each in (() if self.rule is None else self.rule.thresholds)
            if (number < each.value if each.bound == "low" else number > each.value)
        ]


@dataclass(slots=True, eq=False, repr=False)
class ComponentValues:
    """The numbers in the key-values of one component.

    As long as the keys, and how many numbers each has, stay, an update only sets numbers. Numbers
    that the config judges are parsed at once, all others when they are read: a robot sends ten
    times and more before it is scraped again.

    ``limits`` has the values of a component and the characters of a key. ``find_rule`` is None
    where the config has no rule for any value of this component, ``judged`` whether it may ask at
    any moment what they are.
    """

    find_rule: FindRule | None
    limits: Limits
    series_limit: SeriesLimit
    reject: Reject
    marks: Marks[Any]
    judged: bool
    _all: list[ExportedValue] | None = None  # until they are read
    # for each key-value its numbers, None for one that a limit rejects; () where `_all_plain`
    _rows: Sequence[list[ExportedValue | None]] = ()
    _series: int = 0
    _pairs: Pairs = ()  # of the last status
    _keys: tuple[str, ...] = ()  # of those that were parsed last
    _parsed: bool = True
    _all_plain: bool = False  # each key-value has one number, and that is `plain`
    _units: dict[str, str] | None = None  # made with the first, as of most nothing is read
    _rules: dict[str, ValueRule | None] | None = None

    @property
    def all(self) -> list[ExportedValue]:
        """The numbers, in their order; those with another unit than at first among them."""
        self.parse()
        return [] if self._all is None else self._all

    @property
    def judges(self) -> bool:
        """Whether the config has a rule for any of them."""
        return self.find_rule is not None

    @property
    def beyond(self) -> bool:
        """Whether a number is beyond a threshold."""
        return self.find_rule is not None and any(value.beyond for value in self.all)

    def rule_of(self, key: str) -> ValueRule | None:
        """The config's rule for a key of the last update."""
        return None if self._rules is None else self._rules.get(key)

    def would_be_beyond(self, pairs: Pairs) -> bool:
        """Whether a number of other key-values would be beyond a threshold."""
        return any(
            ExportedValue(key, unit, as_sample(number), rule=self.rule_of(pair[0])).beyond
            for pair in pairs
            for key, unit, number in self._read(*pair)
        )

    def update(self, pairs: Pairs) -> bool:
        """Take the key-values of a new status; True if a number changed that may be judged."""
        if self.judged:
            old, self._pairs = self._pairs, tuple(pairs)
            return self._set(self._pairs, old)
        self._pairs, self._parsed = pairs, False
        self.marks.note(Mark.NUMBER)
        return False

    def parse(self) -> None:
        """Set the numbers of the last status, unless they are set already."""
        if not self._parsed:
            self._parsed = True
            pairs = tuple(self._pairs)
            if not (self._all_plain and self._set_plain(pairs)):
                self._set(pairs)

    def clear(self) -> None:
        """Remove the numbers and their series, but not their units."""
        self.series_limit.remove(self._series)
        self._series = 0
        self._all, self._rows = None, ()
        self._pairs, self._keys, self._parsed = (), (), True

    def _set(self, pairs: Pairs, old: Pairs = ()) -> bool:
        """Set the numbers; True if one changed.

        ``old`` are the key-values that are parsed, which need not be again; () where not known.
        """
        changed = False
        if len(self._keys) == len(pairs):
            rows = self._slots()
            for row, (key, pair) in enumerate(zip(self._keys, pairs, strict=True)):
                if old and old[row] == pair:
                    continue
                if key != pair[0]:
                    break
                slots = rows[row]
                value = slots[0] if len(slots) == 1 else None
                if value is not None and value.plain and is_plain(pair[1]):
                    value.text = pair[1]
                elif not self._update_row(slots, pair):
                    break
                changed = True
            else:
                return changed
        self._rebuild(pairs)
        self.marks.note(Mark.SERIES)
        return True

    def _set_plain(self, pairs: Pairs) -> bool:
        """Set the numbers of key-values as most are; False of others."""
        keys, texts = zip(*pairs, strict=True) if pairs else ((), ())
        if keys != self._keys or not all(map(is_plain, texts)):
            return False
        for value, text in zip(self._all or (), texts, strict=True):
            value.text = text
        return True

    def exported(self, pairs: Pairs) -> list[list[ExportedValue]]:
        """For each of the key-values its numbers that are exported.

        None at all where these are not the key-values of the last update.
        """
        if pairs != self._pairs:
            return [[] for _pair in pairs]
        self.parse()
        return [
            [value for value in slots if value is not None and not value.rejected]
            for slots in self._slots()
        ]

    def _slots(self) -> Sequence[list[ExportedValue | None]]:
        """The numbers of each of the key-values that were parsed last; see `_rows`."""
        return [[value] for value in self._all or ()] if self._all_plain else self._rows

    def _update_row(self, slots: list[ExportedValue | None], pair: tuple[str, str]) -> bool:
        """Set the numbers of one key-value; False if how many, or a unit, changed."""
        if slots == [None] and self._is_list_beyond(pair):
            return True
        found = self._read(*pair)
        if len(found) != len(slots):
            return False
        for value, number in zip(slots, found, strict=True):
            if value is None or value.rejected:
                if not self._stays_rejected(value, number):
                    return False
            elif number.unit != value.unit and math.isfinite(number.value):
                return False
            else:
                value.text = as_sample(number.value)
        return True

    def _stays_rejected(self, value: ExportedValue | None, number: Number) -> bool:
        """Count a rejected number; False if it would be accepted now.

        So what is beyond a limit does not cause a rebuild at each array.
        """
        if value is None:
            reason = self._limit()
        else:
            reason = "unit_changed" if number.unit != value.unit else None
        if reason is not None:
            self.reject(reason, number.key)
        return reason is not None

    def _rebuild(self, pairs: Pairs) -> None:
        kept = self._pairs
        self.clear()
        self._pairs = kept
        self._keys = tuple([key for key, _text in pairs])
        taken: dict[str, int] = {}
        rows = [self._add_all(pair, taken) for pair in pairs]
        numbers = self._all or ()
        self._all_plain = len(numbers) == len(pairs) and all(each.plain for each in numbers)
        self._rows = () if self._all_plain else rows

    def _add_all(self, pair: tuple[str, str], taken: dict[str, int]) -> list[ExportedValue | None]:
        if self._is_list_beyond(pair):
            return [None]
        found = self._read(*pair)
        rule = self.rule_of(pair[0])
        numbers = [self._add(number, rule, taken) for number in found]
        for value in numbers if rule is None and len(numbers) == 1 else ():
            if value is not None and not value.rejected:
                value.plain = value.unit == unit_in_name(found[0].key)
                if value.plain and is_plain(pair[1]):
                    value.text = pair[1]
        return numbers

    def _is_list_beyond(self, pair: tuple[str, str]) -> bool:
        """Count a list that a limit rejects: parsing it would cost as much as 32 numbers."""
        key, text = pair
        reason = self._limit() if text.lstrip()[:1] in ("[", "(") else None
        if reason is not None:
            self.reject(reason, key)
        return reason is not None

    def _limit(self) -> RejectionReason | None:
        """The limit that rejects one more number, if there is one."""
        if len(self._all or ()) >= self.limits.values:
            return "value_limit"
        return self.series_limit.exceeded_by(1)

    def _read(self, key: str, text: str) -> tuple[Number, ...]:
        rule = None if self.find_rule is None else self._rule(key, self.find_rule)
        if rule is None:
            return parse_numbers(key, text)
        return read_by(rule, key, text)

    def _rule(self, key: str, find_rule: FindRule) -> ValueRule | None:
        rules = self._rules = {} if self._rules is None else self._rules
        if key not in rules:
            if len(rules) >= 2 * self.limits.values:
                rules.clear()  # a robot that invents keys without end
            rules[key] = find_rule(key)
        return rules[key]

    def _add(
        self, number: Number, rule: ValueRule | None, taken: dict[str, int]
    ) -> ExportedValue | None:
        """A number with a unique key and the unit that the key had at first.

        None where a limit rejects it. ``taken`` are the keys before it, see `unique_name`.
        """
        reason = self._limit()
        if reason is not None:
            self.reject(reason, number.key)
            return None
        key = unique_name(truncate(number.key, self.limits.label_length), taken, "#")
        unit = self._unit(key, number)
        text = as_sample(number.value)
        value = ExportedValue(key, unit, text, rule.metric if rule else None, rule)
        if unit != number.unit and math.isfinite(number.value):
            value.rejected = True
            self.reject("unit_changed", key)
            return value
        reason = self.series_limit.add(value.series)
        if reason is not None:
            self.reject(reason, key)
            return None
        self._series += value.series
        self._all = [] if self._all is None else self._all
        self._all.append(value)
        return value

    def _unit(self, key: str, number: Number) -> str:
        """The unit that the key had at first; "nan" and "inf" have none."""
        units = self._units = {} if self._units is None else self._units
        if not math.isfinite(number.value):
            return units.get(key, number.unit)
        if key not in units and len(units) >= 2 * self.limits.values:
            units.clear()  # a robot that invents keys without end
        return units.setdefault(key, number.unit)


def read_by(rule: ValueRule, key: str, text: str) -> tuple[Number, ...]:
    """All numbers in one key-value that a rule of fleet.yml selects."""
    if not rule.keep:
        return ()
    if rule.enum is not None and (number := rule.enum.get(text.strip().lower())) is not None:
        found: tuple[Number, ...] = (Number(key.strip(), "", number),)
    else:
        found = parse_numbers(key, text, is_judged=bool(rule.thresholds))
    unit = rule.unit
    return tuple(
        Number(each.key, each.unit if unit is None else unit, each.value * rule.scale + rule.offset)
        for each in found
    )
