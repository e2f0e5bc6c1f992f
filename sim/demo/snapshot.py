"""The robots of the exporter and the alerts of Prometheus and Alertmanager, and what changed.

Read over their HTTP APIs.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from testbed import http
from testbed.configuration import Addresses


@dataclass(frozen=True)
class Problem:
    """A component that is not OK."""

    component: str
    level: str
    message: str


@dataclass(frozen=True)
class RobotStatus:
    """One robot in the exporter's API."""

    name: str
    up: bool
    age: float | None  # seconds since its last message; None: none yet
    components: int
    problems: tuple[Problem, ...]


@dataclass(frozen=True)
class Alert:
    """An alert about a robot."""

    name: str
    robot: str
    component: str
    state: str  # Prometheus' "pending", "firing"; then Alertmanager's "active", "suppressed"

    @property
    def identity(self) -> tuple[str, str, str]:
        """The labels that identify it."""
        return (self.name, self.robot, self.component)


@dataclass(frozen=True)
class Snapshot:
    """What all servers answered; ``unreachable`` names those that did not."""

    robots: tuple[RobotStatus, ...] = ()
    alerts: tuple[Alert, ...] = ()
    unreachable: tuple[str, ...] = ()


def take_snapshot(addresses: Addresses) -> Snapshot:
    """Query all servers; one that does not answer is in ``unreachable``."""
    unreachable: list[str] = []

    def get(name: str, address: str, path: str) -> Any:
        try:
            return http.get_json(address, path)
        except http.Unanswered:
            unreachable.append(name)
            return None

    fleet = get("exporter", addresses.exporter, "/api/v1/fleet")
    rules = get("Prometheus", addresses.prometheus, "/api/v1/alerts")
    received = get("Alertmanager", addresses.alertmanager, "/api/v2/alerts")
    return Snapshot(
        robots=tuple(_robot(each, fleet["time"]) for each in fleet["robots"]) if fleet else (),
        alerts=_alerts(rules["data"]["alerts"] if rules else [], received or []),
        unreachable=tuple(unreachable),
    )


def _robot(document: dict[str, Any], now: float) -> RobotStatus:
    last = document["last_message"]
    problems = [
        Problem(each["component"], each["level"], each["message"])
        for each in document["components"]
        if each["level"] != "OK"
    ]
    return RobotStatus(
        document["robot"],
        bool(document["up"]),
        None if last is None else max(0.0, now - last),
        len(document["components"]),
        tuple(problems),
    )


def _alerts(rules: list[dict[str, Any]], received: list[dict[str, Any]]) -> tuple[Alert, ...]:
    """Merge both servers' alerts; Alertmanager's state replaces Prometheus'."""
    states: dict[tuple[str, str, str], str] = {}
    for each in rules:
        states[_identity(each["labels"])] = each["state"]
    for each in received:
        state = each["status"]["state"]
        states[_identity(each["labels"])] = "active" if state == "unprocessed" else state
    return tuple(Alert(*key, state) for key, state in sorted(states.items()) if key[1])


def _identity(labels: dict[str, str]) -> tuple[str, str, str]:
    return (labels["alertname"], labels.get("robot", ""), labels.get("component", ""))


ALERT_CHANGES = {
    "pending": "Prometheus: {alert} is pending",
    "firing": "Prometheus: {alert} fires",
    "active": "Alertmanager: {alert} is active",
    "suppressed": "Alertmanager: {alert} is inhibited",
}


def changes(before: Snapshot, now: Snapshot) -> Iterator[str]:
    """Yield a line for each change of a server, a robot, a component or an alert."""
    for name in sorted(set(now.unreachable) - set(before.unreachable)):
        yield f"{name} does not answer"
    for name in sorted(set(before.unreachable) - set(now.unreachable)):
        yield f"{name} answers again"
    known = {robot.name: robot for robot in before.robots}
    for robot in now.robots:
        if robot.name in known:
            yield from _robot_changes(known[robot.name], robot)
    yield from _alert_changes(before, now)


def _robot_changes(before: RobotStatus, now: RobotStatus) -> Iterator[str]:
    if before.up != now.up:
        yield f"exporter: {now.name} {'is back' if now.up else 'is silent'}"
    old = {each.component: each for each in before.problems}
    new = {each.component: each for each in now.problems}
    for component, problem in new.items():
        if component not in old or old[component].level != problem.level:
            yield f"exporter: {now.name} {component} is {problem.level}: {problem.message}"
    for component in old.keys() - new.keys():
        yield f"exporter: {now.name} {component} is OK again"


def _alert_changes(before: Snapshot, now: Snapshot) -> Iterator[str]:
    old = {each.identity: each for each in before.alerts}
    for alert in now.alerts:
        earlier = old.pop(alert.identity, None)
        if earlier is None or earlier.state != alert.state:
            yield ALERT_CHANGES[alert.state].format(alert=_name(alert))
    if not {"Prometheus", "Alertmanager"} & set(now.unreachable):  # else their alerts are unknown
        for alert in old.values():
            yield f"Alertmanager: {_name(alert)} is resolved"


def _name(alert: Alert) -> str:
    return " ".join(part for part in alert.identity if part)
