"""What is wrong between entries that are right by themselves: two robots where one may be."""

from __future__ import annotations

from collections.abc import Iterator

from ros_diagnostics_exporter.config.errors import Problem
from ros_diagnostics_exporter.config.fleet import Limits, Robot, Shared
from ros_diagnostics_exporter.config.model_robot import RobotEntry
from ros_diagnostics_exporter.config.scalars import shown
from ros_diagnostics_exporter.config.validate import Checked, Placed


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
    for placed, topic in zip(checked.shared, shared, strict=True):
        claim = (topic.domain_id, topic.topic)
        if claim in claims:
            what = f"topic {topic.topic} of domain {topic.domain_id} is shared twice"
            yield placed.problem("topic", what=what, remedy="keep one of the two")
        claims[claim] = f"declared as shared in {placed.place()}"
    for entry, robot in zip(checked.robots, robots, strict=True):
        for name in filter(None, (robot.topic_agg, robot.topic_raw)):
            claim = (robot.domain_id, name)
            if claim in claims:
                what = f"topic {name} of domain {robot.domain_id} is {claims[claim]}"
                remedy = "give it a namespace or domain_id of its own, or list the topic in shared"
                yield entry.problem(what=what, remedy=remedy)
                break
            claims[claim] = f"that of robot {shown(robot.name)} in {entry.place()}"
