"""What is wrong between entries that are right by themselves: two robots where one may be."""

from __future__ import annotations

from collections.abc import Iterator

from ros_diagnostics_exporter.config.errors import Problem
from ros_diagnostics_exporter.config.fleet import Limits, Robot, Shared
from ros_diagnostics_exporter.config.model_robot import RobotEntry
from ros_diagnostics_exporter.config.scalars import shown
from ros_diagnostics_exporter.config.validate import Checked, Placed

_WAY_OUT = (
    "give it a namespace or domain_id of its own, or list the topic in shared and name it as topic"
)


def refuse_conflicts(
    checked: Checked,
    robots: tuple[Robot, ...],
    shared: tuple[Shared, ...],
    problems: list[Problem],
) -> None:
    """Tell of robots with one name, of topics claimed twice, of more robots than the limit.

    `robots` and `shared` are what the entries in `checked` of the same places became.
    """
    problems.extend(_same_names(checked.robots))
    problems.extend(_same_topics(checked, robots, shared))
    limits = checked.fleet.limits if checked.fleet else None
    limit = (limits and limits.robots) or Limits.robots
    if len(robots) > limit:
        what = f"{len(robots)} robots are declared, above the limit of {limit}"
        remedy = "raise limits.robots"
        problems.append(checked.document.problem(("limits", "robots"), what, remedy))


def _same_names(robots: list[Placed[RobotEntry]]) -> Iterator[Problem]:
    first: dict[str, Placed[RobotEntry]] = {}
    for placed in robots:
        name = placed.entry.name
        other = first.setdefault(name, placed)
        if other is not placed:
            what = f"the name {shown(name)} is taken by the robot in {other.place()}"
            yield placed.problem("name", what=what, remedy="give each robot a name of its own")


def _same_topics(
    checked: Checked, robots: tuple[Robot, ...], shared: tuple[Shared, ...]
) -> Iterator[Problem]:
    claims: dict[tuple[int, str], str] = {}
    for on_topic, topic in zip(checked.shared, shared, strict=True):
        claim = (topic.domain_id, topic.topic)
        if claim in claims:
            what = f"topic {topic.topic} of domain {topic.domain_id} is shared twice"
            yield on_topic.problem("topic", what=what, remedy="keep one of the two")
        claims[claim] = f"declared as shared in {on_topic.place()}"
    all_shared = set(claims)
    for placed, robot in zip(checked.robots, robots, strict=True):
        if (robot.domain_id, placed.entry.topic) in all_shared:
            yield from _other_source(placed, robot)
            continue  # one of the robots there: statuses tell them apart
        for name in filter(None, (robot.topic_agg, robot.topic_raw)):
            claim = (robot.domain_id, name)
            if claim in claims:
                what = f"topic {name} of domain {robot.domain_id} is {claims[claim]}"
                yield placed.problem(what=what, remedy=_WAY_OUT)
                break
            claims[claim] = f"that of robot {shown(robot.name)} in {placed.place()}"


def _other_source(placed: Placed[RobotEntry], robot: Robot) -> Iterator[Problem]:
    """A robot on a shared topic is what the topic is."""
    said = placed.entry.source
    if said is not None and said != robot.source.value:
        what = f"the shared topic {placed.entry.topic} is {robot.source.value}, not {said}"
        yield placed.problem("source", what=what, remedy="remove source")
