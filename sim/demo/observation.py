"""What the road shows right now: robots at the exporter, alerts at Prometheus and Alertmanager.

Read over HTTP, as any user of these servers could.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from testbed import http as asking
from testbed.configuration import Addresses


@dataclass(frozen=True)
class Trouble:
    """A component that is not OK, as the exporter has it."""

    component: str
    level: str
    message: str


@dataclass(frozen=True)
class Robot:
    """One robot, as the exporter has it."""

    name: str
    up: bool
    age: float | None  # seconds since its last message; None: none yet
    components: int
    troubles: tuple[Trouble, ...]


@dataclass(frozen=True)
class Alert:
    """One alert that concerns a robot."""

    name: str
    robot: str
    component: str
    state: str  # "pending", "firing" at Prometheus; then Alertmanager's "active", "suppressed"

    @property
    def identity(self) -> tuple[str, str, str]:
        """What makes it this alert and no other."""
        return (self.name, self.robot, self.component)


@dataclass(frozen=True)
class Sight:
    """One look; ``silent`` names the servers that did not answer."""

    robots: tuple[Robot, ...] = ()
    alerts: tuple[Alert, ...] = ()
    silent: tuple[str, ...] = ()


def look(addresses: Addresses) -> Sight:
    """Look at all servers; one that does not answer is named, and shows nothing."""
    silent: list[str] = []

    def ask(name: str, address: str, path: str) -> Any:
        try:
            return asking.get_json(address, path)
        except asking.Unanswered:
            silent.append(name)
            return None

    fleet = ask("exporter", addresses.exporter, "/api/v1/fleet")
    rules = ask("Prometheus", addresses.prometheus, "/api/v1/alerts")
    received = ask("Alertmanager", addresses.alertmanager, "/api/v2/alerts")
    return Sight(
        robots=tuple(_robot(each, fleet["time"]) for each in fleet["robots"]) if fleet else (),
        alerts=_alerts(rules["data"]["alerts"] if rules else [], received or []),
        silent=tuple(silent),
    )


def _robot(said: dict[str, Any], now: float) -> Robot:
    last = said["last_message"]
    troubles = [
        Trouble(each["component"], each["level"], each["message"])
        for each in said["components"]
        if each["level"] != "OK"
    ]
    return Robot(
        said["robot"],
        bool(said["up"]),
        None if last is None else max(0.0, now - last),
        len(said["components"]),
        tuple(troubles),
    )


def _alerts(rules: list[dict[str, Any]], received: list[dict[str, Any]]) -> tuple[Alert, ...]:
    """Join both servers' alerts: the later one on the road says the state."""
    states: dict[tuple[str, str, str], str] = {}
    for each in rules:
        states[_identity(each["labels"])] = each["state"]
    for each in received:
        state = each["status"]["state"]
        states[_identity(each["labels"])] = "active" if state == "unprocessed" else state
    return tuple(Alert(*who, state) for who, state in sorted(states.items()) if who[1])


def _identity(labels: dict[str, str]) -> tuple[str, str, str]:
    return (labels["alertname"], labels.get("robot", ""), labels.get("component", ""))
