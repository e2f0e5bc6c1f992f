"""A document -> validated entries, each with its place; or problems, all of them.

Entries are validated one by one, so that a bad robot does not hide what is wrong with the next.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

from pydantic import ValidationError

from ros_diagnostics_exporter.config.errors import MOST, Finding, explanation, quoted
from ros_diagnostics_exporter.config.fleet import (
    Discovery,
    Limits,
    Maintenance,
    Profile,
    Query,
    Robot,
    Shared,
    Source,
)
from ros_diagnostics_exporter.config.keys import Entry, validated
from ros_diagnostics_exporter.config.shard import Shard
from ros_diagnostics_exporter.config.yaml_file import Document, KeyPath
from ros_diagnostics_exporter.model import Domain, place

T = TypeVar("T", bound=Entry)


@dataclass(frozen=True)
class Placed(Generic[T]):
    """A validated entry and its place in the file."""

    document: Document
    path: KeyPath
    data: Any  # as it is in the file
    entry: T

    def problem(self, *below: str | int, what: str, remedy: str) -> Finding:
        """A problem with this entry, or with what is `below` it."""
        return self.document.problem((*self.path, *below), what, remedy)

    def place(self) -> str:
        """The line where the entry begins: `fleet.yml:7`."""
        return f"{self.document.path}:{self.document.line(self.path)}"


def validate(
    document: Document,
    items: Iterable[tuple[KeyPath, Any]],
    kind: type[T],
    problems: list[Finding],
    profiles: Mapping[str, Profile] | None = None,
) -> list[Placed[T]]:
    """The valid ones among items with their places; what is wrong is added to `problems`.

    `profiles` are those that they may name.
    """
    found = []
    for path, data in items:
        try:
            found.append(Placed(document, path, data, validated(kind, data, profiles)))
        except ValidationError as error:  # noqa: PERF203 - each has its own errors
            wrong = error.errors(include_url=False)[: max(0, MOST - len(problems))]
            explained = (explanation(each, kind) for each in wrong)
            problems += (
                document.problem((*path, *below), what, remedy)
                for below, what, remedy in explained
                if (*path, *below) not in document.invalid
            )
    return found


@dataclass
class Checked:
    """The valid entries of fleet.yml and its folders."""

    document: Document
    profiles: list[Placed[Profile]]
    robots: list[Placed[Robot]]
    discovery: list[Placed[Discovery]]
    shared: list[Placed[Shared]]
    maintenance: list[Placed[Maintenance]]
    queries: list[Placed[Query]]

    @property
    def entries(self) -> list[Placed[Any]]:
        """All that robots are of."""
        return [*self.robots, *self.discovery, *self.shared]


MAX_QUERIES = 100  # each has a thread
_WAY_OUT = (
    "give it a namespace or domain_id of its own, or list the topic in shared and name it as topic"
)


def find_conflicts(
    checked: Checked, limits: Limits, shard: Shard | None = None
) -> Iterator[Finding]:
    """Names and topics that are used twice, more robots or queries than the limit."""
    what = "the name {1} is already used by the robot in {0}"
    yield from _twice(checked.robots, "name", what, "give each robot a name of its own")
    yield from _same_topics(checked)
    yield from _same_namespaces(checked)
    what = "the query in {0} already has components {1}"
    remedy = "give it another component or group, or join the two expressions by or"
    yield from _twice(checked.queries, "component", what, remedy)
    yield from _uplinks_in_circles(checked.robots)
    if len(checked.queries) > MAX_QUERIES:
        what = f"{len(checked.queries)} queries are declared, above the limit of {MAX_QUERIES}"
        yield checked.document.problem(("queries",), what, "have one expression for all robots")
    number = sum(shard is None or shard.has(each.entry.name) for each in checked.robots)
    if number > limits.robots:
        what = f"{number} robots are declared, above the limit of {limits.robots}"
        yield checked.document.problem(("limits", "robots"), what, "raise limits.robots")


def find_unreached(checked: Checked) -> Iterator[Finding]:
    """Entries that need zenoh; of a config that does not say how to reach it."""
    for placed in checked.entries:
        if placed.entry.zenoh is not None:
            remedy = "add zenoh: {routers: [tcp/centre:7447]} to the file"
            yield placed.problem(
                "zenoh", what="the file does not say how to reach it", remedy=remedy
            )


def _twice(entries: Iterable[Placed[Any]], key: str, what: str, remedy: str) -> Iterator[Finding]:
    """Entries that have the name, {1}, of one before, which is in the line {0}."""
    first: dict[str, Placed[Any]] = {}
    for placed in entries:
        name = placed.entry.name
        other = first.setdefault(name, placed)
        if other is not placed:
            yield placed.problem(key, what=what.format(other.place(), quoted(name)), remedy=remedy)


def _uplinks_in_circles(robots: list[Placed[Robot]]) -> Iterator[Finding]:
    """Each of a circle would be unreachable because of the others, and none of them a fault."""
    uplinks = {each.entry.name: each.entry.labels.get("uplink") for each in robots}
    for placed in robots:
        path = [placed.entry.name]
        while (uplink := uplinks.get(path[-1])) and uplink not in path:
            path.append(uplink)
        if uplink == path[0]:
            what = f"is reached through itself: {' -> '.join(map(quoted, [*path, uplink]))}"
            yield placed.problem("labels", "uplink", what=what, remedy="remove one of them")


def _same_topics(checked: Checked) -> Iterator[Finding]:
    users: dict[tuple[Domain, str], str] = {}
    for each in checked.shared:
        key = (each.entry.domain_id, each.entry.topic)
        if key in users:
            what = f"topic {each.entry.topic} of {place(each.entry.domain_id)} is shared twice"
            yield each.problem("topic", what=what, remedy="keep one of the two")
        users[key] = f"declared as shared in {each.place()}"
    all_shared = set(users)
    for placed in checked.robots:
        robot = placed.entry
        if (robot.domain_id, robot.topic) in all_shared:
            yield from _other_source(placed)
            continue  # one of several robots on the topic
        for name in filter(None, (robot.topic_agg, robot.topic_raw)):
            key = (robot.domain_id, name)
            if key in users:
                what = f"topic {name} of {place(robot.domain_id)} is {users[key]}"
                yield placed.problem(what=what, remedy=_WAY_OUT)
                break
            users[key] = f"that of robot {quoted(robot.name)} in {placed.place()}"


def _same_namespaces(checked: Checked) -> Iterator[Finding]:
    """Robots of which one has no diagnostics: only their namespaces tell their topics apart."""
    users: dict[tuple[Domain, str], Placed[Robot]] = {}
    for placed in checked.robots:
        robot = placed.entry
        other = (
            users.setdefault((robot.domain_id, robot.namespace), placed) if robot.in_ros else placed
        )
        sources = {robot.source, other.entry.source}
        if other is not placed and sources & {Source.NONE, Source.QUERIES}:
            where = f"namespace {robot.namespace or '/'} of {place(robot.domain_id)}"
            what = f"{where} is that of robot {quoted(other.entry.name)} in {other.place()}"
            yield placed.problem(what=what, remedy="give it a namespace or domain_id of its own")


def _other_source(placed: Placed[Robot]) -> Iterator[Finding]:
    """A robot on a shared topic has the topic's source."""
    robot, source = placed.entry, placed.data.get("source")
    if source is not None and source != robot.source.value:
        what = f"the shared topic {robot.topic} is {robot.source.value}, not {source}"
        yield placed.problem("source", what=what, remedy="remove source")
