"""A document and its models -> checked entries, each with its place; or problems, all of them.

Entries are checked one by one, so that a bad robot does not hide what is wrong with the next.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from pydantic import ValidationError

from ros_diagnostics_exporter.config.errors import MOST, Problem
from ros_diagnostics_exporter.config.model import FleetFile, MaintenanceEntry
from ros_diagnostics_exporter.config.model_base import Entry
from ros_diagnostics_exporter.config.model_profile import ProfileEntry
from ros_diagnostics_exporter.config.model_robot import DiscoveryEntry, RobotEntry, SharedEntry
from ros_diagnostics_exporter.config.translate import told
from ros_diagnostics_exporter.config.yamlfile import Document
from ros_diagnostics_exporter.config.yamltree import KeyPath

T = TypeVar("T", bound=Entry)


@dataclass(frozen=True)
class Placed(Generic[T]):
    """A checked entry and where it stands."""

    document: Document
    path: KeyPath
    entry: T

    def problem(self, *below: str | int, what: str, remedy: str) -> Problem:
        """A problem with this entry, or with what is `below` it."""
        return self.document.problem((*self.path, *below), what, remedy)

    def place(self) -> str:
        """Where the entry begins, `fleet.yml:7`."""
        return f"{self.document.path}:{self.document.line(self.path)}"


@dataclass
class Checked:
    """What is usable of fleet.yml and its folders; `fleet` is None where its own keys are not.

    `fleet` has none of the sections that stand here beside it. The last part of a profile's path
    is its name.
    """

    document: Document
    fleet: FleetFile | None
    robots: list[Placed[RobotEntry]]
    discovery: list[Placed[DiscoveryEntry]]
    shared: list[Placed[SharedEntry]]
    profiles: list[Placed[ProfileEntry]]
    maintenance: list[Placed[MaintenanceEntry]]

    def profile_names(self) -> frozenset[str]:
        """Every profile that the file names, also those that are not usable."""
        named = self.document.data.get("profiles")
        return frozenset(named) if isinstance(named, dict) else frozenset()


def fleet_file(document: Document, problems: list[Problem]) -> Checked | None:
    """Check the main file; what is wrong is added to `problems`. None if there is nothing in it."""
    if not isinstance(document.data, dict):
        what = "is empty" if document.data is None else "is not a mapping"
        problems.append(document.problem((), what, "begin it with fleet: and a name"))
        return None
    rest = dict(document.data)

    def section(name: str, model: type[T]) -> list[Placed[T]]:
        """Takes a section out of `rest`, if it has the right form, and checks its entries."""
        entries = rest.get(name)
        if isinstance(entries, list) and model is not ProfileEntry:
            rest[name] = []
            items: list[tuple[str | int, Any]] = list(enumerate(entries))
        elif isinstance(entries, dict) and model is ProfileEntry:
            rest[name] = {key: {} for key in entries}  # the names are checked with the rest
            items = [(key, {} if value is None else value) for key, value in entries.items()]
        else:
            return []
        return _entries(document, [((name, at), item) for at, item in items], model, problems)

    checked = Checked(
        document,
        None,
        section("robots", RobotEntry),
        section("discovery", DiscoveryEntry),
        section("shared", SharedEntry),
        section("profiles", ProfileEntry),
        section("maintenance", MaintenanceEntry),
    )
    top = _entries(document, [((), rest)], FleetFile, problems)
    checked.fleet = top[0].entry if top else None
    return checked


def folder_file(document: Document, model: type[T], problems: list[Problem]) -> list[Placed[T]]:
    """Check a file of a folder: one entry, or a list of them."""
    data = document.data
    items: list[tuple[KeyPath, Any]] = [((), data)]
    if isinstance(data, list):
        items = [((at,), item) for at, item in enumerate(data)]
    return _entries(document, items, model, problems)


def _entries(
    document: Document,
    items: list[tuple[KeyPath, Any]],
    model: type[T],
    problems: list[Problem],
) -> list[Placed[T]]:
    found = (_entry(document, path, data, model, problems) for path, data in items)
    return [placed for placed in found if placed is not None]


def _entry(
    document: Document, path: KeyPath, data: Any, model: type[T], problems: list[Problem]
) -> Placed[T] | None:
    try:
        return Placed(document, path, model.model_validate(data))
    except ValidationError as error:
        for each in error.errors(include_url=False)[: max(0, MOST - len(problems))]:
            below, what, remedy = told(each, model)
            where = (*path, *below)
            if where not in document.marred:
                problems.append(document.problem(where, what, remedy))
        return None
