"""The numbers of one component: which key-values are numbers, in which unit, by which rule."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from ros_diagnostics_exporter.config.fleet import ValueRule
from ros_diagnostics_exporter.ingest.values import Reading, readings
from ros_diagnostics_exporter.state.bounds import Budget, Reject, bounded, own_name
from ros_diagnostics_exporter.state.reasons import Rejection

Pairs = tuple[tuple[str, str], ...]
FindRule = Callable[[str], "ValueRule | None"]  # key -> the config's rule for it


@dataclass(slots=True)
class Value:
    """One number as it is exported; ``metric`` is the name that the config gave it, or None.

    ``rejected`` tells that it came in another unit than at first and is not exported.
    """

    key: str
    unit: str
    number: float
    metric: str | None = None
    rule: ValueRule | None = None
    rejected: bool = False

    @property
    def series(self) -> int:
        """How many series it has: with thresholds also theirs, and the copy that rules read."""
        if self.rule is None or not self.rule.thresholds:
            return 1
        return (self.metric is not None) + 2 + len(self.rule.thresholds)

    @property
    def is_beyond_threshold(self) -> bool:
        """Whether it is beyond one of the config's bounds."""
        thresholds = () if self.rule is None else self.rule.thresholds
        return any(
            self.number < each.value if each.bound == "low" else self.number > each.value
            for each in thresholds
        )


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
        "_taken",
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
        # for each key-value its numbers; None for one that a limit left no place for
        self._rows: list[list[Value | None]] = []
        self._taken = 0  # series
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
        self._budget.give(self._taken)
        self._taken = 0
        self.all, self._rows, self._pairs = [], [], ()

    def exported(self, pairs: Pairs) -> list[list[Value]]:
        """For each of the key-values the numbers that are exported of it.

        None at all where these are not the key-values that were read last.
        """
        if pairs != self._pairs:
            return [[] for _pair in pairs]
        return [
            [value for value in row if value is not None and not value.rejected]
            for row in self._rows
        ]

    def _renew(self, row: int, pair: tuple[str, str]) -> bool:
        """Set the numbers of one key-value whose string changed; False if their shape did."""
        slots = self._rows[row]
        if slots == [None] and self._is_list_beyond(pair):
            return True
        found = self._read(*pair)
        if len(found) != len(slots):
            return False
        for value, reading in zip(slots, found, strict=True):
            if value is None or value.rejected:
                if not self._stays_rejected(value, reading):
                    return False
            elif reading.unit != value.unit and math.isfinite(reading.number):
                return False
            else:
                value.number = reading.number
        return True

    def _stays_rejected(self, value: Value | None, reading: Reading) -> bool:
        """Count a number that was rejected; False where it would not be any more.

        So what is beyond a limit does not make everything be built anew at each array.
        """
        if value is None:
            reason = self._full()
        else:
            reason = "unit_changed" if reading.unit != value.unit else None
        if reason is not None:
            self._reject(reason, reading.key)
        return reason is not None

    def _rebuild(self, pairs: Pairs) -> None:
        self.clear()
        self._pairs = pairs
        taken: dict[str, int] = {}
        for pair in pairs:
            if self._is_list_beyond(pair):
                self._rows.append([None])
                continue
            found = self._read(*pair)
            rule = self._rules.get(pair[0])
            self._rows.append([self._admit(reading, rule, taken) for reading in found])

    def _is_list_beyond(self, pair: tuple[str, str]) -> bool:
        """Count a list that there is no place for: reading it costs as much as 32 numbers."""
        key, text = pair
        reason = self._full() if text.lstrip()[:1] in ("[", "(") else None
        if reason is not None:
            self._reject(reason, key)
        return reason is not None

    def _full(self) -> Rejection | None:
        """The limit that leaves no place for one more number."""
        return "value_limit" if len(self.all) >= self._limits[0] else self._budget.lacks(1)

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

    def _admit(
        self, reading: Reading, rule: ValueRule | None, taken: dict[str, int]
    ) -> Value | None:
        """A number with a key of its own and the unit that the key had at first sight.

        None where there is no place for it. ``taken`` are the keys before it, see `own_name`.
        """
        reason = self._full()
        if reason is not None:
            self._reject(reason, reading.key)
            return None
        key = own_name(bounded(reading.key, self._limits[1]), taken, "#")
        unit = self._unit(key, reading)
        value = Value(key, unit, reading.number, rule.metric if rule else None, rule)
        if unit != reading.unit and math.isfinite(reading.number):
            value.rejected = True
            self._reject("unit_changed", key)
            return value
        reason = self._budget.take(value.series)
        if reason is not None:
            self._reject(reason, key)
            return None
        self._taken += value.series
        self.all.append(value)
        return value

    def _unit(self, key: str, reading: Reading) -> str:
        """The unit that the key had at first sight; "nan" and "inf" come without one."""
        if not math.isfinite(reading.number):
            return self._units.get(key, reading.unit)
        if key not in self._units and len(self._units) >= 2 * self._limits[0]:
            self._units.clear()  # a robot that invents keys without end
        return self._units.setdefault(key, reading.unit)


def _apply(rule: ValueRule, reading: Reading) -> Reading:
    unit = reading.unit if rule.unit is None else rule.unit
    return Reading(reading.key, unit, reading.number * rule.scale + rule.offset)
