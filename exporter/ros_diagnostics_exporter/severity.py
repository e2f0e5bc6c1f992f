"""The states of robots and components in words, and which is worse.

Words and severities are those of the recording rules: STALE has the level 3, but is less severe
than ERROR unless fleet.yml configures otherwise. Robots and components are given as /api/v1/fleet
returns them.
"""

from __future__ import annotations

from typing import Any

SEVERITIES = {"UNKNOWN": 4, "CRITICAL": 3, "STALE": 2, "WARNING": 1, "OK": 0, "PENDING": -1}
STATE_OF_LEVEL = {"OK": "OK", "WARN": "WARNING", "ERROR": "CRITICAL", "STALE": "STALE"}


def component_state(level: str, before_stale: str | None, *, stale_is_critical: bool) -> str:
    """A component's state in one word. An ERROR that fell silent is still CRITICAL.

    ``stale_is_critical`` is to be False for a component whose STALE is planned.
    """
    if level == "STALE" and (stale_is_critical or before_stale == "ERROR"):
        return "CRITICAL"
    return STATE_OF_LEVEL[level]


def state_of(robot: dict[str, Any]) -> str:
    """A robot's state in one word: UNKNOWN is silent, PENDING was never seen."""
    if not robot["up"]:
        return "PENDING" if robot["silent_reason"] == "never_seen" else "UNKNOWN"
    words = [each["state"] for each in robot["components"] if not as_planned(each)]
    words += ["CRITICAL" for _short in robot["short_checks"]]
    return max(words, key=SEVERITIES.__getitem__, default="OK")


def as_planned(component: dict[str, Any]) -> bool:
    """Whether the component is STALE because fleet.yml plans it."""
    return bool(component["planned_stale"]) and component["state"] == "STALE"


def level_text(component: dict[str, Any]) -> str:
    """The component's level, and what it counts as where that is another."""
    level, state = component["level"], component["state"]
    return f"{level}, counts as {state}" if state != STATE_OF_LEVEL[level] else str(level)


def short_check_texts(robot: dict[str, Any]) -> list[str]:
    """The robot's checks that find too few components, as "check motors finds 1 of 2"."""
    return [
        f"check {each['check']} finds {each['found']} of {each['expected']}"
        for each in robot["short_checks"]
    ]


def faults_of(robot: dict[str, Any]) -> list[dict[str, Any]]:
    """The robot's components that are not OK, and not by plan, worst first.

    All components of a silent robot are STALE because of that: only those count that were not OK
    before.
    """
    faults = [
        each for each in robot["components"] if each["level"] != "OK" and not as_planned(each)
    ]
    if not robot["up"]:
        faults = [each for each in faults if each["level_before_stale"] in {"WARN", "ERROR"}]
    return sorted(faults, key=lambda each: (-SEVERITIES[each["state"]], each["component"]))


def ago(since: float | None, now: float) -> str:
    """How long something has lasted, in the largest unit that fits; "" where that is unknown."""
    if since is None:
        return ""
    seconds = max(0, int(now - since))
    for size, unit in ((86_400, "d"), (3_600, "h"), (60, "min")):
        if seconds >= size:
            return f"for {seconds // size} {unit}"
    return f"for {seconds} s"
