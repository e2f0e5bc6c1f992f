"""The table of families follows Prometheus' naming rules."""

from __future__ import annotations

import re

import pytest

from ros_diagnostics_exporter.faults.model import Identity, Scope, State
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.self_metrics import ALL_FAMILIES, EXPORTER_FAMILIES
from ros_diagnostics_exporter.metrics.states import states
from support.state_driver import StateDriver


def test_every_family_has_a_name_of_its_own():
    names = [family.name for family in ALL_FAMILIES]

    assert len(names) == len(set(names))


def test_names_follow_the_rules_of_their_type():
    for family in ALL_FAMILIES:
        assert re.fullmatch(r"ros_diagnostics_[a-z][a-z0-9_]*", family.name)
        assert family.name.endswith("_total") == (family.type == "counter")
        assert family.help.endswith(".")


def test_every_series_says_its_fleet_and_robot():
    for family in metrics.FLEET_FAMILIES:
        assert family.labels[:2] == ("fleet", "robot")
    for family in EXPORTER_FAMILIES:
        assert family.labels[0] == "fleet"


@pytest.mark.parametrize(
    ("obstacle", "fault", "state", "part"),
    [
        ("undecodable", State.FLAPPING, 1.5, "silent"),
        ("undecodable", State.PENDING, 5, ""),
        ("uplink_down", State.FLAPPING, 3, ""),
        (None, State.FLAPPING, -1, ""),  # it was never seen
        (None, State.SILENT, 5, ""),
    ],
)
def test_a_robot_that_is_not_received_has_the_state_of_why(obstacle, fault, state, part):
    robot = StateDriver().robot
    robot.undecodable = obstacle == "undecodable"
    robot.network.uplink_up = obstacle != "uplink_down"
    found = states(robot, [Identity(Scope.ROBOT, fault, robot="r")])
    assert (found.robot, found.part) == (state, part)
