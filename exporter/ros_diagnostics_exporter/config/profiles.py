"""Profiles of fleet.yml, which extend one another -> profiles with everything filled in."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from ros_diagnostics_exporter.config.capabilities import wrong_names
from ros_diagnostics_exporter.config.errors import Finding, quoted, suggestion
from ros_diagnostics_exporter.config.fleet import ALL, DEFAULT, Profile
from ros_diagnostics_exporter.config.keys import validated
from ros_diagnostics_exporter.config.validate import Placed, validate
from ros_diagnostics_exporter.config.yaml_file import Document

_Content = Mapping[str, Any]  # of a profile, as it is in the file


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
    resolver = _Resolver({str(each.path[-1]): each for each in entries}, {*given, DEFAULT}, base)
    made = {
        name: resolver.content(name) if name in resolver.entries else base
        for name in dict.fromkeys((DEFAULT, *given))
    }
    problems.extend(resolver.problems)
    default = Profile(stale_is_critical=stale_is_critical)
    profiles = {
        name: default if each is None else replace(validated(Profile, each), name=name)
        for name, each in made.items()
    }
    problems.extend(_wrong_names(profiles, resolver.entries))
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


class _Resolver:
    """Merges profiles, each into the one that it extends."""

    def __init__(
        self, entries: Mapping[str, Placed[Profile]], known: Iterable[str], base: _Content
    ) -> None:
        self.entries = entries
        self.problems: list[Finding] = []
        self._known = sorted(known)  # also those that are invalid
        self._base = base
        self._made: dict[str, _Content | None] = {}  # None: invalid, with a problem

    def content(self, name: str, above: tuple[str, ...] = ()) -> _Content | None:
        """The merged content of a profile; `above` are the profiles that extend it."""
        if name not in self._made:
            placed = self.entries[name]
            parent = self._parent(name, placed, (*above, name))
            self._made[name] = None if parent is None else self._merged(parent, placed)
        return self._made[name]

    def _parent(
        self, name: str, placed: Placed[Profile], above: tuple[str, ...]
    ) -> _Content | None:
        wanted = placed.entry.extends
        if name == DEFAULT:
            if placed.data.get("extends"):
                what = "the profile default cannot extend another"
                self._problem(placed, "extends", what=what, remedy="remove extends")
            return self._base
        if wanted in above:
            way = " -> ".join((*above[above.index(wanted) :], wanted))
            what = f"extends in a circle ({way})"
            self._problem(placed, "extends", what=what, remedy="remove one extends")
            return None
        if wanted in self.entries:
            return self.content(wanted, above)
        if wanted not in self._known:
            what = f"there is no profile {quoted(wanted)}"
            remedy = suggestion(wanted, self._known)
            self._problem(placed, "extends", what=what, remedy=remedy)
            return None
        return self._base if wanted == DEFAULT else None

    def _merged(self, parent: _Content, placed: Placed[Profile]) -> _Content:
        """A profile's own content over that of the profile that it extends."""
        own = {key: each for key, each in placed.data.items() if each is not None}
        merged = {**parent, **own}
        for key in ("checks", "capabilities"):
            merged[key] = self._added(key, parent.get(key, {}), own.get(key, {}), placed)
        for key in ("components", "values"):  # the first match wins
            merged[key] = [*own.get(key, []), *parent.get(key, [])]
        return merged

    def _added(
        self, key: str, inherited: _Content, own: _Content, placed: Placed[Profile]
    ) -> _Content:
        """The inherited ones with a profile's own added, replaced and (null) removed."""
        both = {**inherited, **own}
        removed = [name for name, each in own.items() if each is None]
        for name in removed:
            del both[name]
            if name not in inherited:
                what = "is removed (null), but no profile that is extended has it"
                remedy = suggestion(name, [each for each in both if each != ALL])
                self._problem(placed, key, name, what=what, remedy=remedy)
        has_words = any(each.patterns for each in placed.entry.checks if each.name == ALL)
        if key == "checks" and (ALL in removed or has_words):
            what = "cannot be removed or narrowed: the check all contains all components"
            self._problem(placed, key, ALL, what=what, remedy="use another name")
        return both

    def _problem(self, placed: Placed[Profile], *below: str | int, what: str, remedy: str) -> None:
        self.problems.append(placed.problem(*below, what=what, remedy=remedy))
