"""What a search on the page of the fleet finds: robots, problems and components, in any case."""

from __future__ import annotations

from typing import Any, NamedTuple

from ros_diagnostics_exporter.severity import (
    SEVERITIES,
    component_path,
    component_text,
    shown_problems,
)
from ros_diagnostics_exporter.texts import natural

MAX_FOUND = 100  # components that are listed; the API has all


class FoundComponent(NamedTuple):
    """A component that a search found; ``text`` is its message."""

    state: str
    robot: str
    path: str
    text: str


def find(fleet: dict[str, Any], query: str) -> dict[str, Any]:
    """The fleet with only the robots, and the problems of many, that have ``query`` in them.

    Of a robot its name, its labels and its problems count.
    """
    text = query.casefold()

    def has(owner: dict[str, Any], *names: object) -> bool:
        shown, _ = shown_problems(owner, fleet["time"], len(owner["problems"]))
        words = [*names, *(f"{each.subject} {each.message}" for each in shown)]
        return any(text in str(each).casefold() for each in words)

    return {
        **fleet,
        "robots": [
            robot
            for robot in fleet["robots"]
            if has(robot, robot["robot"], *robot["labels"].values())
        ],
        "problems": [each for each in fleet["problems"] if has({**fleet, "problems": [each]})],
    }


def find_components(fleet: dict[str, Any], query: str) -> list[FoundComponent]:
    """The components that have ``query`` in their names, the worst first."""
    text = query.casefold()
    found = [
        (component["state"], robot["robot"], path, component)
        for robot in fleet["robots"]
        for component in robot["components"]
        if text in (path := component_path(component)).casefold()
    ]
    found.sort(key=lambda each: (-SEVERITIES[each[0]], natural(each[1]), natural(each[2])))
    return [
        FoundComponent(state, robot, path, component_text(component))
        for state, robot, path, component in found
    ]
