"""Profiles of fleet.yml, which extend one another -> profiles with everything filled in."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import chain
from types import MappingProxyType
from typing import Any, TypeVar

from ros_diagnostics_exporter.config.errors import Problem, quoted, suggestion
from ros_diagnostics_exporter.config.fleet import (
    Check,
    ComponentRule,
    Condition,
    Conditions,
    Profile,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.config.models import (
    ComponentEntry,
    ConditionEntry,
    ProfileEntry,
    ValueEntry,
)
from ros_diagnostics_exporter.config.patterns import written
from ros_diagnostics_exporter.config.validate import Placed

E = TypeVar("E")
R = TypeVar("R")

DEFAULT = "default"
ALL = "all"  # the check that is always there
_SETTINGS = ("stale_after", "confirm_after", "forget_after", "flap_interval", "stale_is_critical")
_MOST_WORDS = 200  # characters of a condition as it is shown; what it matches may be longer
_LEVELS = {"OK": 0, "WARN": 1, "ERROR": 2, "STALE": 3}


def resolved(
    entries: list[Placed[ProfileEntry]],
    named: frozenset[str],
    *,
    stale_is_critical: bool,
    problems: list[Problem],
) -> dict[str, Profile]:
    """Every profile by name, `default` always among them.

    What cannot be resolved is added to `problems`. `named` are all names in the file, also those
    of invalid profiles, for which there are problems already.
    """
    base = Profile(name=DEFAULT, stale_is_critical=stale_is_critical)
    resolver = _Resolver({str(each.path[-1]): each for each in entries}, named, base, problems)
    for name in resolver.entries:
        resolver.profile(name)
    return {DEFAULT: base, **{name: made for name, made in resolver.made.items() if made}}


class _Resolver:
    """Resolves profiles, each after the one that it extends."""

    def __init__(
        self,
        entries: Mapping[str, Placed[ProfileEntry]],
        named: frozenset[str],
        base: Profile,
        problems: list[Problem],
    ) -> None:
        self.entries = entries
        self.made: dict[str, Profile | None] = {}  # None: invalid, with a problem
        self._known = named | {DEFAULT}
        self._base = base
        self._problems = problems

    def profile(self, name: str, above: tuple[str, ...] = ()) -> Profile | None:
        """The resolved profile; `above` are the profiles that extend it."""
        if name not in self.made:
            parent = self._parent(name, self.entries[name], (*above, name))
            self.made[name] = parent and _extended(parent, name, self.entries[name], self._problems)
        return self.made[name]

    def _parent(
        self, name: str, placed: Placed[ProfileEntry], above: tuple[str, ...]
    ) -> Profile | None:
        wanted = placed.entry.extends or DEFAULT
        if name == DEFAULT:
            if placed.entry.extends:
                what = "the profile default cannot extend another"
                self._problem(placed, what, "remove extends")
            return self._base
        if wanted in above:
            way = " -> ".join((*above[above.index(wanted) :], wanted))
            self._problem(placed, f"extends in a circle ({way})", "remove one extends")
            return None
        if wanted in self.entries:
            return self.profile(wanted, above)
        if wanted not in self._known:
            self._problem(
                placed,
                f"there is no profile {quoted(wanted)}",
                suggestion(wanted, sorted(self._known)),
            )
            return None
        return self._base if wanted == DEFAULT else None

    def _problem(self, placed: Placed[ProfileEntry], what: str, remedy: str) -> None:
        self._problems.append(placed.problem("extends", what=what, remedy=remedy))


def _extended(
    parent: Profile, name: str, placed: Placed[ProfileEntry], problems: list[Problem]
) -> Profile:
    entry = placed.entry
    settings: dict[str, Any] = {
        key: getattr(entry, key) for key in _SETTINGS if getattr(entry, key) is not None
    }
    return replace(
        parent,
        name=name,
        checks=_checks(parent.checks, placed, problems),
        # The first match wins, so the own rules come before the inherited ones.
        components=(*_every(_components, entry.components), *parent.components),
        values=(*_every(_values, entry.values), *parent.values),
        **settings,
    )


def _every(rules: Callable[[E], list[R]], entries: list[E] | None) -> Iterator[R]:
    return chain.from_iterable(map(rules, entries or ()))


def _checks(
    inherited: tuple[Check, ...], placed: Placed[ProfileEntry], problems: list[Problem]
) -> tuple[Check, ...]:
    """The parent's checks with those of `placed` added, replaced and removed."""
    checks = {check.name: check for check in inherited}
    for name, entry in (placed.entry.checks or {}).items():
        where = ("checks", name)
        if name == ALL and (entry is None or entry.match is not None):
            what = "cannot be removed or narrowed: the check all contains all components"
            problems.append(placed.problem(*where, what=what, remedy="use another name"))
        elif entry is not None:
            checks[name] = Check(name, entry.match or (), entry.expect)
        elif checks.pop(name, None) is None:
            what = "is removed (null), but no profile that is extended has it"
            remedy = suggestion(name, [each for each in checks if each != ALL])
            problems.append(placed.problem(*where, what=what, remedy=remedy))
    return tuple(checks.values())


def _components(entry: ComponentEntry) -> list[ComponentRule]:
    """One rule for each of the entry's patterns."""
    levels = {
        _LEVELS[published]: _LEVELS[counted] for published, counted in (entry.levels or {}).items()
    }
    conditions = _conditions(entry)
    return [
        ComponentRule(
            pattern=pattern,
            ignore=entry.ignore or False,
            stale_after=entry.stale_after,
            confirm_after=entry.confirm_after,
            levels=MappingProxyType(levels),
            planned_stale=entry.planned_stale or False,
            conditions=conditions,
        )
        for pattern in entry.match
    ]


def _values(entry: ValueEntry) -> list[ValueRule]:
    """One rule for each pair of the entry's patterns for components and keys."""
    enum = {word.strip().lower(): number for word, number in (entry.enum or {}).items()}
    conditions = _conditions(entry)
    return [
        ValueRule(
            component=component,
            key=key,
            keep=entry.keep is not False,
            unit=entry.unit,
            enum=MappingProxyType(enum) if enum else None,
            scale=1.0 if entry.scale is None else entry.scale,
            offset=entry.offset or 0.0,
            metric=entry.metric,
            thresholds=_thresholds(entry),
            conditions=conditions,
        )
        for component in entry.component or (None,)
        for key in entry.key or (None,)
    ]


def _thresholds(entry: ValueEntry) -> tuple[Threshold, ...]:
    if entry.thresholds is None:
        return ()
    return tuple(
        Threshold(bound, severity, value)
        for bound in ("low", "high")
        for severity in ("warning", "critical")
        if (value := getattr(getattr(entry.thresholds, bound), severity, None)) is not None
    )


def _conditions(entry: ComponentEntry | ValueEntry) -> Conditions | None:
    if not (entry.when or entry.unless):
        return None
    when, unless = (tuple(map(_condition, each or ())) for each in (entry.when, entry.unless))
    return Conditions(when, unless)


def _condition(entry: ConditionEntry) -> Condition:
    levels = entry.level or ()
    return Condition(
        text=" ".join(filter(None, _in_words(entry)))[:_MOST_WORDS],
        component=entry.component or (),
        levels=tuple(_LEVELS[each] for each in levels),
        key=entry.key or (),
        texts=entry.equals or (),
        below=entry.below,
        above=entry.above,
    )


def _in_words(entry: ConditionEntry) -> Iterator[str]:
    """A condition as people read it: "Charger State is charging"."""
    if entry.component:
        yield written(entry.component)
    if entry.key:
        yield written(entry.key)
    yield "is"
    if entry.level:
        yield " or ".join(entry.level)
    if entry.equals:
        yield written(entry.equals)
    bounds = (("above", entry.above), ("below", entry.below))
    yield " and ".join(f"{word} {number:g}" for word, number in bounds if number is not None)
