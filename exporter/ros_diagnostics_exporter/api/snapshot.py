"""State -> the JSON of /api/v1/fleet, /api/v1/faults and of Prometheus' HTTP service discovery."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict
from typing import Any

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.api.capabilities import fleet_capabilities
from ros_diagnostics_exporter.config.fleet import Fleet, Source
from ros_diagnostics_exporter.config.fleet import Robot as Settings
from ros_diagnostics_exporter.config.links import filled
from ros_diagnostics_exporter.faults.model import (
    CapabilityView,
    ComponentName,
    Followed,
    ProblemView,
    as_texts,
    fault_id,
)
from ros_diagnostics_exporter.fleet.capabilities import capabilities_text
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Downtime, Instant, Level
from ros_diagnostics_exporter.notifications import Key, key_of
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.maintenance import maintenance_until
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.severity import component_state
from ros_diagnostics_exporter.silences import Acknowledgement
from ros_diagnostics_exporter.sources.prometheus import Outcome

# job -> the port of a robot with an address; None where the query has to name it
PORTS = {"node": 9100, "ssh": 22, "http": 80, "tcp": None}
PING = "ping"  # has no port
UPLINK = "uplink"  # may have one, where pings are not possible


class Care:
    """Who was notified of faults that last, who takes care of them, and their recordings."""

    def __init__(
        self,
        notified: Mapping[Key, Mapping[str, float]] | None = None,
        acknowledgements: Iterable[Acknowledgement] = (),
        has_recording: Callable[[str, float], bool] | None = None,
    ) -> None:
        """Take what is known.

        Args:
            notified: Receivers, and when last; None: not known.
            acknowledgements: The newest is the last.
            has_recording: Whether a fault, by its id, that began then has one; None: none has.
        """
        self._notified = notified
        self._has_recording = has_recording
        self._acknowledged: dict[Key, list[Acknowledgement]] = {}
        for each in acknowledgements:
            self._acknowledged.setdefault(each.fault[1:], []).append(each)

    def of(self, fault: str, identity: dict[str, str], since: float) -> dict[str, Any]:
        """The fields of the fault with that id that began then."""
        key, notified = key_of(identity), self._notified
        acknowledged = [each for each in self._acknowledged.get(key, ()) if each.is_of(since)]
        has_recording = self._has_recording is not None and self._has_recording(fault, since)
        return {
            "fault": fault,
            "recording": f"/api/v1/faults/{fault}/recording.mcap" if has_recording else None,
            "notified": None if notified is None else dict(notified.get(key, {})),
            "acknowledged": _acknowledgement(acknowledged[-1]) if acknowledged else None,
        }


def _acknowledgement(acknowledgement: Acknowledgement) -> dict[str, Any]:
    shown = ("author", "comment", "at", "until")
    return {name: getattr(acknowledgement, name) for name in shown}


NOBODY = Care()
_NO_CARE: dict[str, Any] = {  # of what is not confirmed
    "fault": None,
    "recording": None,
    "notified": {},
    "acknowledged": None,
}


def fleet_snapshot(state: FleetState, now: Instant, care: Care = NOBODY) -> dict[str, Any]:
    """The whole fleet; times are Unix time.

    The problems of a robot and its parts are with the robot, those of sites and of many robots with
    the fleet.
    """
    fleet = state.fleet
    problems: dict[str, list[dict[str, Any]]] = {}
    for view in state.problems(now):
        problems.setdefault(view.identity.robot, []).append(_problem(fleet, view, care))
    return {
        "fleet": fleet.name,
        "time": now.wall,
        "version": __version__,
        "problems": problems.get("", []),
        "capabilities": fleet_capabilities(state),
        "unmatched": [asdict(each) for each in state.unmatched.entries],
        "unclaimed": [each._asdict() for each in state.unclaimed],
        "robots": [
            {
                **robot,
                **_maintenance(state, robot, now),
                "problems": problems.get(robot["robot"], []),
            }
            for robot in state.visit(
                lambda robot: _robot(robot, state.followed(robot), state.capabilities(robot))
            )
        ],
    }


def queries(outcomes: Iterable[Outcome]) -> list[dict[str, Any]]:
    """How each query of fleet.yml was answered last; ``error`` is None before the first answer."""
    return [
        {
            "name": each.query.name,
            "expr": each.query.expr,
            "rows": each.rows,
            "skipped": each.skipped,
            "error": each.error,
        }
        for each in outcomes
    ]


def robot_snapshot(state: FleetState, name: str, now: Instant, care: Care) -> dict[str, Any]:
    """A robot's labels, problems and end of maintenance as in ``fleet_snapshot``.

    Raises:
        LookupError: there is no such robot.
    """
    views = state.problems(now, name)
    robot = state.robots[name]
    known = {
        "robot": name,
        "labels": dict(robot.settings.labels),
        "maintenance": robot.maintenance,
        "problems": [_problem(state.fleet, view, care) for view in views],
    }
    return {**known, **_maintenance(state, known, now)}


def faults(state: FleetState, now: Instant, care: Care = NOBODY) -> dict[str, Any]:
    """All faults that last, the oldest first; times are Unix time."""
    lasting = sorted(state.faults(), key=lambda fault: (fault.since, fault.identity))
    return {
        "fleet": state.fleet.name,
        "time": now.wall,
        "faults": [
            {
                **(identity := as_texts(fault.identity, fault.labels)),
                "since": fault.since,
                "confirmed": fault.confirmed,
                "evidence": fault.evidence,
                "details": dict(fault.details),
                "capabilities_text": fault.capabilities,
                "labels": dict(fault.labels),
                **care.of(fault_id(state.fleet, fault.identity), identity, fault.since),
            }
            for fault in lasting
        ],
    }


def _problem(fleet: Fleet, view: ProblemView, care: Care) -> dict[str, Any]:
    fault = view.fault
    identity = as_texts(view.identity, {} if fault is None else fault.labels)
    return {
        **identity,
        "since": view.since if fault is None else fault.since,
        "confirmed": None if fault is None else fault.confirmed,
        "due": view.due,
        "suppressed": None if view.suppressed is None else view.suppressed.value,
        "suppressed_by": None if view.by is None else as_texts(view.by, {}),
        "because": view.because,
        "healthy": view.healthy,
        "evidence": view.text if fault is None else fault.evidence,
        "details": {} if fault is None else dict(fault.details),
        "capabilities_text": "" if fault is None else fault.capabilities,
        **(
            _NO_CARE
            if fault is None
            else care.of(fault_id(fleet, view.identity), identity, fault.since)
        ),
    }


def _maintenance(state: FleetState, robot: dict[str, Any], now: Instant) -> dict[str, Any]:
    """Until when it is in maintenance, and the downtimes that people planned."""
    fleet, planned = state.fleet, state.downtimes(robot["robot"])
    labels = {**robot["labels"], "fleet": fleet.name, "robot": robot["robot"]}
    until = maintenance_until(fleet, labels, now.wall, planned) if robot["maintenance"] else None
    return {
        "maintenance_until": until,
        "downtimes": [_downtime(each) for each in planned if each.holds(now.wall)],
        "downtimes_ahead": [_downtime(each) for each in planned if each.start > now.wall],
    }


def _downtime(downtime: Downtime) -> dict[str, Any]:
    return {
        "component": downtime.component,
        "from": downtime.start,
        "until": downtime.end,
        "author": downtime.author,
        "comment": downtime.comment,
    }


def targets(state: FleetState, job: str, port: int | None) -> list[dict[str, Any]]:
    """Prometheus' http_sd list of the robots that have an address, at ``port`` or the job's own.

    Job uplink has what robots name as their uplink; an access point is in no other.

    Raises:
        LookupError: there is no such job.
        ValueError: the job needs a port, or has none.
    """
    end = _end(job, port)
    robots = list(state.visit(lambda robot: robot.settings))
    uplinks = {each.labels.get("uplink") for each in robots}
    if job == UPLINK:
        wanted = [each for each in robots if each.name in uplinks]
    else:
        wanted = [
            each for each in robots if each.source is not Source.QUERIES or each.name not in uplinks
        ]
    return [
        {
            "targets": [_host(settings.address) + end],
            "labels": {
                **settings.labels,
                "fleet": state.fleet.name,
                "robot": settings.name,
            },
        }
        for settings in wanted
        if settings.address is not None
    ]


def _end(job: str, port: int | None) -> str:
    if job == PING:
        if port is not None:
            raise ValueError("a ping has no port")
        return ""
    if job == UPLINK:
        return "" if port is None else f":{port}"
    if job not in PORTS:
        raise LookupError(f"no job {job!r}; there are {', '.join(sorted([*PORTS, PING, UPLINK]))}")
    port = port or PORTS[job]
    if port is None:
        raise ValueError(f"the port is missing: /sd/{job}?port=NUMBER")
    return f":{port}"


def _host(address: str | None) -> str:
    address = address or ""
    return f"[{address}]" if address.count(":") > 1 and not address.startswith("[") else address


def _robot(
    robot: RobotState,
    followed: Mapping[ComponentName, Followed],
    capabilities: Mapping[str, CapabilityView],
) -> dict[str, Any]:
    settings: Settings = robot.settings
    return {
        "robot": settings.name,
        "up": robot.up,
        "silent_reason": robot.silent_reason,
        "last_message": robot.last_wall or None,
        "labels": dict(settings.labels),
        "address": settings.address,
        "links": filled(
            {**settings.profile.links, **settings.links}, settings.name, _host(settings.address)
        ),
        "domain_id": settings.domain_id if settings.in_ros else None,
        "namespace": settings.namespace,
        "topic": robot.topic or None,
        "profile": settings.profile.name,
        "maintenance": robot.maintenance,
        "capabilities_text": capabilities_text(capabilities) if robot.up else "",
        "capabilities": [_capability(name, each) for name, each in capabilities.items()],
        "short_checks": list(_short_checks(robot)) if robot.up else [],
        "groups": [
            {"group": path, "level": Level(level).name, "message": message}
            for path, (level, message) in robot.groups.items()
        ],
        "components": [
            _component(
                component,
                followed.get(ComponentName(component.group, component.label)),
                stale_is_critical=settings.profile.stale_is_critical,
            )
            for component in robot.components
            if component.level >= 0
        ],
    }


def _capability(name: str, view: CapabilityView) -> dict[str, Any]:
    """What a robot can do, and the parts that keep it from that."""
    return {
        "capability": name,
        "state": view.state.name.lower(),
        "parts": [
            {**part._asdict(), "state": state.name.lower()} for part, state in view.parts.items()
        ],
    }


def _short_checks(robot: RobotState) -> Iterator[dict[str, Any]]:
    """The checks that find fewer components than fleet.yml expects."""
    checks = {check.name: check for check in robot.settings.profile.checks}
    for name, counts in robot.components.count_checks():
        least = checks[name].expect
        if least is not None and sum(counts) < least:
            yield {
                "check": name,
                "patterns": [pattern.pattern for pattern in checks[name].patterns],
                "found": sum(counts),
                "expected": least,
            }


def _component(
    component: Component, followed: Followed | None, *, stale_is_critical: bool
) -> dict[str, Any]:
    level = Level(component.level).name
    before = None if component.before_stale is None else Level(component.before_stale).name
    planned = component.plans_stale
    return {
        "component": component.label,
        "group": component.group,
        "hardware_id": component.hardware_id,
        "level": level,
        "reported_level": Level(2 if component.reported > 3 else component.reported).name,
        "level_before_stale": before,
        "state": component_state(
            level, before, stale_is_critical=stale_is_critical and not planned
        ),
        "planned_stale": planned,
        "suppressed_because": component.suppressed_because,
        "message": component.trouble_text if component.is_of_several else component.message,
        "level_since": component.since,
        "changes": component.changes,
        "flap_ratio": 0.0 if followed is None else followed.flap_ratio,
        "values": list(_values(component)),
    }


def _values(component: Component) -> Iterator[dict[str, Any]]:
    """The key-values as published; a key that is repeated, and is a number, as it is exported."""
    pairs = component.last.values if component.last is not None else ()
    for (key, text), numbers in zip(pairs, component.values.exported(pairs), strict=True):
        value = numbers[0] if len(numbers) == 1 else None  # a list has no number of its own
        as_published = value is None or value.key == key.strip().rstrip(":").rstrip()
        shown: dict[str, Any] = {
            "key": key if as_published or value is None else value.key,
            "value": text,
            "number": None if value is None else _finite(value.number),
            "unit": "" if value is None else value.unit,
        }
        is_unread = not numbers and not component.is_stale
        rule = component.values.rule_of(key) if value is not None or is_unread else None
        if rule is not None and rule.thresholds:
            shown["thresholds"] = [asdict(each) for each in rule.thresholds]
        yield shown


def _finite(number: float) -> float | None:
    """JSON has no NaN and no infinity; the string is in the JSON, too."""
    return number if abs(number) < float("inf") else None
