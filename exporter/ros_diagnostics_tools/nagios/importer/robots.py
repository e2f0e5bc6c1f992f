"""Hosts with ROS checks -> robots, profiles and downtimes of fleet.yml, and uplinks, as data."""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from ros_diagnostics_exporter import durations
from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.scalars import MAX_DOMAIN_ID, address, is_name, label_value
from ros_diagnostics_tools.nagios.importer import plugin
from ros_diagnostics_tools.nagios.importer.hours import Hours, hours
from ros_diagnostics_tools.nagios.importer.inheritance import Thing
from ros_diagnostics_tools.nagios.importer.ledger import Effect
from ros_diagnostics_tools.nagios.importer.links import links
from ros_diagnostics_tools.nagios.importer.site import Service, Site

UPLINK_QUERY = {  # as in docs/examples/queries/queries.d/hosts.yml
    "expr": 'min by (fleet, robot) (probe_success{job="ros-diagnostics-uplink"})',
    "component": "uplink",
    "group": "Network",
    "thresholds": {"low": {"critical": 0.5}},
    "interval": "5s",
    "confirm_after": "20s",
    "uplink": True,
}
LABELS = ("site", "team", "kind", "uplink", "robot_group")  # that the shipped rules put on alerts
NAGIOS_FLAPPING = (30.0, 20.0)  # high and low where nagios.cfg says one of them only
LEAST_FLAPPING = 0.01  # that fleet.yml takes
FRESHNESS_LATENCY = 15.0  # additional_freshness_latency where nagios.cfg does not say


@dataclass
class Robot:
    """A host that has ROS checks."""

    host: Thing
    services: list[tuple[Service, plugin.Check]]
    profile: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """The host's name."""
        return self.host.get("host_name")


def find(site: Site, plugins: tuple[str, ...]) -> list[Robot]:
    """The robots of a site; ``plugins`` (with *) are its ROS plug-ins, else by their names."""
    found: dict[str, Robot] = {}
    for service in site.services:
        line = site.command_line(service)
        command = service.thing.get("check_command").partition("!")[0]
        if line and plugin.is_ros(command, line, plugins):
            robot = found.setdefault(service.host.get("host_name"), Robot(service.host, []))
            robot.services.append((service, plugin.parse(line)))
    order = site.names("host", ["*"])
    return sorted(found.values(), key=lambda robot: order.index(robot.name))


def fleet(site: Site, robots: list[Robot], name: str, time_zone: str) -> dict[str, Any]:
    """The content of fleet.yml."""
    for robot in robots:
        robot.profile = _profile(site, robot)
    profiles = _named_profiles(robots)
    chosen = {json.dumps(content): title for title, content in profiles.items()}
    namespaces = _namespaces(robots)
    entries = [
        _robot(site, robot, namespaces[robot.name], chosen[json.dumps(robot.profile)], robots)
        for robot in robots
    ]
    downtimes = [
        entry for robot in robots if (entry := _outside_check_period(site, robot, time_zone))
    ]
    content: dict[str, Any] = {"fleet": name, "stale_is_critical": True}
    content |= _flapping(site) | {"profiles": profiles}
    uplinks = _uplinks(site, entries)
    content |= {"robots": entries + uplinks} | ({"maintenance": downtimes} if downtimes else {})
    content |= {"queries": [UPLINK_QUERY]} if uplinks else {}
    return content


def _flapping(site: Site) -> dict[str, Any]:
    """The thresholds of services for components, and for robots that come and go."""
    if not {"high_service_flap_threshold", "low_service_flap_threshold"} & site.settings.keys():
        return {}
    where = "fleet.yml: faults.flapping"
    start = site.take_number("high_service_flap_threshold", NAGIOS_FLAPPING[0], where) / 100
    stop = site.take_number("low_service_flap_threshold", NAGIOS_FLAPPING[1], where) / 100
    start, stop = (min(max(share, LEAST_FLAPPING), 1.0) for share in (start, min(stop, start)))
    return {"faults": {"flapping": {"start": start, "stop": stop}}}


# -- robots ----------------------------------------------------------------------------------


def _robot(
    site: Site, robot: Robot, namespace: str, profile: str, robots: list[Robot]
) -> dict[str, Any]:
    where = f"fleet.yml: robots[{robot.name}]"
    entry: dict[str, Any] = {"name": robot.name, "namespace": namespace}
    robot.host.take("host_name", f"{where}.name and .namespace")
    entry |= _domain(robot, where) | _address(robot.host, where)
    entry |= links(site, robot.host, [service for service, _ in robot.services], where)
    if profile != "default":
        entry["profile"] = profile
    labels = _labels(site, robot, where, robots)
    return entry | ({"labels": labels} if labels else {})


def _namespaces(robots: list[Robot]) -> dict[str, str]:
    """Of each robot the namespace: what its host or plug-in says, or its name as ROS has names."""
    found: dict[str, str] = {}
    for robot in robots:
        given = robot.host.take("_ROS_NAMESPACE", f"fleet.yml: robots[{robot.name}].namespace")
        given = given or next(
            (check.namespace for _, check in robot.services if check.namespace), ""
        )
        name = re.sub(r"\W", "_", given.strip("/") or robot.name, flags=re.ASCII)
        name = f"robot_{name}" if name[:1].isdigit() else name
        while f"/{name}" in found.values():
            name += "_"
        found[robot.name] = f"/{name}"
    return found


def _domain(robot: Robot, where: str) -> dict[str, int]:
    given = robot.host.take("_ROS_DOMAIN_ID", f"{where}.domain_id")
    given = given or next((check.domain_id for _, check in robot.services if check.domain_id), "")
    if not given:
        return {}
    if given.isdigit() and int(given) <= MAX_DOMAIN_ID:
        return {"domain_id": int(given)}
    robot.host.lose("_ROS_DOMAIN_ID", f"is not a DDS domain (0 to {MAX_DOMAIN_ID}); set domain_id")
    return {}


def _address(host: Thing, where: str) -> dict[str, str]:
    try:
        found = host.get("address")
        if found:
            host.take("address", f"{where}.address")
            return {"address": address(found)}
    except WrongValueError as error:
        host.lose("address", f"{error}: set address in fleet.yml")
    return {}


def _labels(site: Site, robot: Robot, where: str, robots: list[Robot]) -> dict[str, str]:
    found = {"robot_group": _group(site, robot, robots), "uplink": _uplink(site, robot, robots)}
    for label in LABELS:
        if robot.host.get(f"_{label.upper()}"):
            found[label] = robot.host.take(f"_{label.upper()}", f"{where}.labels.{label}")
    return {label: str(label_value(value)) for label, value in found.items() if value}


def _group(site: Site, robot: Robot, robots: list[Robot]) -> str:
    """The smallest hostgroup of a robot, because it says most; the others are reported."""
    groups = {
        name: members for name, members in site.members("host").items() if robot.name in members
    }
    names = {each.name for each in robots}
    ordered = sorted(groups, key=lambda name: len(names & set(groups[name])))
    for name in ordered:
        thing = site.find("hostgroup", name)
        if thing is not None and name == ordered[0]:
            thing.take("hostgroup_name", "fleet.yml: the label robot_group of its robots")
        elif thing is not None:
            thing.lose(
                "hostgroup_name",
                f"robot {robot.name} has the label robot_group {ordered[0]}, and a robot has "
                "one: add a label of your own in fleet.yml if queries need this group",
            )
    return ordered[0] if ordered else ""


def _uplink(site: Site, robot: Robot, robots: list[Robot]) -> str:
    names = {each.name for each in robots}
    uplink = ""
    for parent in robot.host.list("parents"):
        if not uplink and parent not in names and _can_be_uplink(site, parent):
            uplink = parent
            robot.host.take("parents", f"fleet.yml: robots[{robot.name}].labels.uplink")
        else:
            robot.host.lose(
                "parents",
                f"{parent}: a robot has one uplink, a host that is not a robot; check the label",
            )
    return uplink


def _can_be_uplink(site: Site, name: str) -> bool:
    """Whether it is a host whose name can be an entry's, and its address where it has no other."""
    try:
        address(name)
    except WrongValueError:
        return False
    return is_name(name) and site.find("host", name) is not None


def _uplinks(site: Site, robots: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Entries of what robots are reached through, and of what that is reached through."""
    names = {each["name"] for each in robots}
    wanted = [each["labels"]["uplink"] for each in robots if "uplink" in each.get("labels", {})]
    found = []
    while wanted:
        name = wanted.pop(0)
        host = site.find("host", name)
        if name in names or host is None:
            continue
        names.add(name)
        where = f"fleet.yml: robots[{name}]"
        host.take("host_name", f"{where}.name")
        entry: dict[str, Any] = {"name": name, "source": "queries", "address": name}
        entry |= _address(host, where)
        for parent in host.list("parents"):
            if "labels" not in entry and _can_be_uplink(site, parent):
                host.take("parents", f"{where}.labels.uplink")
                entry["labels"] = {"uplink": parent}
                wanted.append(parent)
            else:
                host.lose("parents", f"{parent}: what is reached has one uplink; check the label")
        found.append(entry)
    return found


def _outside_check_period(site: Site, robot: Robot, time_zone: str) -> dict[str, Any] | None:
    """Outside of its check_period Nagios judges nothing of a host: a weekly downtime."""
    period = robot.host.get("check_period")
    found: Hours = hours(site, period)
    weekly = found.outside()
    robot.host.take(
        "check_period", "fleet.yml: maintenance" if weekly else "robots are always judged"
    )
    if found.muted or found.added:
        robot.host.lose(
            "check_period",
            f"the dates of {period}: add them to maintenance by hand",
            Effect.OTHERWISE,
        )
    if not weekly:
        return None
    return {
        "name": f"{robot.name} outside of {period}".replace("/", "-")[:128],
        "selector": {"robot": robot.name},
        "comment": f"check_period {period} in Nagios",
        "weekly": weekly,
        "time_zone": time_zone,
    }


# -- profiles --------------------------------------------------------------------------------


def _named_profiles(robots: list[Robot]) -> dict[str, dict[str, Any]]:
    """The distinct profiles; ``default`` if there is one only, else by template or robot."""
    distinct: dict[str, tuple[dict[str, Any], Robot]] = {}
    for robot in robots:
        distinct.setdefault(json.dumps(robot.profile), (robot.profile, robot))
    if len(distinct) == 1:
        return {"default": robots[0].profile}
    named: dict[str, dict[str, Any]] = {}
    for content, robot in distinct.values():
        title = robot.host.definition.value("use").partition(",")[0].strip() or robot.name
        title = (
            title if is_name(title) and title not in {"default", *named} else f"like {robot.name}"
        )
        named[title] = content
    return named


def _profile(site: Site, robot: Robot) -> dict[str, Any]:
    """The times and checks of one robot."""
    profile = confirm_after(site, robot.host, "fleet.yml: profiles.*.confirm_after")
    checks: dict[str, dict[str, Any]] = {}
    rules: dict[str, dict[str, Any]] = {}
    every: list[dict[str, Any]] = []
    plain: list[dict[str, Any]] = []
    values: list[dict[str, Any]] = []
    for service, check in robot.services:
        rule = _rule(site, service, robot)
        name = _check_name(service, check)
        values += (each for each in _values(service, check) if each not in values)
        if check.words.lower() in plugin.EVERYTHING:
            every.append(rule)
        else:
            # Where no sensor matches, the plug-in is CRITICAL.
            checks[name] = {"match": [check.words], "expect": 1}
            _overlap(service, check.words, rules)
            rules.setdefault(check.words, rule)
            plain.append(rule)
    common = _most_common(every or plain)
    longest_first = sorted(rules, key=lambda words: (-len(words), words))
    specific = [{"match": words, **rules[words]} for words in longest_first]
    if all(rules[words] == common for words in rules):
        specific = []
    if common not in ({}, profile):
        specific.append({"match": {"regex": ".*"}, **common})
    return {
        **profile,
        **({"checks": checks} if checks else {}),
        **({"components": specific} if specific else {}),
        **({"values": values} if values else {}),
    }


def _most_common(rules: list[dict[str, Any]]) -> dict[str, Any]:
    """What most say; of those that as many say, the one that confirms last."""
    counted = Counter(json.dumps(each) for each in rules)
    most = [text for text, count in counted.items() if count == max(counted.values())]
    found: list[dict[str, Any]] = [json.loads(each) for each in most]
    return max(found, key=lambda rule: durations.parse(rule.get("confirm_after", "0s")))


def _overlap(service: Service, words: str, rules: dict[str, dict[str, Any]]) -> None:
    others = [
        each for each in rules if each.lower() in words.lower() or words.lower() in each.lower()
    ]
    for other in others:
        service.thing.lose(
            "check_command",
            f"its filter {words} and {other} of another service match the same components: "
            "times and contacts are those of the longer filter",
            Effect.OTHERWISE,
        )


def check_name(service: Service) -> str:
    """The name in fleet.yml of the check of a service; `all` is taken."""
    name = service.name.replace("/", "-").strip()[:128]
    return f"{name} in Nagios" if name == "all" else name


def _check_name(service: Service, check: plugin.Check) -> str:
    """The name of the check of a service; its lines are accounted for."""
    thing = service.thing
    host = service.host
    name = check_name(service)
    if check.words.lower() in plugin.EVERYTHING:
        thing.take("check_command", "fleet.yml: the check all, which every profile has")
        thing.lose("service_description", "a check without a filter is called all here")
    else:
        thing.take("check_command", f"fleet.yml: profiles.*.checks[{name}]")
        thing.take("service_description", f"fleet.yml: profiles.*.checks[{name}]")
    if check.host not in ("", host.get("host_name"), host.get("address")):
        thing.lose(
            "check_command",
            f"it asks {check.host}, not its host: declare a robot for {check.host}",
            Effect.NO_LONGER,
        )
    if check.timeout:
        _lose_arguments(thing, f"-t {check.timeout}", Effect.INFORMATION)
    if rest := check.without(host.get(key) for key in ("host_name", "address", "_ROS_NAMESPACE")):
        is_option = all(each.startswith("-") for each in rest)
        part = Effect.INFORMATION if is_option else Effect.OTHERWISE
        _lose_arguments(thing, " ".join(rest), part)
    return name


def _lose_arguments(thing: Thing, text: str, part: Effect) -> None:
    thing.lose("check_command", f"not translated of the plug-in's arguments: {text}", part)


def _values(service: Service, check: plugin.Check) -> list[dict[str, Any]]:
    """The thresholds of a plug-in's key as those of a value; reported where there are none."""
    if not check.warning and not check.critical:
        return []
    found = plugin.thresholds(check.warning, check.critical)
    if found is None or not check.key:
        _lose_arguments(
            service.thing,
            " ".join(
                f"{option} {value}"
                for option, value in (
                    ("-k", check.key),
                    ("-w", check.warning),
                    ("-c", check.critical),
                )
                if value
            )
            + ": write thresholds of a value in fleet.yml",
            Effect.NO_LONGER,
        )
        return []
    service.thing.take("check_command", "fleet.yml: profiles.*.values")
    every = check.words.lower() in plugin.EVERYTHING
    component = {} if every else {"component": check.words}
    return [{**component, "key": f"{check.key}*", "thresholds": found}]


def _rule(site: Site, service: Service, robot: Robot) -> dict[str, Any]:
    where = "fleet.yml: profiles.*.components"
    rule = confirm_after(site, service.thing, f"{where}.confirm_after")
    fresh = _stale_after(site, service.thing, f"{where}.stale_after")
    if fresh:
        rule["stale_after"] = durations.written(fresh)
    period = service.thing.get("check_period")
    if period and period != robot.host.get("check_period") and not hours(site, period).always:
        service.thing.lose(
            "check_period",
            "a downtime in fleet.yml is one of the whole robot: add it to maintenance",
            Effect.OTHERWISE,
        )
    elif period:
        service.thing.take("check_period", "that of its host")
    return rule


def confirm_after(site: Site, thing: Thing, where: str) -> dict[str, Any]:
    """Nagios' time from the first bad check to the hard state, or to its delayed notification."""
    keys = ("max_check_attempts", "retry_interval", "first_notification_delay")
    if "max_check_attempts" not in thing:
        return {}
    attempts = thing.number("max_check_attempts", 1)
    retry = site.seconds(thing.number("retry_interval", 1))
    delay = site.seconds(thing.number("first_notification_delay", 0))
    for key in keys:
        thing.take(key, f"{where} (retry_interval x (max_check_attempts - 1), or the delay)")
    return {"confirm_after": durations.written(max(retry * (max(int(attempts), 1) - 1), delay, 0))}


def _stale_after(site: Site, thing: Thing, where: str) -> float:
    if thing.get("check_freshness") != "1":
        return 0.0
    if site.setting("check_service_freshness", "1") != "1":
        thing.lose("check_freshness", "check_service_freshness is 0, so Nagios does not look at it")
        return 0.0
    thing.take("check_freshness", where)
    threshold = thing.number("freshness_threshold", 0)
    if threshold:
        thing.take("freshness_threshold", where)
        return threshold
    latency = site.take_number("additional_freshness_latency", FRESHNESS_LATENCY, where)
    thing.take("check_interval", f"{where} (check_interval and additional_freshness_latency)")
    return site.seconds(thing.number("check_interval", 5)) + latency
