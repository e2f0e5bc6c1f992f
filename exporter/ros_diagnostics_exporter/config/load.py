"""fleet.yml and its folders -> one frozen Fleet, or one error with everything that is wrong.

Every call reads all files; nothing is cached.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from ros_diagnostics_exporter.config.errors import ConfigError, Problem
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.models import Entry, MaintenanceEntry, RobotEntry
from ros_diagnostics_exporter.config.resolve import resolve
from ros_diagnostics_exporter.config.validate import Checked, Placed, fleet_file, folder_file
from ros_diagnostics_exporter.config.yaml_file import Document, read

_SUFFIXES = (".yml", ".yaml")

T = TypeVar("T", bound=Entry)


def load(path: Path) -> Fleet:
    """Read fleet.yml at `path` and the folders that it names.

    Raises:
        ConfigError: the config cannot be used; its text has one line for each problem.
    """
    problems: list[Problem] = []
    sources_read = [path]
    checked = _read(path, sources_read, problems)
    fleet = resolve(checked, problems) if checked else None
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


def _read(path: Path, sources_read: list[Path], problems: list[Problem]) -> Checked | None:
    document, found = read(path)
    problems.extend(found)
    checked = fleet_file(document, problems) if document else None
    if checked is None:
        return None
    folders = _Folders(checked.document, sources_read, problems)
    checked.robots += folders.entries("robots_folder", "robots.d", RobotEntry)
    checked.maintenance += folders.entries("maintenance_folder", "maintenance.d", MaintenanceEntry)
    return checked


class _Folders:
    """Reads the folders beside fleet.yml and notes every file that is read."""

    def __init__(self, document: Document, sources: list[Path], problems: list[Problem]) -> None:
        self._document = document
        self._sources = sources
        self._problems = problems

    def entries(self, key: str, default: str, model: type[T]) -> list[Placed[T]]:
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
        return [entry for file in self._files(folder) for entry in self._read(file, model)]

    def _files(self, folder: Path) -> list[Path]:
        try:
            listed = sorted(folder.iterdir())
        except FileNotFoundError:
            return []
        except OSError as error:
            what, remedy = f"cannot be read ({error.strerror})", "let this user read the folder"
            self._problems.append(Problem(folder, None, "", what, remedy))
            return []
        # Editors use hidden names until a file is complete.
        return [
            file for file in listed if file.suffix in _SUFFIXES and not file.name.startswith(".")
        ]

    def _read(self, file: Path, model: type[T]) -> list[Placed[T]]:
        document, found = read(file)
        if document is None and not os.path.lexists(file):
            return []  # deleted since the listing
        self._sources.append(file)
        self._problems.extend(found)
        return folder_file(document, model, self._problems) if document else []
