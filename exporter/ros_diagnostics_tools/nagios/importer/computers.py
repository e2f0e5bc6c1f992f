"""Checks of a robot's computer (ping, ssh, load, disk) -> queries of Prometheus; and what is left.

What nobody here checks any more is in the first part of the report: the services of robots that no
query stands for, and the hosts that are no robots.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator
from pathlib import PurePath
from typing import Any, NamedTuple

from ros_diagnostics_tools.nagios.importer import plugin
from ros_diagnostics_tools.nagios.importer.inheritance import Thing
from ros_diagnostics_tools.nagios.importer.ledger import Effect
from ros_diagnostics_tools.nagios.importer.robots import Robot, confirm_after
from ros_diagnostics_tools.nagios.importer.site import Service, Site
from ros_diagnostics_tools.names import escaped

WHERE = "queries.d/hosts.yml"
_ANSWERS = {"low": {"critical": 0.5}}
_PINGED = 'unless on (fleet, robot) probe_success{job="ros-diagnostics-ping"} == 0'
_DISK = 'fstype!~"tmpfs|ramfs|devtmpfs|squashfs|iso9660|overlay"'


def _node(component: str, metric: str) -> dict[str, Any]:
    expr = f'max by (fleet, robot) ({metric}{{job="ros-diagnostics-node"}})'
    return {"expr": expr, "component": component, "confirm_after": "1m", "planned_stale": True}


def _probe(component: str) -> dict[str, Any]:
    expr = f'min by (fleet, robot) (probe_success{{job="ros-diagnostics-{component}"}})'
    found = {"expr": expr, "component": component, "thresholds": _ANSWERS, "confirm_after": "1m"}
    if component == "ping":
        return found
    return {**found, "expr": f"{expr} {_PINGED}", "planned_stale": True}


# As in docs/examples/queries/queries.d/hosts.yml.
QUERIES: dict[str, tuple[dict[str, Any], ...]] = {
    "ping": (_probe("ping"),),
    "ssh": (_probe("ssh"),),
    "http": (_probe("http"),),
    "tcp": (
        {
            "expr": 'min by (fleet, robot, port) (label_replace(probe_success{job="ros-diagnostics-'
            'tcp"}, "port", "$1", "instance", ".*:([0-9]+)"))\n' + _PINGED + "\n",
            "component": "tcp {port}",
            "thresholds": _ANSWERS,
            "confirm_after": "1m",
            "planned_stale": True,
        },
    ),
    "load": tuple(_node(f"load {each}m", f"node_load{each}") for each in (1, 5, 15)),
    "procs": (_node("processes", "node_processes_pids"),),
    "users": (
        {
            **_node("users", ""),
            "expr": "max by (fleet, robot) (sum by (fleet, robot, instance) "
            '(node_logind_sessions{job="ros-diagnostics-node", class="user"}))',
        },
    ),
    "disk": (
        {
            "expr": "min by (fleet, robot, mountpoint) (\n"
            f'    100 * node_filesystem_avail_bytes{{job="ros-diagnostics-node", {_DISK}}}\n'
            "  / (node_filesystem_size_bytes > 0)\n"
            "  unless\n    node_filesystem_readonly == 1\n)\n",
            "component": "disk {mountpoint}",
            "unit": "%",
            "confirm_after": "1m",
            "planned_stale": True,
        },
    ),
}
# Plug-ins and their other names -> the queries above.
PLUGINS = {
    **dict.fromkeys(("ping", "icmp", "fping", "host_alive", "host"), "ping"),
    **{name: name for name in ("ssh", "http", "tcp", "load", "disk", "users", "procs")},
    **dict.fromkeys(("hda1", "root", "all_disks"), "disk"),
    "total_procs": "procs",
}
# Their thresholds where a robot's own nrpe.cfg has them: those of hosts.yml.
USUAL = {
    "load": ("5,4,3", "10,6,4"),
    "disk": ("20%", "10%"),
    "users": ("20", "50"),
    "procs": ("250", "400"),
}
NO_ROBOT = (
    "not a ROS check: pings and ports are blackbox_exporter's, disks and processes node_exporter's "
    "(docs/queries.md, computers)"
)


class Asked(NamedTuple):
    """What a plug-in that is no ROS check looks at; ``rest`` are arguments that say more."""

    name: str
    warning: str
    critical: str
    is_remote: bool


def asked(line: str) -> Asked | None:
    """What a command line checks; None where no query stands for it."""
    program, options = plugin.options(line)
    name = _name(program)
    if name in ("nrpe", "by_ssh"):
        command, _ = plugin.options(options.get("-c", options.get("-C", "")))
        found = asked(options.get("-C", "")) if name == "by_ssh" else None
        known = PLUGINS.get(_name(command))
        if found is not None or known is None:
            return found
        warning, critical = USUAL.get(known, ("", ""))
        return Asked(known, warning, critical, is_remote=True)
    if name not in PLUGINS or (name == "procs" and options.keys() & {"-C", "-a", "-s", "-u"}):
        return None
    return Asked(PLUGINS[name], options.get("-w", ""), options.get("-c", ""), is_remote=False)


def _name(program: str) -> str:
    return PurePath(program).stem.lower().replace("-", "_").removeprefix("check_")


def queries(site: Site, robots: list[Robot], uplinks: Iterable[str]) -> list[dict[str, Any]]:
    """The queries for the services of robots; what has none is reported."""
    by_name = {robot.name: robot for robot in robots}
    uplinks, found = set(uplinks), dict[str, list[str]]()
    ros = {id(service) for robot in robots for service, _check in robot.services}
    for service in site.services:
        host = service.host.get("host_name")
        if id(service) in ros:
            continue
        known = asked(site.command_line(service))
        made = _made(site, service, known) if known is not None and host in by_name else []
        for query in made:
            found.setdefault(json.dumps(query), []).append(host)
        if not made:
            is_ping = known is not None and known.name == "ping" and host in uplinks
            _report(service.thing, service.host, is_answered=is_ping)
    for thing in site.all("host"):
        name = thing.get("host_name")
        if name in by_name:
            thing.lose("check_command", "a robot is SILENT where nothing is received of it")
        elif name not in uplinks:
            _report(thing, thing, is_answered=False)
    made = [_of_robots(json.loads(text), names, robots) for text, names in found.items()]
    return [*_in_groups(made, [names[0] for names in found.values()])]


def _in_groups(made: list[dict[str, Any]], first: list[str]) -> Iterator[dict[str, Any]]:
    """Queries of one component with other thresholds are in a group of their own."""
    seen = set[str]()
    for query, name in zip(made, first, strict=True):
        component = query["component"]
        yield {**query, "group": f"Host like {name}"} if component in seen else query
        seen.add(component)


def _report(thing: Thing, host: Thing, *, is_answered: bool) -> None:
    name, key = host.get("host_name"), "check_command"
    if is_answered:
        thing.lose(key, f"{name}: the query of uplinks in fleet.yml", Effect.OTHERWISE)
    elif _notifies(thing, host):
        key = key if key in thing else "host_name"
        thing.lose(key, f"{name}: nobody is notified of it: {NO_ROBOT}", Effect.NO_LONGER)


def _notifies(thing: Thing, host: Thing) -> bool:
    """Whether Nagios notifies anybody of it."""
    keys = ("contacts", "contact_groups")
    source = thing if any(key in thing for key in keys) else host
    return thing.get("notifications_enabled") != "0" and any(key in source for key in keys)


def _made(site: Site, service: Service, known: Asked) -> list[dict[str, Any]]:
    """The queries for a service, with its thresholds; none where those cannot be said."""
    of_check = QUERIES[known.name]
    thing = service.thing
    limits = [_thresholds(known, number) for number in range(len(of_check))]
    if any(each is None for each in limits):
        return []
    time = confirm_after(site, thing, f"{WHERE}: confirm_after")
    remedy = f"{WHERE}, component {', '.join(each['component'] for each in of_check)}"
    if known.is_remote:
        remedy += ", with the usual thresholds: yours are on the robot, in nrpe.cfg"
    elif known.name == "ping" and known.warning:
        remedy += ": whether it answers, not how fast"
    job = "blackbox_exporter" if "thresholds" in of_check[0] else "node_exporter"
    thing.lose("check_command", f"{remedy}; needs {job} (docs/queries.md)", Effect.OTHERWISE)
    made = zip(of_check, limits, strict=True)
    return [{**each, **({"thresholds": limit} if limit else {}), **time} for each, limit in made]


def _thresholds(known: Asked, number: int) -> dict[str, Any] | None:
    """The thresholds of one of a check's queries; {}: those that it has; None: there are none."""
    if "thresholds" in QUERIES[known.name][number]:
        return {}
    texts = [text.split(",") for text in (known.warning, known.critical)]
    warning, critical = (each[min(number, len(each) - 1)].strip() for each in texts)
    if known.name == "disk":
        if not all(re.fullmatch(r"\d+(\.\d+)?%", each) for each in (warning, critical) if each):
            return None  # in megabytes, of which the query knows nothing
        warning, critical = (f"{each.rstrip('%')}:" if each else "" for each in (warning, critical))
    return plugin.thresholds(warning, critical)


def _of_robots(query: dict[str, Any], names: list[str], robots: list[Robot]) -> dict[str, Any]:
    """The query, of some robots only where not all have the check."""
    if set(names) >= {robot.name for robot in robots}:
        return query
    some = "|".join(escaped(each).replace("\\", "\\\\") for each in names)
    job = re.compile(r'(job="ros-diagnostics-\w+")')
    return {**query, "expr": job.sub(lambda found: f'{found[1]}, robot=~"{some}"', query["expr"])}
