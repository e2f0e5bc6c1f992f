"""The analyzers of single components: Generic, Discard, Ignore, and Other.

Each collects the statuses that it matches and reports its group: the parent first, then the
children in byte order of their names.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Protocol

from virtual_robots.aggregator.parameters import AnalyzerConfigError, Parameters
from virtual_robots.aggregator.status_item import (
    MESSAGE_OF_LEVEL,
    StatusItem,
    missing_item,
    output_name,
    without_prefix,
)
from virtual_robots.model import ERROR, OK, STALE, Status


class Analyzer(Protocol):
    """What a group needs of each analyzer below it."""

    @property
    def path(self) -> str:
        """The full name of its parent row."""

    @property
    def nice_name(self) -> str:
        """Its name in the parent row's values."""

    def match(self, name: str) -> bool:
        """Whether a component of this name belongs here."""

    def analyze(self, item: StatusItem) -> bool:
        """Store a received item; False if it was ignored."""

    def report(self, now: float) -> list[Status]:
        """The rows of this group at ``now``."""


@dataclass
class GenericAnalyzerBase:
    """The common part of Generic and Other: items by name, and the state of the group."""

    path: str
    nice_name: str
    timeout: float = 5.0
    num_items: int = -1
    discard_stale: bool = False
    items: dict[str, StatusItem] = field(default_factory=dict)

    def __post_init__(self) -> None:
        # Without a timeout nothing is ever stale, so nothing can be discarded either.
        self.discard_stale = self.discard_stale and self.timeout > 0

    def analyze(self, item: StatusItem) -> bool:
        """Keep the item as the last of its name."""
        self.items[item.status.name] = item
        return True

    def is_stale(self, item: StatusItem, now: float) -> bool:
        """Whether nothing was received for longer than the timeout (0 or less: never)."""
        return self.timeout > 0 and now - item.received > self.timeout

    def report(self, now: float) -> list[Status]:
        """The parent, then its children."""
        if self.discard_stale:
            self.items = {n: i for n, i in self.items.items() if not self.is_stale(i, now)}
        items = [self.items[name] for name in sorted(self.items)]
        rows = [i.to_status(self.path, stale=self.is_stale(i, now)) for i in items]
        level, message = self._check_num_items(self._roll_up(rows))
        values = tuple((i.status.name, i.status.message) for i in items)
        return [Status(level, self.path, message, "", values), *rows]

    def _roll_up(self, rows: Iterable[Status]) -> int:
        levels = {row.level for row in rows}
        if levels <= {STALE}:
            # With discard_stale the absence of a component is no fault.
            return OK if self.discard_stale else STALE
        return ERROR if STALE in levels else max(levels)

    def _check_num_items(self, level: int) -> tuple[int, str]:
        found = len(self.items)
        if self.num_items == 0 and not found:
            return OK, MESSAGE_OF_LEVEL[OK]
        if self.num_items > 0 and found != self.num_items:
            expected = f"xpected {self.num_items}"
            message = f"E{expected}, found {found}" if found else f"No items found, e{expected}"
            return max(ERROR, level), message
        return level, MESSAGE_OF_LEVEL[level]


@dataclass
class GenericAnalyzer(GenericAnalyzerBase):
    """Matches components by their names."""

    startswith: list[str] = field(default_factory=list)
    contains: list[str] = field(default_factory=list)
    regex: list[re.Pattern[str]] = field(default_factory=list)
    prefixes: list[str] = field(default_factory=list)

    def match(self, name: str) -> bool:
        """Any rule is enough; a regular expression must match the whole name."""
        return (
            any(pattern.fullmatch(name) for pattern in self.regex)
            or any(name.startswith(start) for start in self.startswith)
            or any(part in name for part in self.contains)
        )

    def report(self, now: float) -> list[Status]:
        """The rows, with the prefixes removed from their names."""
        rows = super().report(now)
        for prefix in self.prefixes:
            rows = [row._replace(name=without_prefix(row.name, prefix)) for row in rows]
        return rows


class DiscardAnalyzer(GenericAnalyzer):
    """Matches components by their names and reports none of them."""

    def report(self, now: float) -> list[Status]:
        """Nothing, ever."""
        del now
        return []


class IgnoreAnalyzer:
    """Matches nothing and reports nothing; its components go to Other."""

    path = nice_name = ""

    def match(self, name: str) -> bool:
        """No component belongs here."""
        del name
        return False

    def analyze(self, item: StatusItem) -> bool:
        """Never called, because nothing matches."""
        del item
        return False

    def report(self, now: float) -> list[Status]:
        """Nothing, ever."""
        del now
        return []


@dataclass
class OtherAnalyzer(GenericAnalyzerBase):
    """Items that no analyzer matched; dropped after 5 s, and the group with its last item."""

    as_errors: bool = False

    def report(self, now: float) -> list[Status]:
        """The rows; none without items."""
        parent, *rows = super().report(now)
        if not rows:
            return []
        if self.as_errors:
            parent = parent._replace(level=ERROR, message='Unanalyzed items found in "Other"')
        return [parent, *rows]


def build_generic(
    kind: type[GenericAnalyzer], base: str, breadcrumb: str, parameters: Parameters, now: float
) -> GenericAnalyzer | None:
    """A Generic or Discard analyzer from its parameters; None where upstream's init fails.

    ``base`` is the path above it. It fails without any rule to match; `expected` is none, and
    `name` is a parameter that the ROS 2 releases do not read. Raises AnalyzerConfigError where a
    parameter has a type on which upstream aborts.
    """
    names = parameters.under(breadcrumb)

    def texts(key: str) -> list[str]:
        return parameters.texts(names[key]) if key in names else []

    find_and_remove = texts("find_and_remove_prefix")
    nice_name = parameters.text(names["path"]) if "path" in names else breadcrumb
    analyzer = kind(
        path=f"{base}/{nice_name}",
        nice_name=nice_name,
        timeout=parameters.number(names["timeout"]) if "timeout" in names else 5.0,
        num_items=parameters.integer(names["num_items"]) if "num_items" in names else -1,
        discard_stale="discard_stale" in names and parameters.flag(names["discard_stale"]),
        # As upstream, in byte order of the keys: a later one replaces an earlier one.
        startswith=texts("startswith") or find_and_remove,
        contains=texts("contains"),
        regex=[_compiled(text, names["regex"], parameters) for text in texts("regex")],
        prefixes=[output_name(p) for p in texts("remove_prefix") or find_and_remove],
    )
    analyzer.items = {name: missing_item(name, now) for name in texts("expected")}
    return analyzer if analyzer.startswith or analyzer.contains or analyzer.regex else None


def _compiled(text: str, name: str, parameters: Parameters) -> re.Pattern[str]:
    try:
        return re.compile(text)
    except re.error as error:
        raise AnalyzerConfigError(
            f"{parameters.source}: {name}: {text!r} is no regular expression: {error}"
        ) from error
