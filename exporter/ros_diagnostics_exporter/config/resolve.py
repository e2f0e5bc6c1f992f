"""Validated entries -> the Fleet: profiles merged, topics named, templates compiled."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from datetime import datetime
from itertools import chain
from types import MappingProxyType
from zoneinfo import ZoneInfo

from ros_diagnostics_exporter.config.errors import LISTED, Problem, quoted, shortened, suggestion
from ros_diagnostics_exporter.config.fleet import (
    AGGREGATED,
    CauseSettings,
    Discovery,
    FaultSettings,
    Fleet,
    Limits,
    Maintenance,
    Profile,
    Robot,
    Shared,
    Source,
    WarningHours,
    topics_of,
)
from ros_diagnostics_exporter.config.lint import lint
from ros_diagnostics_exporter.config.models import (
    CommonEntry,
    DiscoveryEntry,
    FaultsEntry,
    FlappingEntry,
    MaintenanceEntry,
    ManyEntry,
    RobotEntry,
    SharedEntry,
    SiteEntry,
    WarningHoursEntry,
)
from ros_diagnostics_exporter.config.patterns import INNERMOST, ROBOT, topic_pattern
from ros_diagnostics_exporter.config.profiles import DEFAULT, resolved
from ros_diagnostics_exporter.config.validate import Checked, Placed, find_conflicts

RAW_NAME = "diagnostics"
UTC = "UTC"


def resolve(checked: Checked, problems: list[Problem]) -> Fleet | None:
    """The Fleet that the entries describe; None if fleet.yml's own keys are invalid.

    What is wrong is added to `problems`; then the Fleet must not be used.
    """
    top = checked.fleet
    named = checked.profile_names()
    profiles = resolved(
        checked.profiles,
        named,
        stale_is_critical=bool(top and top.stale_is_critical),
        problems=problems,
    )
    lookup = _ProfileLookup(profiles, named, problems)
    shared = tuple(_shared(placed, lookup) for placed in checked.shared)
    topics = {(each.domain_id, each.topic): each for each in shared}
    robots = tuple(_robot(placed, lookup, topics) for placed in checked.robots)
    discoveries = tuple(_discovery(placed, lookup) for placed in checked.discovery)
    maintenance = _downtimes(checked.maintenance, problems)
    find_conflicts(checked, robots, shared, problems)
    if top is None:
        return None
    fleet = Fleet(
        name=top.fleet,
        exporter=top.exporter or "",
        canary=top.canary,
        robots=robots,
        discoveries=discoveries,
        shared=shared,
        profiles=MappingProxyType(profiles),
        maintenance=maintenance,
        faults=_faults(top.faults or FaultsEntry()),
        limits=Limits(**top.limits.model_dump(exclude_none=True)) if top.limits else Limits(),
    )
    warnings = lint(checked, fleet)
    if len(warnings) > LISTED:
        more = f"and {len(warnings) - LISTED} more warnings"
        warnings = (*map(shortened, warnings[:LISTED]), more)
    return replace(fleet, warnings=warnings)


class _ProfileLookup:
    """Finds the profile that an entry names; an unknown name is a problem."""

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
            what, remedy = (
                f"there is no profile {quoted(name)}",
                suggestion(name, sorted(self._known)),
            )
            self._problems.append(placed.problem("profile", what=what, remedy=remedy))
        return self._profiles.get(name) or self._profiles[DEFAULT]


def _robot(
    placed: Placed[RobotEntry], lookup: _ProfileLookup, topics: Mapping[tuple[int, str], Shared]
) -> Robot:
    """A declared robot; `topics` are the shared ones, which its own may be among."""
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
        profile=lookup.profile(placed),
        address=entry.address,
        labels=MappingProxyType(entry.labels or {}),
    )


def _discovery(placed: Placed[DiscoveryEntry], lookup: _ProfileLookup) -> Discovery:
    entry = placed.entry
    source = Source(entry.source or "auto")
    return Discovery(
        pattern=_pattern(entry, source),
        template=entry.topic or str(entry.type),
        domain_ids=entry.domain_ids or (0,),
        source=source,
        include=entry.include or (),
        exclude=entry.exclude or (),
        profile=lookup.profile(placed),
        address=entry.address,
        labels=MappingProxyType(entry.labels or {}),
        name=entry.name or ROBOT,
    )


def _pattern(entry: DiscoveryEntry, source: Source) -> re.Pattern[str]:
    """The topics to look for. If any name will do, topics of the other source are excluded."""
    pattern = INNERMOST if entry.topic is None else topic_pattern(entry.topic)
    any_name = entry.topic is None or entry.topic.endswith("/*")
    if not any_name or source not in (Source.AGG, Source.RAW):
        return pattern
    wanted = "(?<=" if source is Source.AGG else "(?<!"
    return re.compile(f"{pattern.pattern}{wanted}{AGGREGATED})")


def _shared(placed: Placed[SharedEntry], lookup: _ProfileLookup) -> Shared:
    entry = placed.entry
    aggregated = entry.source == "agg" if entry.source else entry.topic.endswith(AGGREGATED)
    return Shared(
        topic=entry.topic,
        raw=not aggregated,
        domain_id=entry.domain_id or 0,
        by=entry.by or "hardware_id",
        pattern=entry.pattern,
        profile=lookup.profile(placed),
        labels=MappingProxyType(entry.labels or {}),
    )


def _faults(entry: FaultsEntry) -> FaultSettings:
    default = FaultSettings()
    plain = {"restart_grace", "pending_after", "confirm_after", "value_hysteresis"}
    flapping = entry.flapping or FlappingEntry()
    return replace(
        default,
        **entry.model_dump(include=plain, exclude_none=True),
        flapping_start=default.flapping_start if flapping.start is None else flapping.start,
        flapping_stop=default.flapping_stop if flapping.stop is None else flapping.stop,
        many=_cause(default.many, entry.many),
        site=_cause(default.site, entry.site),
        common=_cause(default.common, entry.common),
        warning_hours=_hours(entry.warning_hours),
    )


def _hours(entry: WarningHoursEntry | None) -> WarningHours | None:
    if entry is None:
        return None
    return WarningHours(tuple(chain.from_iterable(entry.weekly)), entry.time_zone or UTC)


def _cause(
    default: CauseSettings, entry: ManyEntry | SiteEntry | CommonEntry | None
) -> CauseSettings:
    if entry is None:
        return default
    given = entry.components if isinstance(entry, ManyEntry) else entry.robots
    number = default.number if given is None else given
    absolute = entry.absolute
    if absolute is None and default.absolute is not None:
        absolute = max(default.absolute, number)  # a number that is written down counts
    return CauseSettings(number, default.share if entry.share is None else entry.share, absolute)


def _downtimes(
    entries: list[Placed[MaintenanceEntry]], problems: list[Problem]
) -> tuple[Maintenance, ...]:
    """The downtimes in the order of the files; one that ends before it begins is a problem."""
    made = []
    for placed in entries:
        downtime = _downtime(placed.entry)
        if None not in (downtime.start, downtime.end) and downtime.end <= downtime.start:  # type: ignore[operator]
            what = "is not after start"
            problems.append(placed.problem("end", what=what, remedy="put end after start"))
        made.append(downtime)
    return tuple(made)


def _downtime(entry: MaintenanceEntry) -> Maintenance:
    zone = entry.time_zone or UTC
    return Maintenance(
        name=entry.name,
        selector=MappingProxyType(entry.selector),
        comment=entry.comment,
        start=_unix(entry.start, zone),
        end=_unix(entry.end, zone),
        weekly=tuple(chain.from_iterable(entry.weekly or ())),
        time_zone=zone,
    )


def _unix(moment: datetime | None, zone: str) -> float | None:
    if moment is None:
        return None
    aware = moment if moment.tzinfo else moment.replace(tzinfo=ZoneInfo(zone))
    return aware.timestamp()
