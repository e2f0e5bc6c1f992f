"""What the API shows of the state, and in which words."""

from __future__ import annotations

import re

import pytest

from ros_diagnostics_exporter.config.fleet import Check, ComponentRule
from ros_diagnostics_exporter.diagnostics import Status
from ros_diagnostics_exporter.snapshot import fleet_snapshot
from stories import ERROR, OK, STALE, Story

PENDANT = ComponentRule(re.compile("Pendant"), planned_stale=True)


def robot(story: Story) -> dict:
    (shown,) = fleet_snapshot(story.state, story.now)["robots"]
    return shown


@pytest.mark.parametrize(
    ("stale_is_critical", "states"),
    [
        (False, {"Arm": "STALE", "Motor": "CRITICAL", "Pendant": "STALE"}),
        (True, {"Arm": "CRITICAL", "Motor": "CRITICAL", "Pendant": "STALE"}),
    ],
)
def test_a_state_is_what_the_rules_make_of_the_level(stale_is_critical, states):
    story = Story(stale_is_critical=stale_is_critical, components=(PENDANT,))
    story.raw(Status(STALE, "Arm"), Status(STALE, "Pendant"), Status(ERROR, "Motor"))
    story.at(1)
    story.raw(Status(STALE, "Motor"))

    shown = robot(story)["components"]
    assert {each["component"]: each["state"] for each in shown} == states
    assert {each["component"] for each in shown if each["planned_stale"]} == {"Pendant"}


def test_a_check_is_short_until_it_finds_what_is_expected():
    motors = Check("motors", (re.compile("Motor"),), expect=2)
    story = Story(checks=(Check("all"), motors))
    assert robot(story)["short_checks"] == []  # nothing is expected of a robot that is silent
    story.raw(Status(OK, "Motor 1"))
    assert robot(story)["short_checks"] == [{"check": "motors", "found": 1, "expected": 2}]
    story.raw(Status(ERROR, "Motor 2"))
    assert robot(story)["short_checks"] == []
