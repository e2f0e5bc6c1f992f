"""fleet.yml and its folders -> one frozen Fleet, or one error with all that is wrong.

Every call reads everything afresh; nothing is kept between two of them.
"""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from ros_diagnostics_exporter.config.errors import ConfigError, Problem
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.model import MaintenanceEntry
from ros_diagnostics_exporter.config.model_base import Entry
from ros_diagnostics_exporter.config.model_robot import RobotEntry
from ros_diagnostics_exporter.config.resolve import resolve
from ros_diagnostics_exporter.config.validate import Checked, Placed, fleet_file, folder_file
from ros_diagnostics_exporter.config.yamlfile import Document, read

_SUFFIXES = (".yml", ".yaml")

T = TypeVar("T", bound=Entry)


def load(path: Path) -> Fleet:
    """Read fleet.yml at `path` and the folders that it names.

    Raises:
        ConfigError: the config cannot be used; its text has one line for each problem.
    """
    problems: list[Problem] = []
    looked_at = [path]
    checked = _read(path, looked_at, problems)
    fleet = resolve(checked, problems) if checked else None
    if problems or fleet is None:
        raise ConfigError(problems, looked_at)
    return replace(fleet, sources=tuple(looked_at))


def sources(fleet_or_path: Fleet | Path) -> tuple[Path, ...]:
    """The files and folders that make a Fleet; a change of any of them may change it.

    Folders are among them also before they exist. For a path everything is read, and a config
    that cannot be used still names what was looked at.
    """
    if isinstance(fleet_or_path, Fleet):
        return fleet_or_path.sources
    try:
        return load(fleet_or_path).sources
    except ConfigError as error:
        return error.sources


def _read(path: Path, looked_at: list[Path], problems: list[Problem]) -> Checked | None:
    document, found = read(path)
    problems.extend(found)
    checked = fleet_file(document, problems) if document else None
    if checked is None:
        return None
    folders = _Folders(checked.document, looked_at, problems)
    checked.robots += folders.entries("robots_folder", "robots.d", RobotEntry)
    checked.maintenance += folders.entries("maintenance_folder", "maintenance.d", MaintenanceEntry)
    return checked


class _Folders:
    """The folders beside fleet.yml; every file that is looked at is noted."""

    def __init__(self, document: Document, looked_at: list[Path], problems: list[Problem]) -> None:
        self._document = document
        self._looked_at = looked_at
        self._problems = problems

    def entries(self, key: str, default: str, model: type[T]) -> list[Placed[T]]:
        """The entries of all files of the folder that `key` names, in the order of the files."""
        said = self._document.data.get(key)
        if not isinstance(said, str | None):
            return []  # and told already
        folder = self._document.path.parent / (said or default)
        self._looked_at.append(folder)
        if said and not folder.is_dir():
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
        # Editors and careful writers use hidden names until a file is complete.
        return [
            file for file in listed if file.suffix in _SUFFIXES and not file.name.startswith(".")
        ]

    def _read(self, file: Path, model: type[T]) -> list[Placed[T]]:
        document, found = read(file)
        if document is None and not os.path.lexists(file):
            return []  # left between the listing and now
        self._looked_at.append(file)
        self._problems.extend(found)
        return folder_file(document, model, self._problems) if document else []
