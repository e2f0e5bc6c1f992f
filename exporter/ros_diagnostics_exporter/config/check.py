"""The text that `--config.check` prints for a valid config."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from datetime import datetime
from zoneinfo import ZoneInfo

from ros_diagnostics_exporter.config import patterns
from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    Check,
    Discovery,
    FaultSettings,
    Fleet,
    Limits,
    Maintenance,
    Profile,
    Query,
    RecordingSettings,
    Robot,
    Shared,
)
from ros_diagnostics_exporter.config.scalars import DAY, DAYS
from ros_diagnostics_exporter.durations import written
from ros_diagnostics_exporter.model import Domain, place
from ros_diagnostics_exporter.weekly import Weekly


def describe(fleet: Fleet) -> str:
    """Robots, discovery, profiles, downtimes and warnings of a valid config, for people."""
    files = [str(source) for source in fleet.sources if source.suffix in (".yml", ".yaml")]
    lines = [f"fleet {fleet.name} is valid", *_section("read", files)]
    lines += _section("robots", map(_robot, fleet.robots))
    lines += _section("discovery", map(_discovery, fleet.discoveries))
    lines += _section("shared topics", map(_shared, fleet.shared))
    lines += _section("profiles", map(_profile, fleet.profiles.values()))
    lines += _section("maintenance", map(_maintenance, fleet.maintenance))
    lines += _section("queries", map(_query, fleet.queries))
    if fleet.faults != FaultSettings():
        lines += _section("faults", _faults(fleet.faults))
    if fleet.recordings != RecordingSettings():
        before, after = map(written, (fleet.recordings.before, fleet.recordings.after))
        lines += _section("recordings", [f"{before} before, {after} after"])
    if fleet.canary is not None:
        lines += _section("canary", [f"every {written(fleet.canary)}"])
    if fleet.limits != Limits():
        lines += _section("limits", [_pairs(asdict(fleet.limits))])
    lines += _section("warnings", fleet.warnings)
    return "\n".join(lines) + "\n"


def _section(title: str, items: Iterable[str]) -> list[str]:
    listed = list(items)
    return [f"{title} ({len(listed)}):", *(f"  {item}" for item in listed)] if listed else []


def _robot(robot: Robot) -> str:
    topics = " and ".join(filter(None, (robot.topic_agg, robot.topic_raw)))
    where = topics or robot.namespace or "/"
    received = f"{place(robot.domain_id)}, {where}, " if robot.in_ros else ""
    return _joined(
        f"{robot.name}: {received}source {robot.source.value}",
        *_settings(robot),
    )


def _discovery(discovery: Discovery) -> str:
    return _joined(
        f"{discovery.template} in {_places(discovery.domain_ids)}",
        f"as {discovery.name}",
        discovery.include and f"only {patterns.written(discovery.include)}",
        discovery.exclude and f"not {patterns.written(discovery.exclude)}",
        f"source {discovery.source.value}",
        *_settings(discovery),
    )


def _settings(robot: Robot | Discovery) -> tuple[str, str, str]:
    """The settings that declared and discovered robots have in common."""
    address = f"address {robot.address}" if robot.address else ""
    return f"profile {robot.profile.name}", address, _pairs(robot.labels)


def _shared(shared: Shared) -> str:
    return _joined(
        f"{shared.topic} in {place(shared.domain_id)}, {'raw' if shared.raw else 'aggregated'}",
        f"robot from {shared.by}",
        shared.pattern is not None and f"by {shared.pattern.pattern}",
        f"profile {shared.profile.name}",
        _pairs(shared.labels),
    )


def _profile(profile: Profile) -> str:
    return _joined(
        f"{profile.name}: stale after {written(profile.stale_after)}",
        f"confirmed after {written(profile.confirm_after)}",
        f"forgotten after {written(profile.forget_after)}",
        profile.stale_is_critical and "STALE is CRITICAL",
        f"checks: {', '.join(map(_check, profile.checks))}",
        profile.components and f"rules for components: {len(profile.components)}",
        profile.values and f"rules for values: {len(profile.values)}",
    )


def _check(check: Check) -> str:
    return check.name if check.expect is None else f"{check.name} (expects {check.expect})"


def _maintenance(maintenance: Maintenance) -> str:
    selector = {label: patterns.written(each) for label, each in maintenance.selector.items()}
    zone = ZoneInfo(maintenance.time_zone)
    return _joined(
        f"{maintenance.name}: {_pairs(selector)}",
        maintenance.start is not None and f"from {_moment(maintenance.start, zone)}",
        maintenance.end is not None and f"to {_moment(maintenance.end, zone)}",
        ", ".join(_weekly(maintenance.weekly)),
        maintenance.weekly and maintenance.time_zone,
        f"({maintenance.comment})",
    )


def _query(query: Query) -> str:
    bounds = (f"{each.bound} {each.severity} {each.value:g}" for each in query.thresholds)
    return _joined(
        f"{query.name}: {query.expr}",
        f"robot from {query.address or query.robot}",
        *bounds,
        f"every {written(query.interval)}",
        f"stale after {written(query.stale_after)}",
    )


def _faults(faults: FaultSettings) -> Iterator[str]:
    yield f"after a start, missing data is no fault for {written(faults.restart_grace)}"
    yield f"robots that are never received: after {written(faults.pending_after)}"
    yield f"flapping from {faults.flapping.start:g} until below {faults.flapping.stop:g}"
    intermittent = faults.intermittent
    yield f"intermittent from {intermittent.changes} changes in {written(intermittent.within)}"
    falling = faults.falling
    yield f"values too low within {written(falling.ahead)}, by the last {written(falling.over)}"
    yield f"values have to come back by {100 * faults.value_hysteresis:g} % of their threshold"
    yield f"many components of a robot: {_cause(faults.many)}"
    confirmed = f"confirmed after {written(faults.confirm_after)}"
    yield f"silent robots of a site: {_cause(faults.site)}, {confirmed}"
    yield f"robots with the same component CRITICAL: {_cause(faults.common)}, {confirmed}"
    hours = faults.warning_hours
    if hours is not None:
        yield f"warnings begin {', '.join(_weekly(hours.weekly))} {hours.time_zone}"


def _cause(cause: CauseSettings) -> str:
    absolute = "" if cause.absolute is None else f", or {cause.absolute}"
    return f"{cause.number} and {cause.share:g} of all{absolute}"


def _weekly(weekly: Weekly) -> Iterator[str]:
    days: dict[str, list[str]] = {}
    for day, first, last in weekly:
        end = last - DAY if last > DAY else last
        times = f"{first // 60:02}:{first % 60:02}-{end // 60:02}:{end % 60:02}"
        days.setdefault(times, []).append(DAYS[day])
    for times, named in days.items():
        yield f"{'daily' if len(named) == 7 else ','.join(named)} {times}"


def _moment(unix: float, zone: ZoneInfo) -> str:
    return datetime.fromtimestamp(unix, zone).isoformat(" ", "minutes")


def _joined(*parts: str | bool | tuple[object, ...] | None) -> str:
    return ", ".join(part for part in parts if isinstance(part, str) and part)


def _pairs(mapping: Mapping[str, object]) -> str:
    return " ".join(f"{key}={value}" for key, value in mapping.items())


def _places(ids: tuple[Domain, ...]) -> str:
    """`domain 0, 10-19` for ascending numbers."""
    runs: list[list[int]] = []
    for each in ids:
        if not isinstance(each, int):
            return place(each)
        if runs and each == runs[-1][-1] + 1:
            runs[-1][1:] = [each]
        else:
            runs.append([each])
    return f"domain {', '.join('-'.join(map(str, run)) for run in runs)}"
