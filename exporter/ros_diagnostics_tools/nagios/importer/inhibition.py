"""Dependencies of hosts and services -> Alertmanager's inhibit rules."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

from ros_diagnostics_tools.nagios.importer import plugin
from ros_diagnostics_tools.nagios.importer.inheritance import Thing
from ros_diagnostics_tools.nagios.importer.ledger import Effect
from ros_diagnostics_tools.nagios.importer.robots import Robot
from ros_diagnostics_tools.nagios.importer.routes import parts
from ros_diagnostics_tools.nagios.importer.site import Site

WHERE = "alertmanager-routes.yml: inhibit_rules"
# The letters of failure criteria -> the alerts that inhibit.
HOST_FAILURES = {"d": "RosDiagnosticsRobotSilent", "p": "RosDiagnosticsRobotPending"}
SERVICE_FAILURES = {
    "w": "RosDiagnosticsComponentWarning",
    "c": "RosDiagnosticsComponent(Critical|Stale)",
}
NO_RULE = (
    "no inhibit rule: no two robots, or checks of robots, depend on an alert that there is here"
)
Rule = dict[str, Any]


def rules(site: Site, robots: list[Robot]) -> list[Rule]:
    """One inhibit rule for each pair that depends."""
    by_name = {robot.name: robot for robot in robots}
    found: list[Rule] = []
    for kind, rules_of in (("hostdependency", _of_hosts), ("servicedependency", _of_services)):
        for thing in site.all(kind):
            made = list(rules_of(site, thing, by_name))
            if not made:
                thing.withdraw(WHERE, NO_RULE)
            found += made
    return found


def _of_hosts(site: Site, thing: Thing, robots: dict[str, Robot]) -> Iterator[Rule]:
    failures = _failures(thing, HOST_FAILURES)
    for master, dependent in _pairs(site, thing, robots):
        if failures and master != dependent:
            yield {
                "source_matchers": [f'alertname =~ "{failures}"', f'robot = "{master}"'],
                "target_matchers": ['alertname =~ "RosDiagnostics.*"', f'robot = "{dependent}"'],
                "equal": ["fleet"],
            }


def _of_services(site: Site, thing: Thing, robots: dict[str, Robot]) -> Iterator[Rule]:
    failures = _failures(thing, SERVICE_FAILURES)
    same = "dependent_host_name" not in thing and "dependent_hostgroup_name" not in thing
    for master, dependent in _pairs(site, thing, robots):
        if not failures or (same and master != dependent):
            continue
        sources = _filters(robots[master], thing, "service_description")
        targets = _filters(robots[dependent], thing, "dependent_service_description")
        for source, target in product(sources, targets):
            yield {
                "source_matchers": [f'alertname =~ "{failures}"', f'robot = "{master}"', *source],
                "target_matchers": [
                    'alertname =~ "RosDiagnosticsComponent.*"',
                    f'robot = "{dependent}"',
                    *target,
                ],
                "equal": ["fleet"],
            }


def _pairs(site: Site, thing: Thing, robots: dict[str, Robot]) -> Iterator[tuple[str, str]]:
    masters = site.hosts_of(thing, WHERE)
    dependents = site.hosts_of(thing, WHERE, "dependent_") or masters
    for host in (*masters, *dependents):
        if host not in robots:
            for key in (
                "host_name",
                "hostgroup_name",
                "dependent_host_name",
                "dependent_hostgroup_name",
            ):
                thing.lose(
                    key,
                    f"{host} is not a robot: if robots are reached through it, it is their uplink",
                )
    for master, dependent in product(masters, dependents):
        if master in robots and dependent in robots:
            yield master, dependent


def _failures(thing: Thing, alerts: dict[str, str]) -> str:
    """The alerts of the notification criteria, as a regular expression."""
    letters = [each[:1] for each in thing.list("notification_failure_criteria")]
    thing.take("notification_failure_criteria", WHERE)
    unknown = [each for each in letters if each not in alerts and each != "n"]
    if unknown:
        thing.lose(
            "notification_failure_criteria",
            f"{','.join(unknown)}: there is no alert for these states; o, up and ok are no alerts, "
            "and of an unreachable robot no fault begins: that of its uplink does",
            Effect.OTHERWISE,
        )
    return "|".join(alerts[each] for each in letters if each in alerts)


def _filters(robot: Robot, thing: Thing, key: str) -> list[list[str]]:
    wanted = thing.list(key)
    thing.take(key, WHERE)
    found = [
        "" if check.words.lower() in plugin.EVERYTHING else check.words
        for service, check in robot.services
        if service.name in wanted or "*" in wanted
    ]
    if not found:
        thing.lose(key, f"{robot.name} has no ROS check of this name")
    return [part for words in found for part in parts(words)]
