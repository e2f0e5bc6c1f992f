"""Units -> capabilities of a profile, and what became of each unit.

A unit with a path is a capability, or a component where it is of type diag and others rest on it.
The levels are those of Autoware: OK and no reserve are its OK, degraded its WARN, the others its
ERROR. What always has the same level is left out where that makes no difference.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import yaml

from ros_diagnostics_exporter import durations
from ros_diagnostics_exporter.config import capabilities
from ros_diagnostics_exporter.config.errors import quoted
from ros_diagnostics_tools.autoware.graph import CONSTANTS, LISTS, REMAPS, Graph, GraphError, Unit
from ros_diagnostics_tools.autoware.names import names_of
from ros_diagnostics_tools.names import escaped

_FORMS = {
    **dict.fromkeys(LISTS, "all"),
    "or": "any",
    "warn-to-ok": "degraded_is_ok",
    "warn-to-error": "degraded_is_lost",
}
# Why a key of a unit has no equivalent.
_KEYS = {
    "latch": "a fault ends when its parts are received better; nothing has to be reset",
    "dependent": "it marks a unit for displays and changes no level; here parts that failed are "
    "suppressed under one capability",
    "hysteresis": "a problem is a fault after confirm_after of its component or profile",
    **dict.fromkeys(
        ("allow_override", "allow_override_for_debugging"),
        "for debugging: nothing overrides a level here",
    ),
}


class _Level(IntEnum):
    """The level of what never changes."""

    OK = 0
    WARN = 1
    ERROR = 2


_CONSTANT: dict[str, _Level] = dict(zip(CONSTANTS, (*_Level, _Level.ERROR), strict=True))


@dataclass(frozen=True)
class _Need:
    """An expression of fleet.yml; in it a unit is a component, or another capability."""

    form: str
    of: tuple[_Need | Unit, ...]


class Row(NamedTuple):
    """What became of a unit or an edit; ``is_whole``: nothing of it was left out."""

    where: str
    type: str
    text: str
    is_whole: bool


class Imported(NamedTuple):
    """The content of fleet.yml, and a row for each unit and each edit."""

    content: dict[str, Any]
    rows: list[Row]

    @property
    def text(self) -> str:
        """fleet.yml."""
        return yaml.dump(
            self.content, sort_keys=False, default_flow_style=None, allow_unicode=True, width=200
        )


def convert(graph: Graph, fleet: str, profile: str, paths: Collection[str] = ()) -> Imported:
    """Translate a graph; with ``paths`` only these units and those on which they rest.

    Raises:
        GraphError: there are more capabilities than a profile may have, or no unit of these paths.
    """
    converter = _Converter(graph, paths)
    content = {"fleet": fleet, "profiles": {profile: converter.profile()}}
    return Imported(content, list(converter.rows()))


class _Converter:
    def __init__(self, graph: Graph, paths: Collection[str]) -> None:
        self._graph = graph
        self._wanted = _with_inputs(graph, paths)
        self._needed = {each for unit in graph.units for each in graph.inputs(unit)}
        self._lost: dict[Unit, list[str]] = {}  # why a unit is imported in part, or not at all
        self._found: dict[Unit, _Need | Unit | _Level | None] = {}
        for unit in graph.ordered:
            if not unit.wrong and unit.type != "link":
                self._found[unit] = self._level(unit)
        self._named = [each for each in graph.units if each in self._wanted and self._is_one(each)]
        if len(self._named) > capabilities.MOST:
            raise GraphError(
                f"{len(self._named)} units with a path are more than the {capabilities.MOST} "
                "capabilities that a profile may have; import some of them with --unit PATH"
            )
        names = names_of(each.path for each in self._named)
        self._names = {each: names[each.path] for each in self._named}
        self._used_by: dict[Unit, list[str]] = {}
        self._timeouts: dict[str, float] = {}

    # -- levels --------------------------------------------------------------------------------

    def _level(self, unit: Unit) -> _Need | Unit | _Level | None:
        """What a unit's level is; None where nothing is left of it."""
        if unit.type == "diag":
            return unit
        if unit.type in CONSTANTS:
            return _CONSTANT[unit.type]
        lost: list[str] = []
        inputs = list(self._inputs(unit, lost))
        found = _remapped(unit, inputs) if unit.type in REMAPS else _joined(unit, inputs, lost)
        if lost and not isinstance(found, _Level):
            self._lost[unit] = lost
        return found

    def _inputs(self, unit: Unit, lost: list[str]) -> Iterator[tuple[Unit, _Need | Unit | _Level]]:
        for child in unit.children:
            target = self._graph.target(child)
            if target is None:
                lost.append(f"without {child.data['link']}, which is in none of the files")
            elif target.wrong:
                lost.append(f"without {target.path or 'a unit inside of it'}: {target.wrong}")
            elif target.removed:
                if unit.type in REMAPS:
                    lost.append(f"its item {target.path} is removed")
            else:
                found = self._found[target]
                if target in self._lost:
                    reason = "not" if found is None else "in part"
                    lost.append(f"{target.path or 'a unit inside of it'} is imported {reason}")
                if found is not None:
                    is_other = isinstance(found, _Need) and target.path
                    yield target, target if is_other else found

    def _is_one(self, unit: Unit) -> bool:
        """Whether a unit is a capability."""
        if unit.removed or not unit.path or unit.type == "link":
            return False
        found = self._found.get(unit)
        return isinstance(found, _Need) or (found is unit and unit not in self._needed)

    # -- fleet.yml -----------------------------------------------------------------------------

    def profile(self) -> dict[str, Any]:
        """Their profile, in which STALE counts as ERROR, as in Autoware."""
        found = {self._names[each]: self._capability(each) for each in self._named}
        rules = [
            {"match": _component(name), "stale_after": durations.written(seconds)}
            for name, seconds in self._timeouts.items()
        ]
        parts: dict[str, Any] = {"stale_is_critical": True}
        return {
            **parts,
            **({"capabilities": found} if found else {}),
            **({"components": rules} if rules else {}),
        }

    def _capability(self, unit: Unit) -> Any:
        found = self._found[unit]
        name = self._names[unit]
        if not isinstance(found, _Need):
            return [self._part(unit, name)]
        parts = [self._part(each, name) for each in found.of]
        if found.form == "all":
            return parts
        return {found.form: parts} if found.form == "any" else [{found.form: parts}]

    def _part(self, part: _Need | Unit, name: str) -> Any:
        if isinstance(part, _Need):
            parts = [self._part(each, name) for each in part.of]
            is_one = part.form in ("all", "any") and len(parts) == 1
            return parts[0] if is_one else {part.form: parts}
        if part.type != "diag":
            return {"capability": self._names[part]}
        self._used_by.setdefault(part, []).append(name)
        seconds = _timeout(part)
        if seconds is not None:
            self._timeouts.setdefault(part.component, seconds)
        return _component(part.component)

    # -- what became of each -------------------------------------------------------------------

    def rows(self) -> Iterator[Row]:
        """What became of each unit and edit; after `profile`."""
        for unit in self._graph.units:
            text, is_whole = self._outcome(unit)
            notes = [] if unit.removed or unit.wrong else list(self._notes(unit))
            whole = is_whole and not notes
            yield Row(str(unit), unit.type or "?", "; ".join((text, *notes)), whole)
        for edit in self._graph.edits:
            count = len(edit.removes)
            text = f"removes {count} unit{'s' * (count != 1)}"
            if not count:
                text = "not imported: it is no edit of type remove, or removes nothing"
            yield Row(str(edit), "edit", text, bool(count))

    def _outcome(self, unit: Unit) -> tuple[str, bool]:
        """What became of it, and whether that is all of it."""
        return self._without_level(unit) or self._of_level(unit) or self._inside(unit)

    def _without_level(self, unit: Unit) -> tuple[str, bool] | None:
        """What became of a unit that is none in Autoware."""
        if unit.wrong:
            return f"not imported: {unit.wrong}, and Autoware does not load it", False
        if unit.removed:
            return f"removed by {unit.removed}", True
        if unit.type == "link":
            target = self._graph.target(unit)
            if target is None:
                return "not imported: no file has this path", False
            return ("its unit is removed" if target.removed else "followed"), True
        return None

    def _of_level(self, unit: Unit) -> tuple[str, bool] | None:
        """What became of a unit by its level, if it has a place of its own."""
        found, lost = self._found[unit], self._lost.get(unit, [])
        if isinstance(found, _Level):
            return f"always {found.name}: no capability, and left out of others", True
        if found is None:
            return f"not imported: {'; '.join(lost)}", False
        if unit in self._names:
            return "; ".join((f"capability {quoted(self._names[unit])}", *lost)), not lost
        if unit in self._used_by:
            return f"component of {', '.join(dict.fromkeys(self._used_by[unit]))}", True
        return None

    def _inside(self, unit: Unit) -> tuple[str, bool]:
        """What became of one that is neither a capability nor a component of one."""
        if unit not in self._wanted:
            return "not asked for", True
        if unit not in self._needed:
            if unit.parent is not None and unit.parent.removed:
                return "removed with the unit around it", True
            return "not imported: it has no path, and nothing rests on it", False
        if unit.type == "diag":
            return "left out: what rests on it always has the same level", True
        lost = self._lost.get(unit, [])
        return "; ".join(("inside of another", *lost)), not lost

    def _notes(self, unit: Unit) -> Iterator[str]:
        for key in unit.more:
            yield f"without {key}: {_KEYS.get(key, 'it is no key of Autoware')}"
        if unit.type == "diag" and unit.data.get("timeout") is not None:
            seconds = _timeout(unit)
            if seconds is None:
                yield f"without timeout: {quoted(unit.data['timeout'])} is no time"
            elif self._timeouts.get(unit.component, seconds) != seconds:
                yield "without timeout: another unit gives this component a different one"


def _with_inputs(graph: Graph, paths: Collection[str]) -> set[Unit]:
    if not paths:
        return set(graph.units)
    unknown = [each for each in paths if each not in graph.by_path]
    if unknown:
        raise GraphError(f"--unit {unknown[0]}: no unit has this path")
    found: set[Unit] = set()
    left = [graph.by_path[each] for each in paths]
    while left:
        unit = left.pop()
        if unit not in found:
            found.add(unit)
            left += [*unit.children, *filter(None, (graph.target(unit),))]
    return found


def _joined(
    unit: Unit, inputs: Iterable[tuple[Unit, _Need | Unit | _Level]], lost: list[str]
) -> _Need | _Level | None:
    """The worst of all (and), or the best (or); of none it is OK, for both."""
    parts: list[_Need | Unit] = []
    levels: list[tuple[_Level, Unit]] = []
    for each, found in inputs:
        if isinstance(found, _Level):
            levels.append((found, each))
        else:
            parts.append(found)
    strongest, choose = (_Level.OK, min) if unit.type == "or" else (_Level.ERROR, max)
    fixed = choose((level for level, _ in levels), default=None)
    if fixed is strongest or not (parts or lost):
        return _Level.OK if fixed is None else fixed
    for level, each in levels if parts else ():
        if level is _Level.WARN:
            lost.append(f"without {each.path or 'a unit inside of it'}, which is always WARN")
    return _Need(_FORMS[unit.type], tuple(dict.fromkeys(parts))) if parts else None


def _remapped(
    unit: Unit, inputs: list[tuple[Unit, _Need | Unit | _Level]]
) -> _Need | _Level | None:
    for _, found in inputs:
        if not isinstance(found, _Level):
            return _Need(_FORMS[unit.type], (found,))
        if found is _Level.WARN:
            return _Level.OK if unit.type == "warn-to-ok" else _Level.ERROR
        return found
    return None


def _timeout(unit: Unit) -> float | None:
    """The seconds after which a unit of type diag is STALE; None where it does not say."""
    found = unit.data.get("timeout")
    if isinstance(found, bool) or not isinstance(found, int | float):
        return None
    return float(found) if 0.001 <= found < float("inf") else None


def _component(name: str) -> dict[str, str]:
    """The pattern of a component's whole name."""
    return {"regex": f"^{escaped(name)}$"}
