"""The samples of a robot's missions: its goals, its interventions, its time of autonomy."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import accumulate

from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.families import Family
from ros_diagnostics_exporter.robots.goals import BOUNDS
from ros_diagnostics_exporter.robots.missions import Action, Missions
from ros_diagnostics_exporter.texts import escape

_BUCKETS = (*map(repr, BOUNDS), "+Inf")


def mission_samples(missions: Missions, base: str) -> Iterator[tuple[Family, list[str]]]:
    """The samples of each family; ``base`` are the labels of the robot."""
    actions = [
        (each, f'{{{base},action="{escape(name)}"') for name, each in missions.actions.items()
    ]
    yield metrics.GOALS, [line for each in actions for line in _results(*each)]
    yield (
        metrics.GOALS_RUNNING,
        [
            f"{metrics.GOALS_RUNNING.name}{labels}}} {each.goals.running}\n"
            for each, labels in actions
        ],
    )
    named = [each for each in actions if each[0].rule is not None]
    yield metrics.GOAL_DURATION, [line for each in named for line in _durations(*each)]
    autonomy = missions.autonomy
    if autonomy is not None:
        for family, value in (
            (metrics.INTERVENTIONS, autonomy.interventions),
            (metrics.AUTONOMOUS_SECONDS, round(autonomy.seconds, 3)),
        ):
            yield family, [f"{family.name}{{{base}}} {value!r}\n"]


def _results(action: Action, labels: str) -> Iterator[str]:
    """The goals by result; of an action that no entry names, without those that never were."""
    mission = str(action.is_mission).lower()
    for result, count in action.goals.counts.results.items():
        if count or action.rule is not None:
            more = f',result="{result}",mission="{mission}"'
            yield f"{metrics.GOALS.name}{labels}{more}}} {count}\n"


def _durations(action: Action, labels: str) -> Iterator[str]:
    """The durations as a histogram, of an action that an entry names."""
    name, counts = metrics.GOAL_DURATION.name, action.goals.counts
    total = 0
    for bound, total in zip(_BUCKETS, accumulate(counts.durations), strict=True):
        yield f'{name}_bucket{labels},le="{bound}"}} {total}\n'
    yield f"{name}_sum{labels}}} {round(counts.seconds, 3)!r}\n"
    yield f"{name}_count{labels}}} {total}\n"
