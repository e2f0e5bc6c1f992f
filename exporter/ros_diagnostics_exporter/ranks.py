"""What a robot's state is called for people, from the fleet as /api/v1/fleet shows it.

The words and ranks are those of the recording rules: STALE has the number 3 as a level, and is
milder than an ERROR all the same.
"""

from __future__ import annotations

import re
from typing import Any

RANKS = {"UNKNOWN": 4, "CRITICAL": 3, "STALE": 2, "WARNING": 1, "OK": 0, "PENDING": -1}
OF_LEVEL = {"OK": "OK", "WARN": "WARNING", "ERROR": "CRITICAL", "STALE": "STALE"}


def state_of(robot: dict[str, Any]) -> str:
    """A robot's state in one word: UNKNOWN is silent, PENDING was never seen."""
    if not robot["up"]:
        return "PENDING" if robot["silent_reason"] == "never_seen" else "UNKNOWN"
    words = (OF_LEVEL[component["level"]] for component in robot["components"])
    return max(words, key=RANKS.__getitem__, default="OK")


def natural(name: str) -> list[tuple[int, str]]:
    """A key that sorts robot_2 before robot_10."""
    parts = re.split(r"([0-9]+)", name)
    return [(int(part), "") if part[:1].isdecimal() else (-1, part) for part in parts]


def faults_of(robot: dict[str, Any]) -> list[dict[str, Any]]:
    """The robot's components that are not OK, worst first.

    All of a silent robot is STALE, which says no more than that it is silent: of its components
    only those count that were in a fault before.
    """
    faults = [each for each in robot["components"] if each["level"] != "OK"]
    if not robot["up"]:
        faults = [each for each in faults if each["level_before_stale"] in {"WARN", "ERROR"}]
    return sorted(faults, key=lambda each: (-RANKS[OF_LEVEL[each["level"]]], each["component"]))


def ago(since: float | None, now: float) -> str:
    """How long something has lasted, in the largest unit that fits; "" where that is unknown."""
    if since is None:
        return ""
    seconds = max(0, int(now - since))
    for size, unit in ((86_400, "d"), (3_600, "h"), (60, "min")):
        if seconds >= size:
            return f"for {seconds // size} {unit}"
    return f"for {seconds} s"
