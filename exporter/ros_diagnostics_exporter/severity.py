"""The states and problems of robots and components in words and colours, and which is worse.

The page, the status command and the Nagios plug-in show them alike. Words and severities are those
of the recording rules: STALE has the level 3, but is less severe than ERROR unless fleet.yml
configures otherwise. Fleets, robots and components are given as /api/v1/fleet returns them.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from types import MappingProxyType
from typing import Any, NamedTuple

from ros_diagnostics_exporter.fleet_texts import maintenance_text, span
from ros_diagnostics_exporter.texts import natural, unique_without_node

SEVERITIES = {  # the ranks of metrics and of prometheus/rules/states.yml
    "CRITICAL": 6,
    "SILENT": 5,
    "UNREACHABLE": 3,
    "STALE": 2,
    "FLAPPING": 1.5,
    "WARNING": 1,
    "OK": 0,
    "PENDING": -1,
}
STATE_OF_LEVEL = {"OK": "OK", "WARN": "WARNING", "ERROR": "CRITICAL", "STALE": "STALE"}
# State -> colour and that of a text on it; the same as the dashboards', for the colour-blind too.
COLOURS = {
    "CRITICAL": ("#C1121F", "#FFFFFF"),
    "SILENT": ("#1B3A86", "#FFFFFF"),
    "UNKNOWN": ("#3D3D3D", "#FFFFFF"),
    "UNREACHABLE": ("#90BEF8", "#000000"),
    "STALE": ("#9350C9", "#FFFFFF"),
    "FLAPPING": ("#FFA55A", "#000000"),
    "WARNING": ("#FFD92F", "#000000"),
    "OK": ("#1F7F63", "#FFFFFF"),
    "PENDING": ("#D0D0D0", "#000000"),
}
# Why a problem is suppressed; maintenance is shown with its end, a condition in its words.
SUPPRESSED = {
    "no_data": "no recent data",
    "robot_silent": "the robot is silent",
    "unreachable": "the robot's uplink or its DDS domain fails",
    "maintenance": "maintenance",
    "restart": "the exporter has just started",
    "returned": "the robot has just come back",
    "flapping": "it is flapping",
    "robot_flapping": "the robot comes and goes",
    "site": "many robots of the site are silent",
    "common": "the same component failed on many robots",
    "many": "many components of the robot failed at once",
    "depends_on": "a component that it depends on fails",
    "capability": "a capability that needs it is reported",
    "fault": "a worse fault of it is confirmed",
    "condition": "by its condition in fleet.yml",
    "hours": "outside of warning hours",
}
# Reasons: it is part of a larger fault.
OF_LARGER = {"site", "common", "many", "depends_on", "capability"}
SILENT = {  # why a robot is silent
    "never_seen": "nothing was ever received",
    "publisher_gone": "nobody publishes on its topics",
    "mute": "its publisher sends nothing",
    "undecodable": "its messages cannot be decoded",
    "wrong_type": "its topics have another type",
    "incompatible_qos": "the QoS of its publishers matches no subscription of ROS",
    "unreachable": "what connected it by zenoh is gone: its bridge, or the network",
    "domain_unreachable": "its DDS domain cannot be joined, or no zenoh router answers",
    "uplink_down": "its uplink does not answer",
}
_OF_ROBOT = {
    "silent": "robot is silent",
    "pending": "robot was never received",
    "flapping": "robot comes and goes",
    "many": "many components failed at once",
    "clock": "robot's clock is wrong",
}
_OF_CAPABILITY = {
    "no_reserve": "has no reserve",
    "degraded": "is degraded",
    "lost": "is lost",
}
OF_CAPABILITY_STATE = {  # of a capability, as the API has it -> state with the same colour, words
    "ok": ("OK", ""),
    "no_reserve": ("WARNING", "no reserve"),
    "degraded": ("WARNING", "degraded"),
    "lost": ("CRITICAL", "lost"),
    "unknown": ("UNKNOWN", "not known"),
}
_OF_REASON = {  # all others: SILENT
    "never_seen": "PENDING",
    "uplink_down": "UNREACHABLE",
    "domain_unreachable": "UNREACHABLE",
}
# All others by their severity.
_OF_STATE = {"silent": "SILENT", "pending": "PENDING", "flapping": "FLAPPING"}
_WORSE = {
    "warning": ("stale", "critical"),
    "stale": ("critical",),
    "falling": ("warning", "critical"),
    "no_reserve": ("degraded", "lost"),
    "degraded": ("lost",),
}


class ShownProblem(NamedTuple):
    """A problem in words: ``standing`` says whether it is confirmed, or why it is suppressed.

    ``notice`` says who was notified and when; "" where that is not known.

    ``state`` is one of SEVERITIES, ``since`` Unix time, ``problem`` as the API has it.
    """

    state: str
    subject: str
    standing: str
    since: float
    message: str
    problem: dict[str, Any]
    notice: str = ""


def component_state(level: str, before_stale: str | None, *, stale_is_critical: bool) -> str:
    """A component's state in one word. An ERROR that fell silent is still CRITICAL.

    ``stale_is_critical`` is to be False for a component whose STALE is planned.
    """
    if level == "STALE" and (stale_is_critical or before_stale == "ERROR"):
        return "CRITICAL"
    return STATE_OF_LEVEL[level]


def is_robot(entry: dict[str, Any]) -> bool:
    """Whether an entry of `robots` has a place in ROS; an access point has none."""
    return entry["domain_id"] is not None


def state_of(robot: dict[str, Any]) -> str:
    """A robot's state in one word, as prometheus/rules/states.yml has it for the dashboards.

    SILENT is not received, PENDING never was, and UNREACHABLE is one that is not received because
    of its uplink or its DDS domain. What is FLAPPING is so in all of its levels.
    """
    faults = [each for each in robot["problems"] if each["confirmed"] is not None]
    flapping = {
        (each["scope"], each["group"], each["component"])
        for each in faults
        if each["state"] == "flapping"
    }
    if not robot["up"]:
        silent = silent_state(robot["silent_reason"])
        return "FLAPPING" if silent == "SILENT" and ("robot", "", "") in flapping else silent
    # With a fault it is not OK, though no level says so, as of a value, or while a component flaps.
    words = [problem_state(each) for each in faults]
    words += [
        judged_state(each)
        for each in robot["components"]
        if ("flapping", each["group"], each["component"]) not in flapping
    ]
    return max(words, key=SEVERITIES.__getitem__, default="OK")


def silent_state(reason: str | None) -> str:
    """The state of a robot that is not received for this reason."""
    return _OF_REASON.get(reason or "", "SILENT")


def problem_state(problem: dict[str, Any]) -> str:
    """A problem's state in one word of SEVERITIES: a robot that is not received is SILENT."""
    state: str = problem["state"]
    if state == "silent" and problem.get("suppressed") == "unreachable":
        return "UNREACHABLE"
    return _OF_STATE.get(state) or ("STALE" if state == "stale" else problem["severity"].upper())


def as_planned(component: dict[str, Any]) -> bool:
    """Whether the component is STALE because fleet.yml plans it."""
    return bool(component["planned_stale"]) and component["state"] == "STALE"


def judged_state(component: dict[str, Any]) -> str:
    """The component's state; OK where fleet.yml says that it is no fault."""
    suppressed = as_planned(component) or component.get("suppressed_because")
    return "OK" if suppressed else str(component["state"])


def is_bad(problem: dict[str, Any]) -> bool:
    """Whether it is still wrong, and no condition of fleet.yml says that it is no fault."""
    return not problem["healthy"] and problem["suppressed"] != "condition"


def level_text(component: dict[str, Any]) -> str:
    """The component's level, and what it counts as where that is another."""
    level, state = component["level"], component["state"]
    return f"{level}, counts as {state}" if state != STATE_OF_LEVEL[level] else str(level)


def shown_problems(
    owner: dict[str, Any], now: float, limit: int, *, local: bool = False
) -> tuple[list[ShownProblem], int]:
    """The problems of a robot, or those of the whole fleet: the worst ones, and how many there are.

    Left out are those that go on under a worse one of the same component or value, and STALE of a
    silent robot's components, which say no more than its silence.

    Args:
        owner: The robot or the fleet.
        now: When the fleet was as given, Unix time.
        limit: How many problems are returned at most.
        local: Whether times are those of this machine's time zone; else UTC.
    """
    if not owner["problems"]:
        return [], 0
    found = list(_without_milder(owner["problems"]))
    found.sort(
        key=lambda each: (
            -SEVERITIES[problem_state(each)],
            standing(each, now, owner, local=local),
            natural(subject(each)),
        )
    )
    return shown_as_they_are(found[:limit], owner, now, local=local), len(found)


def shown_as_they_are(
    problems: Iterable[dict[str, Any]], owner: dict[str, Any], now: float, *, local: bool = False
) -> list[ShownProblem]:
    """These problems of a robot, or of the whole fleet; arguments as for `shown_problems`."""
    components = {(each["group"], each["component"]): each for each in owner.get("components", ())}
    checks = {each["check"]: each for each in owner.get("short_checks", ())}
    short = short_names(owner)
    return [
        ShownProblem(
            problem_state(each),
            subject(each, short),
            standing(each, now, owner, local=local),
            each["since"],
            _message(each, owner, components.get((each["group"], each["component"])), checks),
            each,
            notice(each, now),
        )
        for each in problems
    ]


def _without_milder(problems: list[dict[str, Any]]) -> Iterable[dict[str, Any]]:
    bad = {(_about(each), each["state"]) for each in problems if not each["healthy"]}
    severe = {
        _about(each) for each in problems if each["severity"] == "critical" and not each["healthy"]
    }
    for each in problems:
        about = _about(each)
        worse = any((about, state) in bad for state in _WORSE.get(each["state"], ()))
        milder = each["state"] == "many" and each["severity"] == "warning" and about in severe
        absent = each["state"] == "stale" and each["suppressed"] == "robot_silent"
        if not (worse or milder or absent):
            yield each


def _about(problem: dict[str, Any]) -> tuple[str, ...]:
    names = ("scope", "robot", "group", "component", "check", "key", "bound")
    # A fault has the site of its robot, and a problem that is no fault yet has none.
    site = problem["site"] if problem["scope"] == "site" else ""
    many = "many" if problem["state"] == "many" else ""
    return (*(problem[name] for name in names), site, many)


def subject(problem: dict[str, Any], short: Mapping[str, str] = MappingProxyType({})) -> str:
    """What a problem is about, as "/Motor/Motor 1"; its robot is not named.

    ``short`` are the `short_names` of its robot.
    """
    path = component_path(problem)
    path = short.get(path, path)
    return {
        "component": path,
        "value": f"{path}: {problem['key']}",
        "check": f"check {problem['check']}",
        "capability": f"{problem['check']} {_OF_CAPABILITY.get(problem['state'], '')}".rstrip(),
        "robot": _OF_ROBOT.get(problem["state"], "robot"),
        "flapping": path,
        "site": f"many robots of site {problem['site'] or '(none)'} are silent",
        "common": f"{problem['component']} of many robots",
        "exporter": f"exporter: {problem['component']}",
    }[problem["scope"]]


def component_path(component: dict[str, Any]) -> str:
    """The component with its group, as "/Motor/Motor 1".

    A raw component's group is its node, which is in its name: "arm: Motor 1".
    """
    group, name = component.get("group", ""), component.get("component", "")
    if name.startswith(f"{group}: "):
        return str(name)
    return f"{group.rstrip('/')}/{name.lstrip('/')}" if group else str(name)


def short_names(owner: dict[str, Any]) -> dict[str, str]:
    """The path of each component -> its name, without node and group where the rest is unique."""
    of_problems = (each for each in owner["problems"] if each["component"])
    found = [*owner.get("components", ()), *of_problems]
    names = {component_path(each): each["component"] for each in found}
    short, whole = unique_without_node(names.values()), Counter(names.values())
    return {
        path: short.get(name, name if whole[name] == 1 else path) for path, name in names.items()
    }


def part_path(part: dict[str, Any]) -> str:
    """A part of a capability: a component, with the key of a value, or a check; or a robot."""
    if part["robot"]:
        return f"{part['check']} of {part['robot']}"
    if part["check"]:
        return f"check {part['check']}"
    return f"{component_path(part)}{part['key'] and ': '}{part['key']}"


def standing(
    problem: dict[str, Any], now: float, owner: dict[str, Any], *, local: bool = False
) -> str:
    """Whether a problem is confirmed, and else when it may be, or why it is suppressed.

    ``owner`` is the robot, or the fleet; ``local`` as for `shown_problems`.
    """
    reason = problem["suppressed"]
    suppressed = SUPPRESSED.get(reason, reason)
    if reason == "maintenance":
        suppressed = maintenance_text(owner, now, component=problem["component"], local=local)
    if problem.get("because"):
        suppressed = f"{suppressed}, {problem['because']}"
    if problem["confirmed"] is not None:
        return f"recovered; it stays open: {suppressed}" if suppressed else "confirmed"
    if suppressed:
        return f"suppressed: {suppressed}"
    left = math.ceil(problem["due"] - now)
    return f"not confirmed yet, {span(left)} left" if left > 0 else "not confirmed yet"


def notice(problem: dict[str, Any], now: float) -> str:
    """Who takes care of a problem, which receivers were notified of it, and when the last of them.

    "" if that is not known.
    """
    if problem["confirmed"] is None:
        if problem["suppressed"] in OF_LARGER:
            return "one notification for all"
        return "nobody is notified" if problem["suppressed"] else ""
    return "; ".join(filter(None, (_taken(problem), _notified(problem, now))))


def _taken(problem: dict[str, Any]) -> str:
    taken = problem.get("acknowledged")
    return f"acknowledged by {taken['author']}: {taken['comment']}" if taken else ""


def _notified(problem: dict[str, Any], now: float) -> str:
    notified = problem.get("notified")
    if notified is None:
        return ""
    if not notified:
        return "not notified yet"
    return f"notified {span(now - max(notified.values()))} ago: {', '.join(sorted(notified))}"


def _message(
    problem: dict[str, Any],
    owner: dict[str, Any],
    component: dict[str, Any] | None,
    checks: dict[str, dict[str, Any]],
) -> str:
    """What is known of it now, else what was when it was confirmed."""
    scope, state = problem["scope"], problem["state"]
    if component is not None and not problem["healthy"]:
        if scope == "flapping":
            return _changing_text(state, component)
        if scope == "value":
            return value_text(problem, component) or str(problem["evidence"])
        return component_text(component)
    if scope == "check" and problem["check"] in checks:
        short = checks[problem["check"]]
        return f"finds {short['found']} of {short['expected']}"
    if scope == "robot" and state in {"silent", "pending"}:
        known = silent_text(owner["silent_reason"]) or str(problem["evidence"])
        return (
            known
            if problem["suppressed"] != "restart"
            else "not received since the exporter started"
        )
    return str(problem["evidence"])


def _changing_text(state: str, component: dict[str, Any]) -> str:
    if state == "intermittent":
        return f"intermittent: {component_text(component)}"
    return f"flapping: {component['flap_ratio']:.0%} of its last states were changes"


def component_text(component: dict[str, Any]) -> str:
    """The component's message, after its level where that is not its state or has a history."""
    level, before = level_text(component), component["level_before_stale"]
    if before:
        level += f" (was {before})"
    elif component["level"] != "STALE" and component["state"] == STATE_OF_LEVEL[component["level"]]:
        level = ""
    return ": ".join(filter(None, (level, component["message"])))


def silent_text(reason: str | None) -> str:
    """Why a robot is silent, in words and as the metrics name it; "" for one that is up."""
    if reason is None:
        return ""
    return f"{SILENT[reason]} ({reason})" if reason in SILENT else reason


def value_text(problem: dict[str, Any], component: dict[str, Any]) -> str:
    """The value that is beyond a threshold, as "9.5 V, low threshold 10"; "" if it has none now."""
    for value in component["values"]:
        for each in value.get("thresholds", ()):
            is_it = (value["key"], each["bound"], each["severity"]) == (
                problem["key"],
                problem["bound"],
                "critical" if problem["state"] == "falling" else problem["severity"],
            )
            if is_it and value["number"] is not None:
                unit = f" {value['unit']}" if value["unit"] else ""
                return f"{value['number']:g}{unit}, {each['bound']} threshold {each['value']:g}"
    return ""
