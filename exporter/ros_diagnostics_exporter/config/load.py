"""fleet.yml and its folders -> one frozen Fleet, or one error with everything that is wrong.

Every call reads all files; nothing is cached.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from ros_diagnostics_exporter.config.capabilities import wrong_names
from ros_diagnostics_exporter.config.errors import LISTED, ConfigError, Finding, shortened
from ros_diagnostics_exporter.config.fleet import (
    Discovery,
    Fleet,
    Limits,
    Maintenance,
    Profile,
    Query,
    Robot,
    Shared,
    Source,
)
from ros_diagnostics_exporter.config.keys import Entry
from ros_diagnostics_exporter.config.lint import lint
from ros_diagnostics_exporter.config.profiles import resolved
from ros_diagnostics_exporter.config.validate import (
    Checked,
    Placed,
    find_conflicts,
    find_unreached,
    validate,
)
from ros_diagnostics_exporter.config.yaml_file import Document, KeyPath, read

_SUFFIXES = (".yml", ".yaml")
_LISTS = ("robots", "discovery", "shared", "maintenance", "queries")

T = TypeVar("T", bound=Entry)


def load(path: Path) -> Fleet:
    """Read fleet.yml at `path` and the folders that it names.

    Raises:
        ConfigError: the config cannot be used; its text has one line for each problem.
    """
    sources_read = [path]
    document, problems = read(path)
    fleet = _fleet(document, sources_read, problems) if document else None
    if problems or fleet is None:
        raise ConfigError(problems, sources_read)
    return replace(fleet, sources=tuple(sources_read))


def sources(fleet_or_path: Fleet | Path) -> tuple[Path, ...]:
    """The files and folders that a Fleet is read from.

    Folders are included also before they exist. For a path, everything is read; an invalid config
    has sources, too.
    """
    if isinstance(fleet_or_path, Fleet):
        return fleet_or_path.sources
    try:
        return load(fleet_or_path).sources
    except ConfigError as error:
        return error.sources


def _fleet(document: Document, sources_read: list[Path], problems: list[Finding]) -> Fleet | None:
    """The Fleet that the document and its folders describe; problems are added to `problems`."""
    if not isinstance(document.data, dict):
        what = "is empty" if document.data is None else "is not a mapping"
        problems.append(document.problem((), what, "start it with fleet: and a name"))
        return None
    valid = validate(document, [((), _without_sections(document.data))], Fleet, problems)
    top = valid[0].entry if valid else None
    checked, profiles = _sections(
        document,
        sources_read,
        problems,
        stale_is_critical=top is not None and top.stale_is_critical,
    )
    problems.extend(find_conflicts(checked, top.limits if top else Limits()))
    if top is None:
        return None
    of_robots = {name for each in profiles.values() for name in each.capabilities}
    for name, what, remedy in wrong_names(top.capabilities, of_robots=of_robots):
        problems.append(document.problem(("capabilities", name), what, remedy))
    if top.zenoh is None:
        problems.extend(find_unreached(checked))
    fleet = replace(
        top,
        robots=tuple(each.entry for each in checked.robots),
        discoveries=tuple(each.entry for each in checked.discovery),
        shared=tuple(each.entry for each in checked.shared),
        profiles=MappingProxyType(profiles),
        maintenance=tuple(each.entry for each in checked.maintenance),
        queries=tuple(each.entry for each in checked.queries),
    )
    warnings = lint(checked, fleet)
    if len(warnings) > LISTED:
        more = f"and {len(warnings) - LISTED} more warnings"
        warnings = (*map(shortened, warnings[:LISTED]), more)
    return replace(fleet, warnings=warnings)


def _without_sections(data: dict[str, Any]) -> dict[str, Any]:
    """The keys of the file itself: the entries of sections are validated one by one."""
    return {
        key: (
            []
            if key in _LISTS and isinstance(each, list)
            else {name: {} for name in each}  # their names are validated with the rest
            if key == "profiles" and isinstance(each, dict)
            else each
        )
        for key, each in data.items()
    }


def _sections(
    document: Document,
    sources_read: list[Path],
    problems: list[Finding],
    *,
    stale_is_critical: bool,
) -> tuple[Checked, dict[str, Profile]]:
    own, profiles = resolved(document, problems, stale_is_critical=stale_is_critical)
    folders = _Folders(document, sources_read, problems, profiles)

    def section(key: str, kind: type[T]) -> list[Placed[T]]:
        entries = document.data.get(key)
        items = _items(entries, (key,)) if isinstance(entries, list) else []
        return validate(document, items, kind, problems, profiles)

    shared = section("shared", Shared)
    robots = section("robots", Robot) + folders.entries("robots_folder", "robots.d", Robot)
    checked = Checked(
        document=document,
        profiles=own,
        robots=_on_shared_topics(robots, shared),
        discovery=section("discovery", Discovery),
        shared=shared,
        maintenance=section("maintenance", Maintenance)
        + folders.entries("maintenance_folder", "maintenance.d", Maintenance),
        queries=section("queries", Query) + folders.entries("queries_folder", "queries.d", Query),
    )
    return checked, profiles


def _on_shared_topics(
    robots: list[Placed[Robot]], shared: list[Placed[Shared]]
) -> list[Placed[Robot]]:
    """The robots; those on a shared topic have its source."""
    raw = {(each.entry.domain_id, each.entry.topic): each.entry.raw for each in shared}
    made = []
    for placed in robots:
        robot = placed.entry
        found = raw.get((robot.domain_id, robot.topic or ""))
        if found is not None:
            robot = robot.reading(Source.RAW if found else Source.AGG)
        made.append(replace(placed, entry=robot))
    return made


def _items(entries: Any, path: KeyPath = ()) -> list[tuple[KeyPath, Any]]:
    """Entries and their places: those of a list, or the only one."""
    if isinstance(entries, list):
        return [((*path, at), each) for at, each in enumerate(entries)]
    return [(path, entries)]


class _Folders:
    """Reads the folders beside fleet.yml and notes every file that is read."""

    def __init__(
        self,
        document: Document,
        sources: list[Path],
        problems: list[Finding],
        profiles: dict[str, Profile],
    ) -> None:
        self._document = document
        self._sources = sources
        self._problems = problems
        self._profiles = profiles

    def entries(self, key: str, default: str, kind: type[T]) -> list[Placed[T]]:
        """The entries of all files of the folder that `key` names, in the order of the files."""
        name = self._document.data.get(key)
        if not isinstance(name, str | None):
            return []  # a problem already
        folder = self._document.path.parent / (name or default)
        self._sources.append(folder)
        if name and not folder.is_dir():
            what, remedy = f"{folder} is not a folder", "create it, or name one that exists"
            self._problems.append(self._document.problem((key,), what, remedy))
            return []
        return [entry for file in self._files(folder) for entry in self._read(file, kind)]

    def _files(self, folder: Path) -> list[Path]:
        try:
            listed = sorted(folder.iterdir())
        except FileNotFoundError:
            return []
        except OSError as error:
            what, remedy = f"cannot be read ({error.strerror})", "let this user read the folder"
            self._problems.append(Finding(folder, None, "", what, remedy))
            return []
        # Editors use hidden names until a file is complete.
        return [
            file for file in listed if file.suffix in _SUFFIXES and not file.name.startswith(".")
        ]

    def _read(self, file: Path, kind: type[T]) -> list[Placed[T]]:
        document, found = read(file)
        if document is None and not os.path.lexists(file):
            return []  # deleted since the listing
        self._sources.append(file)
        self._problems.extend(found)
        if document is None:
            return []
        items = _items(document.data)
        return validate(document, items, kind, self._problems, self._profiles)
