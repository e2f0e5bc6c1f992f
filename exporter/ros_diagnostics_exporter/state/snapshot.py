"""State -> the JSON of /api/v1/fleet and of Prometheus' HTTP service discovery."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.config.fleet import Robot as Settings
from ros_diagnostics_exporter.model import Instant, Level
from ros_diagnostics_exporter.severity import component_state
from ros_diagnostics_exporter.state.component import Component
from ros_diagnostics_exporter.state.robot import Robot
from ros_diagnostics_exporter.state.state import State

# job -> the port of a robot with an address; None where the query has to name it
PORTS = {"node": 9100, "ssh": 22, "http": 80, "tcp": None}
PING = "ping"  # has no port


def fleet_snapshot(state: State, now: Instant) -> dict[str, Any]:
    """The whole fleet; times are Unix time."""
    return {
        "fleet": state.fleet.name,
        "time": now.wall,
        "version": __version__,
        "robots": list(state.visit(_robot)),
    }


def targets(state: State, job: str, port: int | None) -> list[dict[str, Any]]:
    """Prometheus' http_sd list of the robots that have an address, at ``port`` or the job's own.

    Raises:
        LookupError: there is no such job.
        ValueError: the job needs a port, or has none.
    """
    end = _end(job, port)
    return [
        {
            "targets": [_host(settings.address) + end],
            "labels": {
                **settings.labels,
                "fleet": state.fleet.name,
                "robot": settings.name,
            },
        }
        for settings in state.visit(lambda robot: robot.settings)
        if settings.address is not None
    ]


def _end(job: str, port: int | None) -> str:
    if job == PING:
        if port is not None:
            raise ValueError("a ping has no port")
        return ""
    if job not in PORTS:
        raise LookupError(f"no job {job!r}; there are {', '.join(sorted([*PORTS, PING]))}")
    port = port or PORTS[job]
    if port is None:
        raise ValueError(f"which port? /sd/{job}?port=NUMBER")
    return f":{port}"


def _host(address: str | None) -> str:
    address = address or ""
    return f"[{address}]" if address.count(":") > 1 and not address.startswith("[") else address


def _robot(robot: Robot) -> dict[str, Any]:
    settings: Settings = robot.settings
    return {
        "robot": settings.name,
        "up": robot.up,
        "silent_reason": robot.silent_reason,
        "last_message": robot.last_wall or None,
        "labels": dict(settings.labels),
        "address": settings.address,
        "domain_id": settings.domain_id,
        "namespace": settings.namespace,
        "topic": settings.topic_agg or settings.topic_raw,
        "profile": settings.profile.name,
        "maintenance": robot.maintenance,
        "short_checks": list(_short_checks(robot)) if robot.up else [],
        "groups": [
            {"group": path, "level": Level(level).name, "message": message}
            for path, (level, message) in robot.groups.items()
        ],
        "components": [
            _component(component, stale_is_critical=settings.profile.stale_is_critical)
            for component in robot.components
            if component.level >= 0
        ],
    }


def _short_checks(robot: Robot) -> Iterator[dict[str, Any]]:
    """The checks that find fewer components than fleet.yml expects."""
    expected = {check.name: check.expect for check in robot.settings.profile.checks}
    for name, counts in robot.components.count_checks():
        least = expected[name]
        if least is not None and sum(counts) < least:
            yield {"check": name, "found": sum(counts), "expected": least}


def _component(component: Component, *, stale_is_critical: bool) -> dict[str, Any]:
    level = Level(component.level).name
    before = None if component.before_stale is None else Level(component.before_stale).name
    planned = component.rule is not None and component.rule.planned_stale
    return {
        "component": component.name,
        "group": component.group,
        "hardware_id": component.hardware_id,
        "level": level,
        "reported_level": Level(component.reported).name,
        "level_before_stale": before,
        "state": component_state(
            level, before, stale_is_critical=stale_is_critical and not planned
        ),
        "planned_stale": planned,
        "message": component.message,
        "since": component.since,
        "problem_since": component.problem_since,
        "changes": component.changes,
        "flap_ratio": 0.0 if component.flaps is None else component.flaps.ratio,
        "values": list(_values(component)),
    }


def _values(component: Component) -> Iterator[dict[str, Any]]:
    """The key-values as published; a key that is repeated, and is a number, as it is exported."""
    pairs = component.last.values if component.last is not None else ()
    for (key, text), numbers in zip(pairs, component.values.exported(pairs), strict=True):
        value = numbers[0] if len(numbers) == 1 else None  # a list has no number of its own
        as_published = value is None or value.key == key.strip().rstrip(":").rstrip()
        yield {
            "key": key if as_published or value is None else value.key,
            "value": text,
            "number": None if value is None else _finite(value.number),
            "unit": "" if value is None else value.unit,
        }


def _finite(number: float) -> float | None:
    """JSON has no NaN and no infinity; the string is in the JSON, too."""
    return number if abs(number) < float("inf") else None
