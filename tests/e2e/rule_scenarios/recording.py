"""What Prometheus recorded of a run, compared with what a scenario expects; plain data, no server.

The series have a sample each second, and rules are evaluated less often: no alert is missed.
"""

from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from typing import Any

from e2e.rule_scenarios.scenario import Scenario

Change = tuple[float, str]  # Unix time, `+NAME` or `-NAME`
GAP = 1.5  # seconds; a longer gap between samples ends an alert
PREFIX = "RosDiagnostics"


def name_of(labels: dict[str, str]) -> str:
    """What a scenario calls an alert: its name, the robot (uplink, site, fleet), and of what."""
    if "downtime" in labels:
        words = ["downtime"]
    elif "robot" in labels:
        words = ["robot", "component", "check", "reason", "key"]
    elif {"component", "uplink", "site"} & labels.keys():
        words = ["uplink", "site", "component"]
    else:
        words = ["fleet", "reason"]
    values = [labels[word] for word in words if labels.get(word)]
    return " ".join([labels["alertname"].removeprefix(PREFIX), *values])


def owns(scenario: Scenario, labels: dict[str, str]) -> bool:
    """Whether an alert belongs to the scenario: by its robot, else by its downtime or fleet.

    A downtime is named after its robot.
    """
    if "robot" in labels:
        return labels["robot"] in scenario.robots
    return bool({labels.get(each) for each in ("uplink", "downtime", "fleet")} & {*scenario.robots})


def changes(result: dict[str, Any], scenario: Scenario) -> list[Change]:
    """When the scenario's alerts fired and resolved, in order."""
    mine = [each for each in result["alerts"] if owns(scenario, each["metric"])]
    return sorted(change for each in mine for change in _changes(each, result["until"]))


def unexpected(result: dict[str, Any], scenarios: Sequence[Scenario]) -> set[str]:
    """Alerts that belong to no scenario."""
    return {
        name_of(each["metric"])
        for each in result["alerts"]
        if not any(owns(scenario, each["metric"]) for scenario in scenarios)
    }


def expected(scenario: Scenario) -> list[Counter[str]]:
    """What fires and resolves at each step, in any order within the step."""
    before: frozenset[str] = frozenset()
    steps = []
    for step in scenario.steps:
        fired = [f"+{name}" for name in step.alerts - before]
        resolved = [f"-{name}" for name in before - step.alerts]
        steps.append(Counter([*fired, *resolved]))
        before = step.alerts
    return steps


def by_step(found: list[Change], scenario: Scenario) -> list[Counter[str]]:
    """The changes, in portions as large as those of `expected`; the rest is the last portion."""
    words = [word for _, word in found]
    portions = []
    for step in expected(scenario):
        portions.append(Counter(words[: step.total()]))
        words = words[step.total() :]
    return [*portions, Counter(words)] if words else portions


def ranks(result: dict[str, Any], robot: str, began: float) -> tuple[int, ...]:
    """The recorded states of a robot from ``began`` on, each once as long as it lasts."""
    series = [each for each in result["ranks"] if each["metric"]["robot"] == robot]
    samples = sorted(sample for each in series for sample in each["values"])
    values = [int(value) for at, value in samples if at >= began]
    return tuple(value for value, _ in groupby(values))


def _changes(series: dict[str, Any], until: float) -> list[Change]:
    name = name_of(series["metric"])
    times = [float(at) for at, _ in series["values"]]
    begins = [b for a, b in zip([0.0, *times], times, strict=False) if b - a > GAP]
    ends = [a for a, b in zip(times, [*times[1:], until + 60], strict=True) if b - a > GAP]
    if ends[-1] > until - GAP:
        ends.pop()  # it still fires
    return [*((at, f"+{name}") for at in begins), *((at + 1, f"-{name}") for at in ends)]
