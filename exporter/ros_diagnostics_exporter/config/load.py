"""fleet.yml and its folders -> one frozen Fleet, or one error with everything that is wrong.

Every call reads all files; nothing is cached.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, TypeVar

from ros_diagnostics_exporter.config.capabilities import wrong_names
from ros_diagnostics_exporter.config.errors import (
    LISTED,
    ConfigError,
    Finding,
    quoted,
    shortened,
    suggestion,
)
from ros_diagnostics_exporter.config.fleet import (
    ALL,
    DEFAULT,
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
from ros_diagnostics_exporter.config.keys import Entry, validated
from ros_diagnostics_exporter.config.lint import lint
from ros_diagnostics_exporter.config.shard import Shard
from ros_diagnostics_exporter.config.validate import (
    Checked,
    Placed,
    find_conflicts,
    find_unreached,
    validate,
)
from ros_diagnostics_exporter.config.yaml_file import Document, KeyPath, read
from ros_diagnostics_exporter.durations import written

# Seconds within which exporters tell one another what they count: by two scrapes, and two looks.
TOLD_WITHIN = 8.0
_SUFFIXES = (".yml", ".yaml")
_Content = Mapping[str, Any]  # of a profile, as it is in the file
_LISTS = ("robots", "discovery", "shared", "maintenance", "queries")
# Sections that may be in a folder, too: the key `robots_folder` names another one, and so on.
FOLDERS = {"robots": "robots.d", "maintenance": "maintenance.d", "queries": "queries.d"}

T = TypeVar("T", bound=Entry)


def load(path: Path, shard: Shard | None = None) -> Fleet:
    """Read fleet.yml at `path` and the folders that it names; of several exporters one's part.

    Raises:
        ConfigError: the config cannot be used; its text has one line for each problem.
    """
    document, problems = read(path)
    sources = [path]
    fleet = _fleet(_Reading(document, sources, problems), shard) if document else None
    if problems or fleet is None:
        raise ConfigError(problems, sources)
    fleet = replace(fleet, sources=tuple(sources))
    return fleet if shard is None else fleet.part(shard)


def _unfit_for_shards(
    document: Document, top: Fleet, profiles: Mapping[str, Profile]
) -> Iterator[Finding]:
    """What one exporter alone can do: of several each knows late, or not, of the others' robots."""
    if top.capabilities:
        what = "need all robots, and --shard gives each exporter a part of them"
        remedy = "run one exporter without --shard, or remove them"
        yield document.problem(("capabilities",), what, remedy)
    for name, profile in profiles.items():
        if profile.confirm_after < TOLD_WITHIN:
            what = (
                f"is {written(profile.confirm_after)}, before exporters with --shard know what the "
                "others count: a silent site would be a fault of each robot"
            )
            remedy = f"make it {written(TOLD_WITHIN)} or longer; that of a component may be shorter"
            yield document.problem(("profiles", name, "confirm_after"), what, remedy)


def files_of(folder: Path) -> list[Path]:
    """The files of a folder of the config, in order; none where there is no folder.

    Raises:
        OSError: it cannot be read.
    """
    try:
        listed = sorted(folder.iterdir())
    except FileNotFoundError:
        return []
    # Editors use hidden names until a file is complete.
    return [each for each in listed if each.suffix in _SUFFIXES and not each.name.startswith(".")]


def _fleet(reading: _Reading, shard: Shard | None) -> Fleet | None:
    """The Fleet that fleet.yml and its folders describe; problems are added to the reading's."""
    document, problems = reading.document, reading.problems
    if not isinstance(document.data, dict):
        what = "is empty" if document.data is None else "is not a mapping"
        problems.append(document.problem((), what, "start it with fleet: and a name"))
        return None
    valid = validate(document, [((), _without_sections(document.data))], Fleet, problems)
    top = valid[0].entry if valid else None
    stale_is_critical = top is not None and top.stale_is_critical
    known = len(problems)
    own, profiles = resolved(document, problems, stale_is_critical=stale_is_critical)
    profiles_valid = len(problems) == known
    checked = _checked(replace(reading, profiles=profiles), own)
    problems.extend(find_conflicts(checked, top.limits if top else Limits(), shard))
    if top is None:
        return None
    # In place of a profile that is not valid there is one without capabilities.
    if top.capabilities and profiles_valid:
        of_robots = {name for each in profiles.values() for name in each.capabilities}
        for name, what, remedy in wrong_names(top.capabilities, of_robots=of_robots):
            problems.append(document.problem(("capabilities", name), what, remedy))
    if shard is not None:
        problems.extend(_unfit_for_shards(document, top, profiles))
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


def _checked(reading: _Reading, profiles: list[Placed[Profile]]) -> Checked:
    shared = reading.entries("shared", Shared)
    return Checked(
        document=reading.document,
        profiles=profiles,
        robots=_on_shared_topics(reading.entries("robots", Robot), shared),
        discovery=reading.entries("discovery", Discovery),
        shared=shared,
        maintenance=reading.entries("maintenance", Maintenance),
        queries=reading.entries("queries", Query),
    )


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


@dataclass(frozen=True)
class _Reading:
    """fleet.yml as it is read: which files and folders were, and what is wrong with them."""

    document: Document
    sources: list[Path]
    problems: list[Finding]
    profiles: Mapping[str, Profile] = field(default_factory=dict)

    def entries(self, section: str, kind: type[T]) -> list[Placed[T]]:
        """The valid entries of a list, then those of the files of its folder, in their order."""
        listed = self.document.data.get(section)
        items = _items(listed, (section,)) if isinstance(listed, list) else []
        found = validate(self.document, items, kind, self.problems, self.profiles)
        for file in self._files(section) if section in FOLDERS else ():
            document, problems = read(file)
            if document is None and not os.path.lexists(file):
                continue  # deleted since the listing
            self.sources.append(file)
            self.problems.extend(problems)
            if document is not None:
                items = _items(document.data)
                found += validate(document, items, kind, self.problems, self.profiles)
        return found

    def _files(self, section: str) -> list[Path]:
        key = f"{section}_folder"
        name = self.document.data.get(key)
        if not isinstance(name, str | None):
            return []  # a problem already
        folder = self.document.path.parent / (name or FOLDERS[section])
        self.sources.append(folder)
        if name and not folder.is_dir():
            what, remedy = f"{folder} is not a folder", "create it, or name one that exists"
            self.problems.append(self.document.problem((key,), what, remedy))
            return []
        try:
            return files_of(folder)
        except OSError as error:
            what, remedy = f"cannot be read ({error.strerror})", "let this user read the folder"
            self.problems.append(Finding(folder, None, "", what, remedy))
            return []


# -- profiles that extend one another -------------------------------------------------------------


def resolved(
    document: Document, problems: list[Finding], *, stale_is_critical: bool
) -> tuple[list[Placed[Profile]], dict[str, Profile]]:
    """(The valid entries of the file, every profile by name, `default` always among them).

    What cannot be resolved is added to `problems`; in its place there is the default.
    """
    found = document.data.get("profiles")
    given = found if isinstance(found, dict) else {}
    items = [(("profiles", name), {} if each is None else each) for name, each in given.items()]
    entries = validate(document, items, Profile, problems)
    base = {"stale_is_critical": stale_is_critical, "checks": {ALL: {}}}
    by_name = {str(each.path[-1]): each for each in entries}
    resolver = _Resolver(by_name, sorted({*given, DEFAULT}), base, problems)
    made = {
        name: resolver.content(name) if name in by_name else base
        for name in dict.fromkeys((DEFAULT, *given))
    }
    default = Profile(stale_is_critical=stale_is_critical)
    profiles = {
        name: default if each is None else replace(validated(Profile, each), name=name)
        for name, each in made.items()
    }
    problems.extend(_wrong_names(profiles, by_name))
    return entries, profiles


def _wrong_names(
    profiles: Mapping[str, Profile], entries: Mapping[str, Placed[Profile]]
) -> Iterator[Finding]:
    """Names in capabilities that are not there, and circles; one that is inherited, once."""
    found = [
        (entries[name], each)
        for name, profile in profiles.items()
        if name in entries
        for each in wrong_names(profile.capabilities, [each.name for each in profile.checks])
    ]
    own = [each for each in found if each[1][0] in (each[0].data.get("capabilities") or ())]
    known = {each[:2] for _, each in own}
    for placed, (capability, what, remedy) in own:
        yield placed.problem("capabilities", capability, what=what, remedy=remedy)
    for placed, each in found:
        if each[:2] not in known:
            what = f"capability {quoted(each[0])}, which is inherited: {each[1]}"
            yield placed.problem("capabilities", what=what, remedy=each[2])


@dataclass(frozen=True)
class _Resolver:
    """Merges profiles, each into the one that it extends."""

    entries: Mapping[str, Placed[Profile]]
    known: list[str]  # also those that are invalid
    base: _Content
    problems: list[Finding]
    made: dict[str, _Content | None] = field(default_factory=dict)  # None: invalid

    def content(self, name: str, above: tuple[str, ...] = ()) -> _Content | None:
        """The merged content of a profile; `above` are the profiles that extend it."""
        if name not in self.made:
            placed = self.entries[name]
            parent = self._parent(name, placed, (*above, name))
            self.made[name] = None if parent is None else self._merged(parent, placed)
        return self.made[name]

    def _parent(
        self, name: str, placed: Placed[Profile], above: tuple[str, ...]
    ) -> _Content | None:
        wanted = placed.entry.extends
        if name == DEFAULT:
            if placed.data.get("extends"):
                what = "the profile default cannot extend another"
                self.problems.append(placed.problem("extends", what=what, remedy="remove extends"))
            return self.base
        if wanted in above:
            way = " -> ".join((*above[above.index(wanted) :], wanted))
            what = f"extends in a circle ({way})"
            self.problems.append(placed.problem("extends", what=what, remedy="remove one extends"))
            return None
        if wanted in self.entries:
            return self.content(wanted, above)
        if wanted not in self.known:
            what = f"there is no profile {quoted(wanted)}"
            remedy = suggestion(wanted, self.known)
            self.problems.append(placed.problem("extends", what=what, remedy=remedy))
            return None
        return self.base if wanted == DEFAULT else None

    def _merged(self, parent: _Content, placed: Placed[Profile]) -> _Content:
        """A profile's own content over that of the profile that it extends."""
        own = {key: each for key, each in placed.data.items() if each is not None}
        merged = {**parent, **own}
        for key in ("checks", "capabilities"):
            merged[key] = self._added(key, parent.get(key, {}), own.get(key, {}), placed)
        for key in ("components", "values", "actions"):  # the first match wins
            merged[key] = [*own.get(key, []), *parent.get(key, [])]
        topics = own.get("topics", [])
        replaced = {each.get("component") for each in topics}
        inherited = parent.get("topics", [])
        merged["topics"] = [*topics, *(e for e in inherited if e.get("component") not in replaced)]
        return merged

    def _added(
        self, key: str, inherited: _Content, given: _Content, placed: Placed[Profile]
    ) -> _Content:
        """The inherited ones with a profile's own added, replaced and (null) removed."""
        both = {**inherited, **given}
        removed = [name for name, each in given.items() if each is None]
        for name in removed:
            del both[name]
            if name not in inherited:
                what = "is removed (null), but no profile that is extended has it"
                remedy = suggestion(name, [each for each in both if each != ALL])
                self.problems.append(placed.problem(key, name, what=what, remedy=remedy))
        has_words = any(each.patterns for each in placed.entry.checks if each.name == ALL)
        if key == "checks" and (ALL in removed or has_words):
            what = "cannot be removed or narrowed: the check all contains all components"
            self.problems.append(placed.problem(key, ALL, what=what, remedy="use another name"))
        return both
