"""What changed between two looks at the road, in sentences."""

from __future__ import annotations

from collections.abc import Iterator

from demo.observation import Alert, Robot, Sight

ALERT_NEWS = {
    "pending": "Prometheus: {alert} is pending",
    "firing": "Prometheus: {alert} fires",
    "active": "Alertmanager: {alert} has arrived",
    "suppressed": "Alertmanager: {alert} has arrived, inhibited by a worse one",
}


def changes(before: Sight, now: Sight) -> Iterator[str]:
    """Yield a sentence for each change of a server, a robot, a component or an alert."""
    for name in sorted(set(now.silent) - set(before.silent)):
        yield f"{name} does not answer"
    for name in sorted(set(before.silent) - set(now.silent)):
        yield f"{name} answers again"
    known = {robot.name: robot for robot in before.robots}
    for robot in now.robots:
        if robot.name in known:
            yield from _robot_changes(known[robot.name], robot)
    yield from _alert_changes(before, now)


def _robot_changes(before: Robot, now: Robot) -> Iterator[str]:
    if before.up != now.up:
        yield f"exporter: {now.name} {'is heard again' if now.up else 'is silent'}"
    old = {each.component: each for each in before.troubles}
    new = {each.component: each for each in now.troubles}
    for component, trouble in new.items():
        if component not in old or old[component].level != trouble.level:
            yield f"exporter: {now.name} {component} is {trouble.level}: {trouble.message}"
    for component in old.keys() - new.keys():
        yield f"exporter: {now.name} {component} is OK again"


def _alert_changes(before: Sight, now: Sight) -> Iterator[str]:
    old = {each.identity: each for each in before.alerts}
    for alert in now.alerts:
        earlier = old.pop(alert.identity, None)
        if earlier is None or earlier.state != alert.state:
            yield ALERT_NEWS[alert.state].format(alert=_sentence(alert))
    if not {"Prometheus", "Alertmanager"} & set(now.silent):  # else their alerts are just not seen
        for alert in old.values():
            yield f"Alertmanager: {_sentence(alert)} is over"


def _sentence(alert: Alert) -> str:
    return " ".join(part for part in (alert.name, alert.robot, alert.component) if part)
