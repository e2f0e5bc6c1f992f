"""The table of families follows Prometheus' naming rules."""

from __future__ import annotations

import re

import pytest

from ros_diagnostics_exporter.config.fleet import ComponentRule
from ros_diagnostics_exporter.faults.model import Identity, Scope, State
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.self_metrics import ALL_FAMILIES, EXPORTER_FAMILIES
from ros_diagnostics_exporter.metrics.states import states
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.regex import Pattern
from support.state_driver import ERROR, OK, STALE, WARN, StateDriver


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


@pytest.mark.parametrize(
    ("levels", "rank", "shown"),
    [
        ({"Arm": OK, "Gripper": OK}, 0, {}),
        ({"Arm": WARN, "Gripper": STALE}, 1, {"Arm": 1, "Gripper": 2}),  # which is planned
        ({"Arm": OK, "Gripper": STALE}, 0, {"Gripper": 2}),
        ({"Arm": STALE, "Gripper": OK}, 2, {"Arm": 2}),
        ({"Arm": OK, "Gripper": WARN}, 1, {"Gripper": 1}),
        ({"Arm": STALE, "Gripper": ERROR}, 6, {"Arm": 2, "Gripper": 6}),
    ],
)
def test_a_robot_is_as_urgent_as_its_worst_component_but_for_a_stale_that_is_planned(
    levels, rank, shown
):
    driver = StateDriver(components=(ComponentRule(Pattern("Gripper"), planned_stale=True),))
    driver.raw(*(Status(level, name, "") for name, level in levels.items()))
    found = states(driver.robot, [])
    assert found.robot == rank
    assert {label: state for (_group, label), state in found.components.items()} == shown
