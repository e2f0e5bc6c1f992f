"""What is known about one component: its level, since when, and its values.

A level changes only here, so that since, changes and the level before stale always agree.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from ros_diagnostics_exporter.config.fleet import ComponentRule, Threshold, ValueRule
from ros_diagnostics_exporter.model import Feed, Instant, Level, Status
from ros_diagnostics_exporter.robots.limits import SeriesLimit, truncate, unique_name
from ros_diagnostics_exporter.robots.persisted import PersistedComponent
from ros_diagnostics_exporter.robots.rejections import Reject, RejectionReason
from ros_diagnostics_exporter.robots.values import Number, parse_numbers, parse_plain
from ros_diagnostics_exporter.robots.versions import Versions

OK, WARN, ERROR, STALE = (int(level) for level in Level)

# Raw components have no announced period: a component is late after three times its longest recent
# gap, but never before five seconds (updaters publish once a second).
GAPS_KEPT = 10
GAP_FACTOR = 3.0
LEAST_STALE_AFTER = 5.0
# Received once, or several times at one moment, a component has not yet shown how often it is
# published; monitors that publish once a minute exist (Autoware).
STALE_AFTER_FIRST = 90.0

_DIGITS = re.compile(r"[0-9]+")

Identity = tuple[
    str, str, str
]  # name, group where that is part of it, hardware_id where the name is not unique


class Component:
    """One component of one robot.

    ``reported`` is the level that the robot reported, ``level`` the one after the config's
    overrides; both are STALE while nothing fresh is known. ``since`` is Unix time, ``received`` and
    ``listed`` monotonic: the last fresh status, and the last array that contained the component.
    ``missing``: the last array of its aggregator does not.
    """

    __slots__ = (
        "_resume",
        "before_stale",
        "changes",
        "feed",
        "gaps",
        "group",
        "hardware_id",
        "identity",
        "key_values",
        "label",
        "last",
        "level",
        "listed",
        "message",
        "missing",
        "name",
        "quiet_because",
        "raw_received",
        "received",
        "reported",
        "rule",
        "since",
        "values",
    )

    def __init__(
        self,
        identity: Identity,
        name: str,
        rule: ComponentRule | None,
        values: ComponentValues,
        now: Instant,
    ) -> None:
        self.identity = identity
        self.name = name  # truncated, with its hardware_id where needed
        self.group = ""
        self.label = ""  # its name everywhere: no two of a group are the same
        self.rule = rule
        self.feed: Feed | None = None  # None: the robot's own topics
        self.values = values
        self.hardware_id = ""
        self.level = -1  # nothing received yet
        self.reported = STALE
        self.message = ""
        self.before_stale: int | None = None
        self.since = now.wall
        self.quiet_because = ""  # the condition of fleet.yml by which its trouble is no fault now
        self.changes = 0
        self.received: float | None = None
        self.raw_received: float | None = None
        self.listed = now.mono
        self.missing = False
        self.gaps: tuple[float, ...] = ()  # none where only an aggregator lists it
        self.last: Status | None = None
        self.key_values = 0  # key-values that count against the robot's limit
        self._resume: tuple[int, float] | None = (
            None  # (level, since) before a start, till received
        )

    @property
    def is_stale(self) -> bool:
        """Whether nothing fresh is known, whatever the config makes of that."""
        return self.reported == STALE

    @property
    def reports(self) -> bool:
        """Whether its message is not of before it became STALE for want of another."""
        return self.reported != STALE or (self.last is not None and self.last.level == STALE)

    @property
    def account(self) -> str:
        """The message, for people; of a component that says nothing any more, that it is old."""
        if self.reports:
            return self.message
        return "no longer reports" + (f"; its last message: {self.message}" if self.message else "")

    def effective_level(self, reported: int) -> int:
        """The level after the config's overrides."""
        return self.rule.levels.get(reported, reported) if self.rule is not None else reported

    def set_message(self, message: str, *, always: bool) -> bool:
        """Set the message that is exported; True if it changed.

        One that differs only in its digits is not set, unless ``always``: a measurement in the
        message must not make a new series every second.
        """
        if message == self.message:
            return False
        if not always and _DIGITS.sub("0", message) == _DIGITS.sub("0", self.message):
            return False
        self.message = message
        return True

    def set_reported(self, reported: int, now: Instant) -> bool:
        """Set the reported level; True if ``level`` changed."""
        self.reported = reported
        level = self.effective_level(reported)
        resume, self._resume = self._resume, None
        if reported != STALE and resume is not None and level == resume[0]:
            return self._resume_level(*resume)
        if level == self.level:
            return False
        self._change(level, now)
        return True

    def _change(self, level: int, now: Instant) -> None:
        self.before_stale = self.level if level == STALE and self.level >= OK else None
        if self.level >= OK:
            self.changes += 1
        self.level = level
        self.since = now.wall

    def _resume_level(self, level: int, since: float) -> bool:
        """Set what an earlier process knew: the first status since the start has the same level.

        True if ``level`` changed.
        """
        changed = level != self.level
        self.level, self.since = level, since
        self.before_stale = None
        return changed

    @property
    def last_recorded(self) -> int:
        """The level of its last event: of an earlier process, until it is received or STALE."""
        return self.level if self._resume is None else self._resume[0]

    @property
    def was_ok(self) -> bool:
        """Whether it was OK when it was last received, and its values within their thresholds.

        STALE that fleet.yml plans counts as the level before it.
        """
        is_planned = self.rule is not None and self.rule.planned_stale
        level = None if self.last is None else self.effective_level(self.last.level)
        if level is None or (level == STALE and is_planned):
            level = self.before_stale
        return level in (None, OK) and not self.values.beyond

    def persist(self, now: Instant) -> PersistedComponent:
        """What a later process should know."""
        level, since = self.level, self.since
        if self._resume is not None:  # not received since the last start
            level, since = self._resume
        return PersistedComponent(
            identity=self.identity,
            group=self.group,
            hardware_id=self.hardware_id,
            level=level,
            before_stale=self.before_stale,
            since=since,
            message=self.message,
            listed=now.wall - (now.mono - self.listed),
        )

    def restore(self, persisted: PersistedComponent, now: Instant) -> None:
        """Restore what an earlier process knew: STALE until it is received."""
        before = persisted.before_stale if persisted.level == STALE else persisted.level
        self.hardware_id = persisted.hardware_id
        self.listed = now.mono - (now.wall - persisted.listed)
        self.message = persisted.message
        self.reported = STALE
        self.level = self.effective_level(STALE)
        self.before_stale = before if self.level == STALE else None
        self.since = persisted.since
        if persisted.level != STALE:
            self._resume = persisted.level, persisted.since
            self.since = now.wall

    def note_raw(self, mono: float, threshold: float) -> None:
        """Note the receipt of a raw status, and the gap before it.

        A gap counts for at most twice the threshold: one long silence does not make the threshold
        useless, while a driver that has become slower is recognized after a few of its periods.
        """
        if self.raw_received is not None:
            gap = min(mono - self.raw_received, 2 * threshold)
            self.gaps = (*self.gaps, gap)[-GAPS_KEPT:]
        self.raw_received = mono

    def stale_after(self, default: float, *, raw: bool) -> float:
        """Seconds without a fresh status after which the component is STALE."""
        if self.rule is not None and self.rule.stale_after is not None:
            return self.rule.stale_after
        if self.feed is not None:
            return self.feed.stale_after
        if not raw:
            return default
        if len(self.gaps) < GAPS_KEPT and sum(self.gaps) < LEAST_STALE_AFTER:
            return max(STALE_AFTER_FIRST, default)
        return max(LEAST_STALE_AFTER, GAP_FACTOR * max(self.gaps))


# -- values --------------------------------------------------------------------------------

Pairs = Sequence[tuple[str, str]]
FindRule = Callable[[str], "ValueRule | None"]  # key -> the config's rule for it


@dataclass(slots=True)
class ExportedValue:
    """One number as it is exported; ``metric`` is the name that the config gives it, or None.

    ``rejected``: it has another unit than at first and is not exported.
    """

    key: str
    unit: str
    number: float
    metric: str | None = None
    rule: ValueRule | None = None
    rejected: bool = False

    @property
    def series(self) -> int:
        """How many series it has, with those of its thresholds and the copy that the rules read."""
        if self.rule is None or not self.rule.thresholds:
            return 1
        return (self.metric is not None) + 2 + len(self.rule.thresholds)

    @property
    def beyond(self) -> list[Threshold]:
        """Its thresholds that it is beyond."""
        return [
            each
            for each in (() if self.rule is None else self.rule.thresholds)
            if (self.number < each.value if each.bound == "low" else self.number > each.value)
        ]


class ComponentValues:
    """The numbers in the key-values of one component.

    As long as the keys, and how many numbers each has, stay, an update only sets numbers. Numbers
    that the config judges are parsed at once, all others when they are read: a robot sends ten
    times and more before it is scraped again.
    """

    __slots__ = (
        "_all",
        "_find_rule",
        "_judged",
        "_keys",
        "_limits",
        "_pairs",
        "_parsed",
        "_plain",
        "_reject",
        "_rows",
        "_rules",
        "_series",
        "_series_limit",
        "_units",
        "_versions",
    )

    def __init__(
        self,
        find_rule: FindRule | None,
        limits: tuple[int, int],
        series_limit: SeriesLimit,
        reject: Reject,
        versions: Versions,
        *,
        judged: bool,
    ) -> None:
        """``limits`` are the values of a component and the characters of a key.

        ``find_rule`` is None where the config has no rule for any value of this component,
        ``judged`` whether it may ask at any moment what they are.
        """
        self._all: list[ExportedValue] = []
        # for each key-value the number that a text without a unit sets; None where more is to do
        self._plain: list[ExportedValue | None] = []
        # for each of the other key-values its numbers; None for one that a limit rejects
        self._rows: dict[int, list[ExportedValue | None]] = {}
        self._series = 0  # series
        self._pairs: Pairs = ()  # of the last status
        self._keys: tuple[str, ...] = ()  # of those that were parsed last
        self._parsed = True
        self._units: dict[str, str] = {}
        self._find_rule = find_rule
        self._rules: dict[str, ValueRule | None] = {}
        self._limits = limits
        self._series_limit = series_limit
        self._reject = reject
        self._versions = versions
        self._judged = judged

    @property
    def all(self) -> list[ExportedValue]:
        """The numbers, in their order; those with another unit than at first among them."""
        self.parse()
        return self._all

    @property
    def beyond(self) -> bool:
        """Whether a number is beyond a threshold."""
        return self._find_rule is not None and any(value.beyond for value in self.all)

    def update(self, pairs: Pairs) -> bool:
        """Take the key-values of a new status; True if a number changed that may be judged."""
        if self._judged:
            old, self._pairs = self._pairs, tuple(pairs)
            return self._set(self._pairs, old)
        self._pairs, self._parsed = pairs, False
        self._versions.values += 1
        return False

    def parse(self) -> None:
        """Set the numbers of the last status, unless they are set already."""
        if not self._parsed:
            self._parsed = True
            self._set(tuple(self._pairs))

    def clear(self) -> None:
        """Remove the numbers and their series, but not their units."""
        self._series_limit.remove(self._series)
        self._series = 0
        self._all, self._plain, self._rows = [], [], {}
        self._pairs, self._keys, self._parsed = (), (), True

    def _set(self, pairs: Pairs, old: Pairs = ()) -> bool:
        """Set the numbers; True if one changed.

        ``old`` are the key-values that are parsed, which need not be again; () where not known.
        """
        changed = False
        if len(self._keys) == len(pairs):
            for row, (key, pair, plain) in enumerate(
                zip(self._keys, pairs, self._plain, strict=True)
            ):
                if old and old[row] == pair:
                    continue
                if key != pair[0]:
                    break
                if plain is not None and (number := parse_plain(pair[1])) is not None:
                    plain.number = number
                elif not self._update_row(row, pair):
                    break
                changed = True
            else:
                self._versions.values += changed
                return changed
        self._rebuild(pairs)
        self._versions.structure += 1
        return True

    def exported(self, pairs: Pairs) -> list[list[ExportedValue]]:
        """For each of the key-values its numbers that are exported.

        None at all where these are not the key-values of the last update.
        """
        if pairs != self._pairs:
            return [[] for _pair in pairs]
        self.parse()
        return [
            [value for value in self._numbers(row) if value is not None and not value.rejected]
            for row in range(len(pairs))
        ]

    def _numbers(self, row: int) -> list[ExportedValue | None]:
        plain = self._plain[row]
        return self._rows[row] if plain is None else [plain]

    def _update_row(self, row: int, pair: tuple[str, str]) -> bool:
        """Set the numbers of one key-value; False if how many, or a unit, changed."""
        slots = self._numbers(row)
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
                value.number = number.value
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
            self._reject(reason, number.key)
        return reason is not None

    def _rebuild(self, pairs: Pairs) -> None:
        kept = self._pairs
        self.clear()
        self._pairs = kept
        self._keys = tuple([key for key, _text in pairs])
        taken: dict[str, int] = {}
        for row, pair in enumerate(pairs):
            numbers = self._add_all(pair, taken)
            plain = self._plain_value(pair[0], numbers)
            self._plain.append(plain)
            if plain is None:
                self._rows[row] = numbers

    def _add_all(self, pair: tuple[str, str], taken: dict[str, int]) -> list[ExportedValue | None]:
        if self._is_list_beyond(pair):
            return [None]
        found = self._read(*pair)
        rule = self._rules.get(pair[0])
        return [self._add(number, rule, taken) for number in found]

    def _plain_value(self, key: str, numbers: list[ExportedValue | None]) -> ExportedValue | None:
        """The number of a key-value of which a text without a unit changes nothing else."""
        value = numbers[0] if len(numbers) == 1 else None
        if value is None or value.rejected or self._rules.get(key) is not None:
            return None
        return value if [each.unit for each in parse_numbers(key, "1")] == [value.unit] else None

    def _is_list_beyond(self, pair: tuple[str, str]) -> bool:
        """Count a list that a limit rejects: parsing it would cost as much as 32 numbers."""
        key, text = pair
        reason = self._limit() if text.lstrip()[:1] in ("[", "(") else None
        if reason is not None:
            self._reject(reason, key)
        return reason is not None

    def _limit(self) -> RejectionReason | None:
        """The limit that rejects one more number, if there is one."""
        if len(self._all) >= self._limits[0]:
            return "value_limit"
        return self._series_limit.exceeded_by(1)

    def _read(self, key: str, text: str) -> tuple[Number, ...]:
        rule = None if self._find_rule is None else self._rule(key)
        if rule is None:
            return parse_numbers(key, text)
        if not rule.keep:
            return ()
        if rule.enum is not None and (number := rule.enum.get(text.strip().lower())) is not None:
            found: tuple[Number, ...] = (Number(key.strip(), "", number),)
        else:
            found = parse_numbers(key, text)
        return tuple(_apply(rule, number) for number in found)

    def _rule(self, key: str) -> ValueRule | None:
        if key not in self._rules and self._find_rule is not None:
            if len(self._rules) >= 2 * self._limits[0]:
                self._rules.clear()  # a robot that invents keys without end
            self._rules[key] = self._find_rule(key)
        return self._rules.get(key)

    def _add(
        self, number: Number, rule: ValueRule | None, taken: dict[str, int]
    ) -> ExportedValue | None:
        """A number with a unique key and the unit that the key had at first.

        None where a limit rejects it. ``taken`` are the keys before it, see `unique_name`.
        """
        reason = self._limit()
        if reason is not None:
            self._reject(reason, number.key)
            return None
        key = unique_name(truncate(number.key, self._limits[1]), taken, "#")
        unit = self._unit(key, number)
        value = ExportedValue(key, unit, number.value, rule.metric if rule else None, rule)
        if unit != number.unit and math.isfinite(number.value):
            value.rejected = True
            self._reject("unit_changed", key)
            return value
        reason = self._series_limit.add(value.series)
        if reason is not None:
            self._reject(reason, key)
            return None
        self._series += value.series
        self._all.append(value)
        return value

    def _unit(self, key: str, number: Number) -> str:
        """The unit that the key had at first; "nan" and "inf" have none."""
        if not math.isfinite(number.value):
            return self._units.get(key, number.unit)
        if key not in self._units and len(self._units) >= 2 * self._limits[0]:
            self._units.clear()  # a robot that invents keys without end
        return self._units.setdefault(key, number.unit)


def _apply(rule: ValueRule, number: Number) -> Number:
    unit = number.unit if rule.unit is None else rule.unit
    return Number(number.key, unit, number.value * rule.scale + rule.offset)
