"""What fleet.yml and its folders say of one robot, as one file that judges it again."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

from ros_diagnostics_exporter.config.load import FOLDERS, files_of
from ros_diagnostics_exporter.config.yaml_file import read


def config_lines(config_file: Path, robot: str) -> str:
    """All but the entries of other robots; a comment where it cannot be read."""
    try:
        document, _problems = read(config_file)
        if document is None or not isinstance(document.data, dict):
            return f"# {config_file.name} cannot be read\n"
        found = dict(document.data)
        for section, default in FOLDERS.items():
            folder = config_file.parent / (found.pop(f"{section}_folder", None) or default)
            entries = [*_listed(found.pop(section, None)), *_of_folder(folder)]
            if section == "robots":
                entries = [each for each in entries if _name(each) == robot]
            if entries:
                found[section] = entries
    except (OSError, TypeError) as error:
        return f"# {config_file.name} cannot be read: {type(error).__name__}\n"
    return str(yaml.safe_dump(found, allow_unicode=True, sort_keys=False))


def _of_folder(folder: Path) -> Iterator[Any]:
    for file in files_of(folder):
        document, _problems = read(file)
        if document is not None:
            yield from _listed(document.data)


def _listed(entries: Any) -> list[Any]:
    """Entries as a list: a file of a folder may have one alone."""
    if entries is None:
        return []
    return list(entries) if isinstance(entries, list) else [entries]


def _name(entry: Any) -> Any:
    return entry.get("name") if isinstance(entry, dict) else None
