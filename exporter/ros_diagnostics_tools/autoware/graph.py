"""Reads the files of a diagnostic graph into units, each with its place.

The format is that of Autoware's package autoware_diagnostic_graph_aggregator (doc/format); where
its text is silent, what its loader does.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ros_diagnostics_exporter.config import yaml_file
from ros_diagnostics_exporter.config.errors import quoted
from ros_diagnostics_exporter.config.yaml_file import Document, KeyPath, inside
from ros_diagnostics_exporter.regex import Pattern, RegexError

LISTS = ("and", "or", "short-circuit-and")
REMAPS = ("warn-to-ok", "warn-to-error")
CONSTANTS = ("ok", "warn", "error", "stale")
_SECTIONS = ("files", "edits", "units")
# Type -> the keys that it needs beside `type`.
_NEEDS: Mapping[str, tuple[str, ...]] = {
    "diag": ("node", "name"),
    "link": ("link",),
    **dict.fromkeys(LISTS, ()),
    **dict.fromkeys(REMAPS, ("item",)),
    **dict.fromkeys(CONSTANTS, ()),
}
_OWN = {"diag": ("timeout",), **dict.fromkeys(LISTS, ("list",))}
_SUBSTITUTION = re.compile(r"\$\(([^()]*)\)")


class GraphError(Exception):
    """The files are no graph that Autoware would load; the text names file, line and way out."""


@dataclass(eq=False)
class Unit:
    """One unit as it is written; ``wrong``: why Autoware would not load it."""

    file: Path
    line: int
    type: str = ""
    path: str = ""
    data: Mapping[str, Any] = field(default_factory=dict)
    children: list[Unit] = field(default_factory=list)
    parent: Unit | None = None
    wrong: str = ""
    removed: str = ""  # by which edit

    def __str__(self) -> str:
        name = self.path or (f"-> {self.data.get('link')}" if self.type == "link" else "(no path)")
        return f"{self.place}: {name}"

    @property
    def place(self) -> str:
        """``file:line``."""
        return f"{self.file}:{self.line}"

    @property
    def component(self) -> str:
        """The name of the status that a unit of type diag refers to."""
        return ": ".join(filter(None, (self.data["node"], self.data["name"])))

    @property
    def more(self) -> Iterator[str]:
        """The keys that its type does not need."""
        known = ("path", "type", *_NEEDS.get(self.type, ()), *_OWN.get(self.type, ()))
        return (key for key in self.data if key not in known)


@dataclass
class Edit:
    """An edit as it is written, and the paths of the units that it removes."""

    file: Path
    line: int
    data: Any
    removes: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        data = self.data if isinstance(self.data, dict) else {}
        what = data.get("regex") or data.get("path") or quoted(self.data)
        return f"{self.place}: {what}"

    @property
    def place(self) -> str:
        """``file:line``."""
        return f"{self.file}:{self.line}"


@dataclass
class Graph:
    """All units, in the order of the files, each before those inside of it."""

    files: list[Path]
    units: list[Unit]
    edits: list[Edit]
    by_path: dict[str, Unit]
    ordered: list[Unit] = field(default_factory=list)  # each after those on which it rests

    def target(self, unit: Unit) -> Unit | None:
        """The unit itself, or that to which its links lead; None where there is none."""
        found: Unit | None = unit
        while found is not None and found.type == "link" and not found.wrong:
            found = self.by_path.get(found.data["link"])
        return found

    def inputs(self, unit: Unit) -> list[Unit]:
        """The units on which its level rests that are there."""
        targets = map(self.target, unit.children)
        return [each for each in targets if each is not None and not each.removed]


def read(paths: Iterable[Path], packages: Mapping[str, Path]) -> Graph:
    """Read files and all that they include; ``packages``: the share folders of ROS packages.

    Raises:
        GraphError: a file is missing or is no graph, a path is given twice, units are in a circle.
    """
    reader = _Reader(packages)
    for path in paths:
        reader.read(path, str(path))
    graph = Graph(reader.files, reader.units, reader.edits, _by_path(reader.units))
    for edit in graph.edits:
        _apply(edit, graph)
    graph.ordered = _ordered(graph)
    return graph


class _Reader:
    def __init__(self, packages: Mapping[str, Path]) -> None:
        self._packages = packages
        self._seen: set[Path] = set()
        self.files: list[Path] = []
        self.units: list[Unit] = []
        self.edits: list[Edit] = []

    def read(self, path: Path, asked_by: str) -> None:
        """Read a file that was not read yet, then those that it includes."""
        real = path.resolve()
        if real in self._seen:
            return
        self._seen.add(real)
        document = _document(path, asked_by)
        self.files.append(path)
        for at, data in enumerate(_list(document, ("units",))):
            self._unit(document, ("units", at), data, None)
        for at, data in enumerate(_list(document, ("edits",))):
            self.edits.append(Edit(path, document.line(("edits", at)), data))
        for at, data in enumerate(_list(document, ("files",))):
            place = f"{path}:{document.line(('files', at))}"
            wanted = data.get("path") if isinstance(data, dict) else None
            if not isinstance(wanted, str):
                raise GraphError(f"{place}: {quoted(data)} names no file; write {{path: ...}}")
            self.read(self._path(wanted, path, place), place)

    def _path(self, wanted: str, file: Path, place: str) -> Path:
        def value(match: re.Match[str]) -> str:
            words = match[1].split()
            if words == ["dirname"]:
                return str(file.parent)
            if len(words) == 2 and words[0] == "find-pkg-share":
                if words[1] not in self._packages:
                    raise GraphError(
                        f"{place}: where is the package {words[1]}? Source its workspace, or say "
                        f"--package {words[1]}=DIR with its share folder"
                    )
                return str(self._packages[words[1]])
            raise GraphError(
                f"{place}: {match[0]} is no substitution; use $(dirname) or $(find-pkg-share NAME)"
            )

        return Path(_SUBSTITUTION.sub(value, wanted))

    def _unit(self, document: Document, where: KeyPath, data: Any, parent: Unit | None) -> Unit:
        unit = Unit(document.path, document.line(where), parent=parent)
        self.units.append(unit)
        if not isinstance(data, dict):
            unit.wrong = f"{quoted(data)} is no unit"
            return unit
        unit.data, unit.type, unit.path = data, _text(data, "type"), _text(data, "path")
        unit.wrong = _wrong(unit)
        inside_of = [(*where, "list", at) for at, _ in enumerate(_listed(data))]
        inside_of += [(*where, "item")] if isinstance(data.get("item"), dict) else []
        if unit.wrong or unit.type in (*LISTS, *REMAPS):
            for each in inside_of:
                inner = inside(document.data, each)
                unit.children.append(self._unit(document, each, inner, unit))
        return unit


def _listed(data: Mapping[str, Any]) -> list[Any]:
    found = data.get("list")
    return found if isinstance(found, list) else []


def _document(path: Path, asked_by: str) -> Document:
    document, problems = yaml_file.read(path)
    if problems or document is None:
        note = "" if asked_by == str(path) else f" (included by {asked_by})"
        raise GraphError(f"{problems[0]}{note}")
    data = document.data
    if not isinstance(data, dict) or not data.keys() & set(_SECTIONS):
        raise GraphError(f"{path}: is no diagnostic graph: it has none of {', '.join(_SECTIONS)}")
    unknown = sorted(data.keys() - set(_SECTIONS))
    if unknown:
        line = document.line((unknown[0],))
        raise GraphError(f"{path}:{line}: {unknown[0]} is none of {', '.join(_SECTIONS)}")
    return document


def _list(document: Document, where: KeyPath) -> list[Any]:
    found = inside(document.data, where)
    if found is not None and not isinstance(found, list):
        place = f"{document.path}:{document.line(where)}"
        raise GraphError(f"{place}: {where[-1]} is no list; start each entry with a dash")
    return found or []


def _text(data: Mapping[str, Any], key: str) -> str:
    found = data.get(key)
    return "" if found is None else str(found)


def _wrong(unit: Unit) -> str:
    """Why Autoware would not load it, or ""."""
    if not unit.type:
        return "it has no type"
    if unit.type not in _NEEDS:
        return f"{quoted(unit.type)} is no type of Autoware's"
    for key in _NEEDS[unit.type]:
        kind, wanted = ("a unit", dict) if key == "item" else ("text", str)
        if unit.data.get(key) is None:
            return f"it has no {key}"
        if not isinstance(unit.data[key], wanted):
            return f"{key} is not {kind}"
    is_list = isinstance(unit.data.get("list"), list | None)
    return "" if is_list or unit.type not in LISTS else "list is not a list"


def _by_path(units: Iterable[Unit]) -> dict[str, Unit]:
    found: dict[str, Unit] = {}
    for unit in units:
        if not unit.path or unit.wrong:
            continue
        if unit.path in found:
            raise GraphError(
                f"{unit}: is in {found[unit.path].place}, too; import one of the files, or rename "
                "one"
            )
        found[unit.path] = unit
    return found


def _apply(edit: Edit, graph: Graph) -> None:
    """Mark what an edit removes; what is of another type, or matches nothing, removes nothing."""
    if not isinstance(edit.data, dict) or edit.data.get("type") != "remove":
        return
    regex, path = _text(edit.data, "regex"), _text(edit.data, "path")
    try:
        pattern = Pattern(regex) if regex else None
    except RegexError as error:
        raise GraphError(f"{edit}: is no regular expression of RE2 ({error})") from None
    for unit in graph.by_path.values():
        is_meant = pattern.fullmatch(unit.path) if pattern else unit.path == path
        if is_meant and unit.type != "link":
            edit.removes.append(unit.path)
            unit.removed = edit.place


def _ordered(graph: Graph) -> list[Unit]:
    done: dict[Unit, None] = {}
    for start in graph.units:
        way: list[tuple[Unit, Iterator[Unit]]] = [(start, iter(_next(graph, start)))]
        around = {start}
        while way and start not in done:
            unit, rest = way[-1]
            each = next(rest, None)
            if each is None:
                done[unit] = None
                around.discard(unit)
                way.pop()
            elif each in around:
                names = [str(one.path or one.type) for one, _ in way]
                raise GraphError(f"{each}: needs itself: {' -> '.join(names)}; remove a link")
            elif each not in done:
                around.add(each)
                way.append((each, iter(_next(graph, each))))
    return list(done)


def _next(graph: Graph, unit: Unit) -> list[Unit]:
    if unit.type != "link" or unit.wrong:
        return unit.children
    linked = graph.by_path.get(unit.data["link"])
    return [] if linked is None else [linked]
