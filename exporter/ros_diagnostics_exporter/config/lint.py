"""Warnings about a valid config: what is allowed but probably a mistake."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ros_diagnostics_exporter.config.errors import Finding
from ros_diagnostics_exporter.config.fleet import Fleet, Profile
from ros_diagnostics_exporter.config.metric_names import base_unit_for
from ros_diagnostics_exporter.config.scalars import duration
from ros_diagnostics_exporter.config.validate import Checked, Placed
from ros_diagnostics_exporter.config.yaml_file import inside
from ros_diagnostics_exporter.durations import written
from ros_diagnostics_exporter.model import Domain

# A domain's ports begin at 7400 + 250 * id; Linux gives 32768 to 60999 to outgoing connections.
# https://docs.ros.org/en/jazzy/Concepts/Intermediate/About-Domain-ID.html
EPHEMERAL_DOMAINS = range(102, 215)
LATE = 3600.0  # seconds; a longer stale_after is rather a mistake


def lint(checked: Checked, fleet: Fleet) -> tuple[str, ...]:
    """All warnings about `fleet`, which was made of `checked`, each with its place and remedy."""
    found = [
        *_ephemeral_domains(checked),
        *_late(checked),
        *_units(checked),
        *_labels_of_no_robot(checked, fleet),
        *_uplinks_of_no_entry(checked),
        *_goals_of_no_graph(checked),
        *_topics_of_no_robot(checked, fleet),
        *_nothing_to_watch(checked, fleet),
    ]
    return tuple(str(each) for each in found)


def _ephemeral_domains(checked: Checked) -> Iterator[Finding]:
    remedy = "prefer 0 to 101 (215 to 232 work on Linux, too)"
    entries: list[tuple[Placed[Any], str, tuple[Domain, ...]]] = [
        *((each, "domain_id", (each.entry.domain_id,)) for each in checked.robots),
        *((each, "domain_id", (each.entry.domain_id,)) for each in checked.shared),
        *((each, "domain_ids", each.entry.domain_ids) for each in checked.discovery),
    ]
    for placed, key, ids in entries:
        shared = [each for each in ids if each in EPHEMERAL_DOMAINS]
        if shared:
            numbers = ", ".join(map(str, shared[:5])) + (", ..." if len(shared) > 5 else "")
            what = f"DDS domain {numbers} shares its ports with Linux' outgoing connections"
            yield placed.problem(key, what=what, remedy=remedy)


def _late(checked: Checked) -> Iterator[Finding]:
    """A number without a unit is seconds, which is easily taken for milliseconds."""
    for placed in checked.profiles:
        places: list[tuple[str | int, ...]] = [("stale_after",)]
        places += [("components", at, "stale_after") for at, _ in _entries(placed, "components")]
        for place in places:
            written_there = inside(placed.data, place)
            seconds = 0.0 if written_there is None else duration(written_there)
            if seconds > LATE:
                what = f"is {written(seconds)}: silence is noticed only after that"
                remedy = "write the unit, as in 5s or 500ms"
                yield placed.problem(*place, what=what, remedy=remedy)


def _units(checked: Checked) -> Iterator[Finding]:
    for placed in checked.profiles:
        for at, value in _entries(placed, "values"):
            metric = value.get("metric")
            base = base_unit_for(metric) if metric else None
            if base:
                what = f"{metric} is not in a base unit of Prometheus"
                remedy = f"call it ..._{base} and convert with scale"
                yield placed.problem("values", at, "metric", what=what, remedy=remedy)
            converted = {"scale", "offset"} & value.keys()
            has_unit_label = metric is None or "thresholds" in value
            if converted and has_unit_label and "unit" not in value:
                what = "is converted, but its label still has the unit from before"
                yield placed.problem("values", at, what=what, remedy="add unit: and the new one")


def _entries(placed: Placed[Profile], key: str) -> Iterator[tuple[int, dict[str, Any]]]:
    """What a profile's list has in the file, without keys that have no value."""
    for at, entry in enumerate(placed.data.get(key) or ()):
        yield at, {name: each for name, each in entry.items() if each is not None}


def _labels_of_no_robot(checked: Checked, fleet: Fleet) -> Iterator[Finding]:
    """A downtime that selects by a label that no robot has is never active."""
    known = {"robot", "fleet"}.union(*(each.labels for each in fleet.entries))
    for placed in checked.maintenance:
        for label in placed.entry.selector:
            if label not in known:
                what = f"no robot has the label {label}, so this downtime is never active"
                remedy = f"select by one of {', '.join(sorted(known))}"
                yield placed.problem("selector", label, what=what, remedy=remedy)


def _uplinks_of_no_entry(checked: Checked) -> Iterator[Finding]:
    """An uplink that is no entry of its own is not pinged, and explains no silence."""
    known = {each.entry.name for each in checked.robots}
    for placed in checked.entries:
        uplink = placed.entry.labels.get("uplink")
        if uplink is not None and uplink not in known:
            known.add(uplink)  # once is enough
            what = (
                f"is {uplink}, which is no robot of this file, so its failure explains no silence"
            )
            remedy = f"add {{name: {uplink}, source: queries, address: ...}} to robots"
            yield placed.problem("labels", "uplink", what=what, remedy=remedy)


def _goals_of_no_graph(checked: Checked) -> Iterator[Finding]:
    """Without the ROS graph no action server is known, so no entry judges anything."""
    for placed in checked.profiles:
        if placed.entry.actions and placed.entry.graph.mode == "off":
            what = "are never judged, because graph.mode is off"
            yield placed.problem("actions", what=what, remedy="remove one of them")


def _topics_of_no_robot(checked: Checked, fleet: Fleet) -> Iterator[Finding]:
    """A profile whose topics nobody reads, because its robots have no namespace in ROS."""
    on_shared = {(each.domain_id, each.topic) for each in fleet.shared}
    unread = {each.profile.name for each in fleet.shared}
    read = {each.profile.name for each in fleet.discoveries}
    for robot in fleet.robots:
        has_namespace = robot.in_ros and (robot.domain_id, robot.topic) not in on_shared
        (read if has_namespace else unread).add(robot.profile.name)
    for placed in checked.profiles:
        if placed.path[-1] in unread - read and placed.entry.topics:
            what = "no robot of this profile has a namespace in ROS, so no topic is read"
            remedy = "give a robot with source queries its domain_id, or remove topics"
            yield placed.problem("topics", what=what, remedy=remedy)


def _nothing_to_watch(checked: Checked, fleet: Fleet) -> Iterator[Finding]:
    if not fleet.entries:
        what = "no robots, discovery or shared topics, so there is nothing to watch"
        yield checked.document.problem(
            (), what, 'add discovery: [{topic: "/{robot}/diagnostics_agg"}]'
        )
