"""The numbers of one component: which key-values are numbers, in which unit, by which rule."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ros_diagnostics_exporter.config.fleet import ValueRule
from ros_diagnostics_exporter.state.bounds import Budget, Reject, bounded
from ros_diagnostics_exporter.values import Reading, readings

Pairs = tuple[tuple[str, str], ...]
FindRule = Callable[[str], "ValueRule | None"]  # key -> the config's rule for it


@dataclass(slots=True)
class Value:
    """One number as it is exported; ``metric`` is the name that the config gave it, or None."""

    key: str
    unit: str
    number: float
    metric: str | None = None
    rule: ValueRule | None = None


class Values:
    """The numbers of one component, kept in step with its key-values.

    As long as the keys stay and their strings keep their shape, an update only sets numbers.
    """

    __slots__ = (
        "_budget",
        "_find_rule",
        "_limits",
        "_pairs",
        "_reject",
        "_rows",
        "_rules",
        "_units",
        "all",
    )

    def __init__(
        self, find_rule: FindRule | None, limits: tuple[int, int], budget: Budget, reject: Reject
    ) -> None:
        """``limits`` are the values of a component and the characters of a key.

        ``find_rule`` is None where the config has no rule for any value.
        """
        self.all: list[Value] = []
        self._rows: list[list[Value]] = []  # for each key-value its numbers
        self._pairs: Pairs = ()
        self._units: dict[str, str] = {}
        self._find_rule = find_rule
        self._rules: dict[str, ValueRule | None] = {}
        self._limits = limits
        self._budget = budget
        self._reject = reject

    def update(self, pairs: Pairs) -> tuple[bool, bool]:
        """Take the key-values of a new status: (did a number change, did the set of them)."""
        old = self._pairs
        if pairs == old:
            return False, False
        changed = False
        if len(old) == len(pairs):
            for row, (before, after) in enumerate(zip(old, pairs, strict=True)):
                if before == after:
                    continue
                if before[0] != after[0] or not self._renew(row, after):
                    break
                changed = True
            else:
                self._pairs = pairs
                return changed, False
        self._rebuild(pairs)
        return True, True

    def clear(self) -> None:
        """Forget the numbers (not their units), and give their series back."""
        self._budget.give(len(self.all))
        self.all, self._rows, self._pairs = [], [], ()

    def _renew(self, row: int, pair: tuple[str, str]) -> bool:
        """Set the numbers of one key-value whose string changed; False if their shape did."""
        slots = self._rows[row]
        found = self._read(*pair)
        if len(found) != len(slots):
            return False
        for value, reading in zip(slots, found, strict=True):
            if reading.unit != value.unit and math.isfinite(reading.number):
                return False
            value.number = reading.number
        return True

    def _rebuild(self, pairs: Pairs) -> None:
        most, _length = self._limits
        self.clear()
        self._pairs = pairs
        seen: set[str] = set()
        for key, text in pairs:
            row: list[Value] = []
            self._rows.append(row)
            for reading in self._read(key, text):
                if len(self.all) >= most:
                    self._reject("value_limit", key)
                    continue
                value = self._admit(reading, self._rules.get(key), seen)
                if value is None:
                    continue
                if not self._budget.take(1):
                    self._reject("series_limit", key)
                else:
                    row.append(value)
                    self.all.append(value)

    def _read(self, key: str, text: str) -> tuple[Reading, ...]:
        rule = None if self._find_rule is None else self._rule(key)
        if rule is None:
            return readings(key, text)
        if not rule.keep:
            return ()
        if rule.enum is not None and (number := rule.enum.get(text.strip().lower())) is not None:
            found: tuple[Reading, ...] = (Reading(key.strip(), "", number),)
        else:
            found = readings(key, text)
        return tuple(_apply(rule, reading) for reading in found)

    def _rule(self, key: str) -> ValueRule | None:
        if key not in self._rules and self._find_rule is not None:
            if len(self._rules) >= 2 * self._limits[0]:
                self._rules.clear()  # a robot that invents keys without end
            self._rules[key] = self._find_rule(key)
        return self._rules.get(key)

    def _admit(self, reading: Reading, rule: ValueRule | None, seen: set[str]) -> Value | None:
        """A reading with a key of its own and the unit that the key had at first sight."""
        key = bounded(reading.key, self._limits[1])
        number = 1
        while key in seen:  # drivers repeat keys: the second "Error" becomes "Error#2"
            number += 1
            key = f"{bounded(reading.key, self._limits[1])}#{number}"
        seen.add(key)
        unit = reading.unit
        if math.isfinite(reading.number):
            if key not in self._units and len(self._units) >= 2 * self._limits[0]:
                self._units.clear()  # a robot that invents keys without end
            unit = self._units.setdefault(key, unit)
            if unit != reading.unit:
                self._reject("unit_changed", key)
                return None
        else:  # "nan" and "inf" come without the unit that the number has
            unit = self._units.get(key, unit)
        return Value(key, unit, reading.number, rule.metric if rule else None, rule)


def _apply(rule: ValueRule, reading: Reading) -> Reading:
    unit = reading.unit if rule.unit is None else rule.unit
    return Reading(reading.key, unit, reading.number * rule.scale + rule.offset)
