"""Checked entries -> the Fleet, with profiles merged, topics named and templates compiled."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

from ros_diagnostics_exporter.config.conflicts import refuse_conflicts
from ros_diagnostics_exporter.config.downtimes import downtimes
from ros_diagnostics_exporter.config.errors import LISTED, Problem, shortened
from ros_diagnostics_exporter.config.fleet import (
    AGGREGATED,
    Discovery,
    Fleet,
    Limits,
    Profile,
    Robot,
    Shared,
    Source,
    topics_of,
)
from ros_diagnostics_exporter.config.lint import advice
from ros_diagnostics_exporter.config.model_robot import DiscoveryEntry, RobotEntry, SharedEntry
from ros_diagnostics_exporter.config.profiles import DEFAULT, resolved
from ros_diagnostics_exporter.config.scalars import shown
from ros_diagnostics_exporter.config.templates import INNERMOST, ROBOT, topic_pattern
from ros_diagnostics_exporter.config.translate import meant
from ros_diagnostics_exporter.config.validate import Checked, Placed

RAW_NAME = "diagnostics"


def resolve(checked: Checked, problems: list[Problem]) -> Fleet | None:
    """All that the entries mean together; None where fleet.yml's own keys are not usable.

    What is wrong goes to `problems`; then the Fleet is not to be used.
    """
    top = checked.fleet
    named = checked.profile_names()
    profiles = resolved(
        checked.profiles,
        named,
        stale_is_critical=bool(top and top.stale_is_critical),
        problems=problems,
    )
    choice = _Choice(profiles, named, problems)
    shared = tuple(_shared(placed, choice) for placed in checked.shared)
    topics = {(each.domain_id, each.topic): each for each in shared}
    robots = tuple(_robot(placed, choice, topics) for placed in checked.robots)
    discoveries = tuple(_discovery(placed, choice) for placed in checked.discovery)
    maintenance = downtimes(checked.maintenance, problems)
    refuse_conflicts(checked, robots, shared, problems)
    if top is None:
        return None
    fleet = Fleet(
        name=top.fleet,
        robots=robots,
        discoveries=discoveries,
        shared=shared,
        profiles=MappingProxyType(profiles),
        maintenance=maintenance,
        limits=Limits(**top.limits.model_dump(exclude_none=True)) if top.limits else Limits(),
    )
    warnings = advice(checked, fleet)
    if len(warnings) > LISTED:
        more = f"and {len(warnings) - LISTED} more warnings"
        warnings = (*map(shortened, warnings[:LISTED]), more)
    return replace(fleet, warnings=warnings)


class _Choice:
    """The profile for an entry that names one; a name that is nowhere in the file is told."""

    def __init__(
        self, profiles: Mapping[str, Profile], named: frozenset[str], problems: list[Problem]
    ) -> None:
        self._profiles = profiles
        self._known = named | {DEFAULT}
        self._problems = problems

    def profile(
        self, placed: Placed[RobotEntry] | Placed[DiscoveryEntry] | Placed[SharedEntry]
    ) -> Profile:
        name = placed.entry.profile or DEFAULT
        if name not in self._known:
            what, remedy = f"there is no profile {shown(name)}", meant(name, sorted(self._known))
            self._problems.append(placed.problem("profile", what=what, remedy=remedy))
        return self._profiles.get(name) or self._profiles[DEFAULT]


def _robot(
    placed: Placed[RobotEntry], choice: _Choice, topics: Mapping[tuple[int, str], Shared]
) -> Robot:
    """A declared robot; `topics` are the shared ones, of which its own may be one."""
    entry = placed.entry
    shared = topics.get((entry.domain_id or 0, entry.topic or ""))
    source = Source(entry.source or "auto")
    if shared is not None:
        source = Source.RAW if shared.raw else Source.AGG
    topic = entry.topic or f"{entry.namespace or ''}/{RAW_NAME}"
    if entry.topic is None and source is Source.AGG:
        topic += AGGREGATED
    aggregate, raw = topics_of(topic, source)
    return Robot(
        name=entry.name,
        domain_id=entry.domain_id or 0,
        namespace=topic.rpartition("/")[0],
        topic_agg=aggregate,
        topic_raw=raw,
        source=source,
        profile=choice.profile(placed),
        address=entry.address,
        labels=MappingProxyType(entry.labels or {}),
    )


def _discovery(placed: Placed[DiscoveryEntry], choice: _Choice) -> Discovery:
    entry = placed.entry
    source = Source(entry.source or "auto")
    return Discovery(
        pattern=_pattern(entry, source),
        template=entry.topic or str(entry.type),
        domain_ids=entry.domain_ids or (0,),
        source=source,
        include=entry.include or (),
        exclude=entry.exclude or (),
        profile=choice.profile(placed),
        address=entry.address,
        labels=MappingProxyType(entry.labels or {}),
        name=entry.name or ROBOT,
    )


def _pattern(entry: DiscoveryEntry, source: Source) -> re.Pattern[str]:
    """The topics to look for. Where any name will do, those of the other kind are left out."""
    pattern = INNERMOST if entry.topic is None else topic_pattern(entry.topic)
    any_name = entry.topic is None or entry.topic.endswith("/*")
    if not any_name or source not in (Source.AGG, Source.RAW):
        return pattern
    wanted = "(?<=" if source is Source.AGG else "(?<!"
    return re.compile(f"{pattern.pattern}{wanted}{AGGREGATED})")


def _shared(placed: Placed[SharedEntry], choice: _Choice) -> Shared:
    entry = placed.entry
    aggregated = entry.source == "agg" if entry.source else entry.topic.endswith(AGGREGATED)
    return Shared(
        topic=entry.topic,
        raw=not aggregated,
        domain_id=entry.domain_id or 0,
        by=entry.by or "hardware_id",
        pattern=entry.pattern,
        profile=choice.profile(placed),
        labels=MappingProxyType(entry.labels or {}),
    )
