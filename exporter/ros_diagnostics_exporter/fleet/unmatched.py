"""What fleet.yml names and nothing is: checks, rules, discovery and downtimes that match nothing.

And values with thresholds that are no numbers.

Of the running exporter, or, with `check-config --live`, of a file against a running exporter.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ros_diagnostics_exporter.config.capabilities import ComponentsOf, Expression, Need
from ros_diagnostics_exporter.config.conditions import Conditions
from ros_diagnostics_exporter.config.fleet import (
    Discovery,
    Fleet,
    Profile,
    Source,
    ValueRule,
    topics_of,
)
from ros_diagnostics_exporter.config.patterns import written
from ros_diagnostics_exporter.fleet.discovery import takes
from ros_diagnostics_exporter.model import Domain, Instant
from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_exporter.robots.maintenance import selects
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.robots.rules import (
    SEARCHED,
    check_matches,
    key_matches,
    value_matches,
    value_rule,
)
from ros_diagnostics_exporter.robots.updates import TOPICS
from ros_diagnostics_exporter.robots.values import read_by
from ros_diagnostics_exporter.texts import nearest

log = logging.getLogger(__name__)

KINDS = (
    "capability",
    "check",
    "component",
    "condition",
    "discovery",
    "maintenance",
    "shared",
    "topic",
    "value",
)
GRACE = 300.0  # seconds for which nothing has to match until it is reported

Part = tuple[str, str, tuple[str, ...]]  # of a robot: group, component, keys of its values
Text = tuple[str, str, str]  # component, key, value


@dataclass(frozen=True, order=True)
class Unmatched:
    """An entry of fleet.yml that matches nothing: one of `KINDS`, its text, the nearest name."""

    what: str
    entry: str
    nearest: str = field(default="", compare=False)
    why: str = field(default="matches nothing", compare=False)

    def __str__(self) -> str:
        """One line, for people."""
        hint = f"; the nearest is {self.nearest!r}" if self.nearest else ""
        return f"{self.what} {self.entry} {self.why}{hint}"


@dataclass(frozen=True)
class KnownRobot:
    """What of a robot entries can match; ``texts`` are its values that have no number."""

    name: str
    labels: Mapping[str, str]
    domain_id: Domain
    topic: str
    profile: str
    components: tuple[Part, ...]
    texts: tuple[Text, ...] = ()


def known_robot(robot: RobotState) -> KnownRobot:
    """What is known of a robot of the state."""
    settings = robot.settings
    return KnownRobot(
        name=settings.name,
        labels=settings.labels,
        domain_id=settings.domain_id,
        topic=robot.topic,
        profile=settings.profile.name,
        components=tuple(
            (each.group, each.name, () if each.last is None else _keys(each.last.values))
            for each in robot.components
            if each.level >= 0
        ),
        texts=tuple(
            (each.name, key, text)
            for each in robot.components
            if each.last is not None and each.values.judges
            for (key, text), found in zip(
                each.last.values, each.values.exported(each.last.values), strict=True
            )
            if not found
        ),
    )


def _keys(values: Iterable[tuple[str, str]]) -> tuple[str, ...]:
    return tuple(key for key, _value in values)


def known_from_json(fleet: Mapping[str, Any]) -> list[KnownRobot]:
    """The robots of /api/v1/fleet.

    Raises:
        KeyError, TypeError: It is not what an exporter of this version serves.
    """
    return [
        KnownRobot(
            name=robot["robot"],
            labels=robot["labels"],
            domain_id=robot["domain_id"],
            topic=robot["topic"] or "",
            profile=robot["profile"],
            components=tuple(
                (each["group"], each["component"], tuple(value["key"] for value in each["values"]))
                for each in robot["components"]
            ),
            texts=tuple(
                (each["component"], value["key"], value["value"])
                for each in robot["components"]
                for value in each["values"]
                if value["number"] is None
            ),
        )
        for robot in fleet["robots"]
    ]


def find_unmatched(fleet: Fleet, known: Iterable[KnownRobot], wall: float) -> list[Unmatched]:
    """The entries that match nothing of what is known, sorted.

    Of robots that are known and were not received yet nothing is said; rules of a profile count
    once components of its robots were received. Rules that ignore
    components, and downtimes that are over at ``wall`` (Unix seconds), do not count. Of a shard
    nothing is said: an entry may match robots of another one.
    """
    if fleet.shard is not None:
        return []
    robots = list(known)
    received = [each for each in robots if each.components]
    if robots and not received:
        return []
    found = {
        *_sources(fleet, robots),
        *_maintenance(fleet, robots, wall),
        *_of_profiles(fleet, received),
        *(found for robot in robots for found in _unread(fleet.profiles.get(robot.profile), robot)),
    }
    return sorted(found)


def _sources(fleet: Fleet, robots: list[KnownRobot]) -> Iterator[Unmatched]:
    for discovery in fleet.discoveries:
        if not any(_is_found(discovery, robot) for robot in robots):
            only = written(discovery.include)
            entry = f"{discovery.template}{only and f' include {only}'}"
            yield Unmatched("discovery", entry, nearest(only, [each.name for each in robots]))
    places = {(each.topic, each.domain_id) for each in robots}
    for shared in fleet.shared:
        if (shared.topic, shared.domain_id) not in places:
            yield Unmatched("shared", shared.topic)


def _is_found(discovery: Discovery, robot: KnownRobot) -> bool:
    topics = topics_of(robot.topic, Source.AUTO)
    return any(each and takes(discovery, each, robot.domain_id) for each in topics)


def _maintenance(fleet: Fleet, robots: list[KnownRobot], wall: float) -> Iterator[Unmatched]:
    labels = [{**each.labels, "fleet": fleet.name, "robot": each.name} for each in robots]
    for each in fleet.maintenance:
        is_over = each.end is not None and each.end <= wall
        if not is_over and not any(selects(each, of) for of in labels):
            selector = {label: written(patterns) for label, patterns in each.selector.items()}
            near = (
                nearest(selector[name], (of.get(name, "") for of in labels)) for name in selector
            )
            entry = ", ".join(f"{label}={text}" for label, text in selector.items())
            yield Unmatched("maintenance", f"{each.name}: {entry}", next(filter(None, near), ""))


def _of_profiles(fleet: Fleet, robots: list[KnownRobot]) -> Iterator[Unmatched]:
    """Entries of profiles; one that several profiles inherit may match in any of them."""
    matched: dict[Unmatched, bool] = {}
    for profile in fleet.profiles.values():
        parts = {
            part for each in robots if each.profile == profile.name for part in each.components
        }
        if parts:
            for entry, matches in _rules(profile, parts):
                matched[entry] = matched.get(entry, False) or matches
    yield from (entry for entry, matches in matched.items() if not matches)


def _rules(profile: Profile, parts: Collection[Part]) -> Iterator[tuple[Unmatched, bool]]:
    """(entry, whether it matches anything) of all rules of a profile."""
    names = dict.fromkeys(name for _group, name, _keys in parts)
    for check in profile.checks:
        text = written(check.patterns)
        matches = any(check_matches(check, group, name) for group, name, _keys in parts)
        near = "" if matches else nearest(text, names)
        yield Unmatched("check", f"{check.name}: {text}", near), matches
    for topic in profile.topics:
        matches = any(part[:2] == (TOPICS, topic.component) for part in parts)
        entry = f"{topic.topic}: {topic.component}"
        yield Unmatched("topic", entry, why="is received of no robot"), matches
    for rule in profile.components:
        if not rule.ignore:
            text = written([rule.pattern])
            matches = any(rule.pattern.search(name[:SEARCHED]) for name in names)
            yield Unmatched("component", text, "" if matches else nearest(text, names)), matches
            yield from _conditions(rule.conditions, rule.pattern, parts)
    for name, capability in profile.capabilities.items():
        yield from _parts(name, capability.need, parts)
    if profile.modes is not None:
        asked = Conditions((profile.modes.condition, *profile.modes.interventions))
        yield from _conditions(asked, None, parts)
    for value in profile.values:
        yield _value(value, parts)
        yield from _conditions(value.conditions, value.component, parts)


def _conditions(
    conditions: Conditions | None, about: Pattern | None, parts: Collection[Part]
) -> Iterator[tuple[Unmatched, bool]]:
    """What the conditions of an entry ask about; ``about`` are the components that it is for."""
    for each in () if conditions is None else (*conditions.when, *conditions.unless):
        patterns = each.component or tuple(filter(None, (about,)))
        asked = [part for part in parts if not patterns or _is_named(part, patterns)]
        keys = [key for _group, _name, keys in asked for key in keys]
        matches = any(key_matches(pattern, key) for key in keys for pattern in each.key)
        if not (asked or each.component):
            continue  # the entry itself matches nothing
        if matches or (asked and not each.key):
            yield Unmatched("condition", each.text), True
        else:
            names = keys or [name for _group, name, _keys in parts]
            near = nearest(written(each.key if keys else patterns), names)
            yield Unmatched("condition", each.text, near), False


def _parts(name: str, need: Need, parts: Collection[Part]) -> Iterator[tuple[Unmatched, bool]]:
    """The components and values that a capability needs."""
    if isinstance(need, Expression):
        for each in need.of:
            yield from _parts(name, each, parts)
    elif isinstance(need, ComponentsOf):
        named = [part for part in parts if _is_named(part, need.patterns)]
        keys = [key for _group, _name, keys in named for key in keys]
        text = written(need.patterns)
        near = nearest(text, (part[1] for part in parts))
        if need.keys and named:
            text = f"{text} {written(need.keys)}"
            near = nearest(written(need.keys), keys)
        matches = bool(named) and (
            not need.keys or any(key_matches(one, key) for one in need.keys for key in keys)
        )
        yield Unmatched("capability", f"{name}: {text}", "" if matches else near), matches


def _is_named(part: Part, patterns: Iterable[Pattern]) -> bool:
    _group, name, _keys = part
    return any(pattern.search(name[:SEARCHED]) for pattern in patterns)


def _value(rule: ValueRule, parts: Collection[Part]) -> tuple[Unmatched, bool]:
    component, key = (written(filter(None, [each])) for each in (rule.component, rule.key))
    entry = f"component {component or 'any'}, key {key or 'any'}"
    if any(value_matches(rule, name, each) for _group, name, keys in parts for each in keys):
        return Unmatched("value", entry), True
    anywhere = replace(rule, key=None)
    keys = [key for _, name, keys in parts for key in keys if value_matches(anywhere, name, key)]
    names = [name for _group, name, _keys in parts]
    near = nearest(key, keys) if keys else nearest(component, names)
    return Unmatched("value", entry, near), False


def _unread(profile: Profile | None, robot: KnownRobot) -> Iterator[Unmatched]:
    """Its values that have thresholds and are no numbers."""
    if profile is None or not any(rule.thresholds for rule in profile.values):
        return
    for name, key, text in robot.texts:
        rule = value_rule(profile, name, key)
        if rule is not None and rule.thresholds and not read_by(rule, key, text):
            entry = f"component {name}, key {key}"
            why = f"= {text!r:.80} of {robot.name} is no number, its thresholds cannot be judged"
            yield Unmatched("value", entry, why=why)


class UnmatchedWatch:
    """Reports the entries that have matched nothing for `GRACE`, one log line each."""

    def __init__(self) -> None:
        self.entries: tuple[Unmatched, ...] = ()
        self.counts = dict.fromkeys(KINDS, 0)  # how many of each kind
        self._since: dict[Unmatched, float] = {}

    def update(self, unmatched: Iterable[Unmatched], now: Instant) -> None:
        """Take what matches nothing now."""
        self._since = {each: self._since.get(each, now.mono) for each in unmatched}
        entries = tuple(each for each, at in self._since.items() if now.mono - at >= GRACE)
        for each in entries:
            if each not in self.entries:
                log.warning("fleet.yml: %s", each)
        self.entries = entries
        self.counts = {kind: sum(each.what == kind for each in entries) for kind in KINDS}
