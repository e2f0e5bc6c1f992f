"""What a robot's page shows of its missions; nothing of a robot that has neither goal nor mode."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from ros_diagnostics_exporter.fleet_texts import clock, span
from ros_diagnostics_exporter.mission_numbers import Work, number_texts, success_text, work_of

MOST_MOMENTS = 5  # aborted goals and interventions that are shown, the newest ones


class MissionSection(NamedTuple):
    """The section: the three numbers, each action in words, and what was wrong at which moment.

    Attributes:
        numbers: Words by the name of the number.
        actions: Words by the action, of those whose goals were seen.
        moments: Events of `MOMENTS`, the newest first.
    """

    numbers: dict[str, str]
    actions: dict[str, str]
    moments: list[dict[str, Any]]


def mission_section(
    missions: Mapping[str, Any], events: Iterable[dict[str, Any]], now: float
) -> MissionSection | None:
    """The section of a robot as /api/v1/missions has it; None where there is nothing to show.

    Args:
        missions: The answer of /api/v1/missions that is about this robot alone.
        events: The robot's events of `MOMENTS`, in any order.
        now: Unix time.
    """
    for robot in missions["robots"]:
        actions = {each["action"]: text for each in robot["actions"] if (text := _action(each))}
        if actions or "interventions" in robot:
            moments = sorted(events, key=lambda each: each["time"], reverse=True)
            return MissionSection(_numbers(robot, now), actions, moments[:MOST_MOMENTS])
    return None


def _numbers(robot: Mapping[str, Any], now: float) -> dict[str, str]:
    numbers = number_texts(work_of(robot))
    since = robot["since"]
    return numbers | ({"Counted since": clock(since, now, local=False)} if since else {})


def _action(action: Mapping[str, Any]) -> str:
    """As "80 % of 20 goals; 1 running, for 40 s"; "" of an action without goals."""
    work, parts = Work(action["results"]), list[str]()
    if work.ended:
        parts.append(success_text(work))
    if action["running"]:
        parts.append(f"{action['running']} running, for {span(action['longest'])}")
    return "; ".join((*parts, *_notes(action, bool(parts))))


def _notes(action: Mapping[str, Any], has_goals: bool) -> Iterator[str]:
    if has_goals and not action["mission"]:
        yield "not a mission"
    if has_goals and not action["reached"]:
        yield "its server cannot be reached"
