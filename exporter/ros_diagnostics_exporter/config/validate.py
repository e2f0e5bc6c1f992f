"""A document -> validated entries, each with its place; or problems, all of them.

Entries are validated one by one, so that a bad robot does not hide what is wrong with the next.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from pydantic import ValidationError

from ros_diagnostics_exporter.config.errors import MOST, Problem, explanation, quoted
from ros_diagnostics_exporter.config.fleet import Limits, Robot, Shared
from ros_diagnostics_exporter.config.models import (
    DiscoveryEntry,
    Entry,
    FleetFile,
    MaintenanceEntry,
    ProfileEntry,
    RobotEntry,
    SharedEntry,
)
from ros_diagnostics_exporter.config.yaml_file import Document, KeyPath

T = TypeVar("T", bound=Entry)


@dataclass(frozen=True)
class Placed(Generic[T]):
    """A validated entry and its place in the file."""

    document: Document
    path: KeyPath
    entry: T

    def problem(self, *below: str | int, what: str, remedy: str) -> Problem:
        """A problem with this entry, or with what is `below` it."""
        return self.document.problem((*self.path, *below), what, remedy)

    def place(self) -> str:
        """The line where the entry begins: `fleet.yml:7`."""
        return f"{self.document.path}:{self.document.line(self.path)}"


@dataclass
class Checked:
    """The valid entries of fleet.yml and its folders; `fleet` is None if its own keys are invalid.

    `fleet` has none of the sections that are fields here. The last part of a profile's path is its
    name.
    """

    document: Document
    fleet: FleetFile | None
    robots: list[Placed[RobotEntry]]
    discovery: list[Placed[DiscoveryEntry]]
    shared: list[Placed[SharedEntry]]
    profiles: list[Placed[ProfileEntry]]
    maintenance: list[Placed[MaintenanceEntry]]

    def profile_names(self) -> frozenset[str]:
        """The names of all profiles in the file, also of invalid ones."""
        named = self.document.data.get("profiles")
        return frozenset(named) if isinstance(named, dict) else frozenset()


def fleet_file(document: Document, problems: list[Problem]) -> Checked | None:
    """Validate the main file; problems are added to `problems`. None if the file is empty."""
    if not isinstance(document.data, dict):
        what = "is empty" if document.data is None else "is not a mapping"
        problems.append(document.problem((), what, "start it with fleet: and a name"))
        return None
    rest = dict(document.data)

    def section(name: str, model: type[T]) -> list[Placed[T]]:
        """Move a section out of `rest`, if it has the right form, and validate its entries."""
        entries = rest.get(name)
        if isinstance(entries, list) and model is not ProfileEntry:
            rest[name] = []
            items: list[tuple[str | int, Any]] = list(enumerate(entries))
        elif isinstance(entries, dict) and model is ProfileEntry:
            rest[name] = {key: {} for key in entries}  # the names are validated with the rest
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
    """Validate a file of a folder: one entry, or a list of them."""
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
            below, what, remedy = explanation(each, model)
            where = (*path, *below)
            if where not in document.invalid:
                problems.append(document.problem(where, what, remedy))
        return None


_WAY_OUT = (
    "give it a namespace or domain_id of its own, or list the topic in shared and name it as topic"
)


def find_conflicts(
    checked: Checked,
    robots: tuple[Robot, ...],
    shared: tuple[Shared, ...],
    problems: list[Problem],
) -> None:
    """Find robots with the same name, topics that are used twice, more robots than the limit.

    `robots` and `shared` are made of the entries in `checked`, in the same order.
    """
    problems.extend(_same_names(checked.robots))
    problems.extend(_same_topics(checked, robots, shared))
    limits = checked.fleet.limits if checked.fleet else None
    limit = (limits and limits.robots) or Limits.robots
    if len(robots) > limit:
        what = f"{len(robots)} robots are declared, above the limit of {limit}"
        remedy = "raise limits.robots"
        problems.append(checked.document.problem(("limits", "robots"), what, remedy))


def _same_names(robots: list[Placed[RobotEntry]]) -> Iterator[Problem]:
    first: dict[str, Placed[RobotEntry]] = {}
    for placed in robots:
        name = placed.entry.name
        other = first.setdefault(name, placed)
        if other is not placed:
            what = f"the name {quoted(name)} is already used by the robot in {other.place()}"
            yield placed.problem("name", what=what, remedy="give each robot a name of its own")


def _same_topics(
    checked: Checked, robots: tuple[Robot, ...], shared: tuple[Shared, ...]
) -> Iterator[Problem]:
    users: dict[tuple[int, str], str] = {}
    for on_topic, topic in zip(checked.shared, shared, strict=True):
        key = (topic.domain_id, topic.topic)
        if key in users:
            what = f"topic {topic.topic} of domain {topic.domain_id} is shared twice"
            yield on_topic.problem("topic", what=what, remedy="keep one of the two")
        users[key] = f"declared as shared in {on_topic.place()}"
    all_shared = set(users)
    for placed, robot in zip(checked.robots, robots, strict=True):
        if (robot.domain_id, placed.entry.topic) in all_shared:
            yield from _other_source(placed, robot)
            continue  # one of several robots on the topic
        for name in filter(None, (robot.topic_agg, robot.topic_raw)):
            key = (robot.domain_id, name)
            if key in users:
                what = f"topic {name} of domain {robot.domain_id} is {users[key]}"
                yield placed.problem(what=what, remedy=_WAY_OUT)
                break
            users[key] = f"that of robot {quoted(robot.name)} in {placed.place()}"


def _other_source(placed: Placed[RobotEntry], robot: Robot) -> Iterator[Problem]:
    """A robot on a shared topic has the topic's source."""
    source = placed.entry.source
    if source is not None and source != robot.source.value:
        what = f"the shared topic {placed.entry.topic} is {robot.source.value}, not {source}"
        yield placed.problem("source", what=what, remedy="remove source")
