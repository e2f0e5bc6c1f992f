"""What was told, read from what Prometheus recorded of a run, and what had to be.

Works on plain data; knows no server. The series were asked for every second, and rules are
evaluated less often: nothing that was told for an evaluation is missed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from typing import Any

from e2e.rule_scenarios.scenario import Story

Change = tuple[float, str]  # Unix time, `+NAME` or `-NAME`
GAP = 1.5  # seconds between two samples of a series that goes on, asked for every second
PREFIX = "RosDiagnostics"


def name_of(labels: dict[str, str]) -> str:
    """What the table calls an alert: its name, the robot (uplink, site, fleet), and of what."""
    if "robot" in labels:
        words = ["robot", "component", "check", "reason", "key"]
    elif {"component", "uplink", "site"} & labels.keys():
        words = ["uplink", "site", "component"]
    else:
        words = ["fleet", "reason"]
    said = [labels[word] for word in words if labels.get(word)]
    return " ".join([labels["alertname"].removeprefix(PREFIX), *said])


def owns(story: Story, labels: dict[str, str]) -> bool:
    """Whether an alert is one of the story's: by its robot, else by its uplink or fleet."""
    if "robot" in labels:
        return labels["robot"] in story.robots
    return labels.get("uplink") in story.robots or labels.get("fleet") in story.robots


def changes(result: dict[str, Any], story: Story) -> list[Change]:
    """Each beginning and end of the story's alerts, in their order."""
    mine = [each for each in result["alerts"] if owns(story, each["metric"])]
    return sorted(change for each in mine for change in _changes(each, result["until"]))


def strangers(result: dict[str, Any], stories: Sequence[Story]) -> set[str]:
    """Alerts of the fleets that belong to no story."""
    return {
        name_of(each["metric"])
        for each in result["alerts"]
        if not any(owns(story, each["metric"]) for story in stories)
    }


def expected(story: Story) -> list[Counter[str]]:
    """What begins and ends at each step; within a step the order is free."""
    before: frozenset[str] = frozenset()
    steps = []
    for step in story.steps:
        begun = [f"+{name}" for name in step.alerts - before]
        ended = [f"-{name}" for name in before - step.alerts]
        steps.append(Counter([*begun, *ended]))
        before = step.alerts
    return steps


def by_step(told: list[Change], story: Story) -> list[Counter[str]]:
    """What was told, in portions as large as those of `expected`, and the rest as the last one."""
    words = [word for _, word in told]
    portions = []
    for step in expected(story):
        portions.append(Counter(words[: step.total()]))
        words = words[step.total() :]
    return [*portions, Counter(words)] if words else portions


def ranks(result: dict[str, Any], robot: str, began: float) -> tuple[int, ...]:
    """The recorded states of a robot from ``began`` on, each once as long as it lasts."""
    series = [each for each in result["ranks"] if each["metric"]["robot"] == robot]
    samples = sorted(sample for each in series for sample in each["values"])
    values = [int(value) for at, value in samples if at >= began]
    return tuple(value for value, _ in groupby(values))


def spent(result: dict[str, Any], robot: str) -> dict[str, float]:
    """The seconds of the whole run that a robot was in each part of availability."""
    return {
        each["metric"]["part"]: float(each["value"][1])
        for each in result["parts"]
        if each["metric"]["robot"] == robot
    }


def _changes(series: dict[str, Any], until: float) -> list[Change]:
    name = name_of(series["metric"])
    times = [float(at) for at, _ in series["values"]]
    begins = [b for a, b in zip([0.0, *times], times, strict=False) if b - a > GAP]
    ends = [a for a, b in zip(times, [*times[1:], until + 60], strict=True) if b - a > GAP]
    if ends[-1] > until - GAP:
        ends.pop()  # it still fires
    return [*((at, f"+{name}") for at in begins), *((at + 1, f"-{name}") for at in ends)]
