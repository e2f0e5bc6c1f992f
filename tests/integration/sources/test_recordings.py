"""Every recording goes in over real DDS, and its last array comes out as exactly its series."""

from __future__ import annotations

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from support.recordings import CASES, EXPECTED, aggregated, expected_names, raw
from testbed.polling import until

pytestmark = pytest.mark.integration

RECORDED = [case for case in CASES if aggregated(case)]
OK, WARN, ERROR, STALE = range(4)
TIMEOUTS = {"discard_stale": 3.0}  # all other configurations keep the aggregator's 5 s


def expected_levels(case: str) -> dict[str, int]:
    """Component -> level at the last array, found from what was sent to the aggregator alone.

    The last status of a name counts; one older than the aggregator's timeout is STALE, and so is
    one that was only expected. (What the aggregator drops after its timeout is missing: STALE.)
    """
    end = aggregated(case)[-1][0]
    levels = dict.fromkeys(EXPECTED.get(case, ()), STALE)
    for sent_at, array in raw(case):
        for status in array.statuses:
            if sent_at < end and status.name in expected_names(case):
                late = end - sent_at > TIMEOUTS.get(case, 5.0)
                levels[status.name] = STALE if late else min(status.level, STALE)
                if status.level > STALE:
                    levels[status.name] = STALE if late else ERROR
    return {name or "(unnamed)": level for name, level in levels.items()}


def test_every_recording_comes_out_as_its_components_by_name(ros_domain, robots, run_exporter):
    topics = {case: f"/{case}/diagnostics_agg" for case in RECORDED}
    profile = Profile(stale_after=300.0)
    fleet = Fleet(
        "golden",
        tuple(
            Robot(case, ros_domain, topic_agg=topic, source=Source.AGG, profile=profile)
            for case, topic in topics.items()
        ),
    )
    running = run_exporter(fleet)
    for topic in topics.values():
        robots.offer(topic)
    robots.wait_for_listeners()

    for case, topic in topics.items():
        for _t, array in aggregated(case):
            robots.send(topic, *array.statuses)
    total = sum(len(aggregated(case)) for case in RECORDED)
    until(lambda: sum(running.samples("robot_messages_total").values()) == total, "all arrived")

    found: dict[str, dict[str, int]] = {case: {} for case in RECORDED}
    for labels, level in running.samples("component_level").items():
        named = dict(labels)
        assert named["component"] not in found[named["robot"]]
        found[named["robot"]][named["component"]] = int(level)
    for case in RECORDED:
        assert found[case] == expected_levels(case), case

    groups = {
        (dict(labels)["robot"], dict(labels)["group"]) for labels in running.samples("group_level")
    }
    for case in RECORDED:
        last = aggregated(case)[-1][1]
        rows = {status.name for status in last.statuses}
        parents = {path for path in rows if any(row.startswith(path + "/") for row in rows)}
        assert parents <= {group for robot, group in groups if robot == case}, case
    assert not any(running.samples("robot_rejected_total").values())
