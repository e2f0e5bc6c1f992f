"""Several nodes that publish one status name, each in arrays of its own."""

from __future__ import annotations

import re
from dataclasses import replace

import pytest

from ros_diagnostics_exporter.config.fleet import Source, Threshold, ValueRule
from ros_diagnostics_exporter.model import Status
from support.state_driver import ERROR, OK, STALE, StateDriver, tree

LEFT, RIGHT = (Status(OK, "lidar: Status", "scanning", side) for side in ("left", "right"))
FRONT, REAR = (
    Status(OK, "battery: Battery", "discharging", side, (("Charge (%)", "90"),))
    for side in ("front", "rear")
)
LOW = ValueRule(
    re.compile("Battery"), re.compile("Charge.*"), thresholds=(Threshold("low", "critical", 15.0),)
)


class Nodes:
    """Nodes that publish once a second, each half a second after the one before."""

    def __init__(self, *numbers: int, **profile):
        self.driver = StateDriver(**profile)
        self.numbers = list(numbers)  # of the next message of each; 0: not known

    def stand(self, seconds: float, *statuses: Status | None) -> None:
        """Let them publish these; None: it publishes nothing."""
        end = self.driver.now.mono + seconds
        while self.driver.now.mono < end:
            for node, status in enumerate(statuses):
                if status is not None:
                    number = self.numbers[node] if self.numbers else 0
                    self.driver.raw(status, number=number)
                    self.numbers[node : node + 1] = [number + 1] if number else []
                self.driver.at(self.driver.now.mono + 1 / len(statuses))

    @property
    def faults(self) -> set[tuple[str, ...]]:
        return self.driver.fault_names()

    @property
    def ends(self) -> list[str]:
        return [each.reason for each in self.driver.state.served()[1]]

    @property
    def labels(self) -> set[str]:
        return {each.label for each in self.driver.robot.components}


def test_the_one_that_dies_is_a_fault_that_names_it_and_the_other_is_not():
    nodes = Nodes()
    nodes.stand(30, LEFT, RIGHT)
    assert nodes.labels == {"lidar: Status [left]", "lidar: Status [right]"}
    nodes.stand(60, LEFT, RIGHT._replace(level=ERROR, message="no data"))
    assert nodes.faults == {("component", "critical", "r", "lidar", "lidar: Status [right]")}
    nodes.stand(60, LEFT, None)
    assert nodes.driver.level("lidar: Status [right]") == STALE
    assert nodes.driver.level("lidar: Status [left]") == OK


def test_the_threshold_that_one_of_them_passes_is_seen_and_its_end_is_one():
    nodes = Nodes(values=(LOW,))
    nodes.stand(30, FRONT, REAR)
    nodes.stand(60, FRONT, REAR._replace(values=(("Charge (%)", "2"),)))
    (fault,) = nodes.driver.state.faults()
    assert fault.identity.component == "battery: Battery [rear]"
    nodes.stand(5, FRONT, REAR)
    assert (nodes.faults, nodes.ends) == (set(), ["recovered"])


def test_what_is_broken_before_they_are_told_apart_is_a_fault_that_names_it():
    nodes = Nodes()
    nodes.stand(60, LEFT, RIGHT._replace(level=ERROR))
    assert nodes.faults == {("component", "critical", "r", "lidar", "lidar: Status [right]")}


def test_they_have_the_same_names_after_a_restart(tmp_path):
    nodes = Nodes()
    nodes.stand(30, LEFT, RIGHT)
    nodes.stand(30, LEFT, RIGHT._replace(level=ERROR))
    before, labels = nodes.faults, nodes.labels
    nodes.driver = nodes.driver.again(tmp_path / "state")
    nodes.stand(60, LEFT, RIGHT._replace(level=ERROR))
    assert (nodes.faults, nodes.labels, nodes.ends) == (before, labels, [])


@pytest.mark.parametrize("ids", [("m-1", "m-2"), ("m-1", "m-2", "m-1"), ("", "m-2", "m-2")])
def test_hardware_that_is_replaced_is_the_same_component(ids):
    nodes = Nodes()
    for hardware_id in ids:
        nodes.stand(20, LEFT._replace(hardware_id=hardware_id))
    assert nodes.labels == {"lidar: Status"}
    assert nodes.driver.component("lidar: Status").hardware_id == ids[-1]


def test_three_of_them_are_three_components():
    nodes = Nodes()
    nodes.stand(30, *(LEFT._replace(hardware_id=each) for each in ("a", "b", "")))
    assert nodes.labels == {"lidar: Status [a]", "lidar: Status [b]", "lidar: Status"}


@pytest.mark.parametrize("numbers", [(100, 7), (1, 1), (7, 100)])
def test_of_those_that_nothing_tells_apart_the_worse_counts_and_that_is_said(numbers, caplog):
    nodes, same = Nodes(*numbers), LEFT._replace(hardware_id="")
    nodes.stand(30, same, same)
    nodes.stand(60, same, same._replace(level=ERROR, message="no data"))
    assert nodes.faults == {("component", "critical", "r", "lidar", "lidar: Status")}
    component = nodes.driver.component("lidar: Status")
    assert component.trouble_text == "no data (several nodes publish it, the worse counts)"
    assert component.changes == 1
    assert nodes.driver.robot.rejected["duplicate_component"] > 50
    assert caplog.text.count("the worse counts") == 1
    nodes.stand(10, same, same)
    assert (nodes.faults, nodes.ends) == (set(), ["recovered"])
    nodes.stand(100, same, None)
    assert component.trouble_text == "scanning"


def test_of_values_that_nothing_tells_apart_the_one_beyond_a_threshold_counts():
    nodes, same = Nodes(100, 7, values=(LOW,)), FRONT._replace(hardware_id="b")
    nodes.stand(30, same, same)
    nodes.stand(60, same, same._replace(values=(("Charge (%)", "2"),)))
    assert nodes.faults == {
        ("value", "critical", "r", "battery", "battery: Battery", "Charge (%)", "low")
    }
    nodes.stand(10, same, same)
    assert (nodes.faults, nodes.ends) == (set(), ["recovered"])


def test_a_node_that_crashes_and_starts_again_and_again_is_one():
    nodes, hot = Nodes(1), LEFT._replace(level=ERROR)
    for _ in range(20):
        nodes.stand(4, hot)
        nodes.stand(4, LEFT)
        nodes.numbers = [1]
    assert nodes.driver.component("lidar: Status").held is None


def test_an_aggregator_in_place_of_them_has_a_component_of_their_name(tmp_path):
    nodes = Nodes()
    nodes.stand(30, LEFT, RIGHT)
    (robot,) = nodes.driver.state.fleet.robots
    fleet = replace(nodes.driver.state.fleet, robots=(replace(robot, source=Source.AGG),))
    driver = nodes.driver.again(tmp_path / "state", fleet=fleet)
    driver.agg_every(1, 20, *tree(Lidars=[LEFT]))
    assert driver.level("lidar: Status") == OK


def test_an_aggregator_beside_them_makes_no_third_component():
    driver = StateDriver(Source.BOTH)
    for _ in range(20):
        for side in (LEFT, RIGHT):
            driver.raw(side)
            driver.at(driver.now.mono + 0.5)
            driver.agg(*tree(Lidars=[side]))
    assert {each.label for each in driver.robot.components} == {
        "lidar: Status [left]",
        "lidar: Status [right]",
    }
