"""Which changes of a robot those that read its marks find."""

from math import inf

from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.robots.maintenance import PlannedBy
from ros_diagnostics_exporter.robots.marks import MARKS, Mark
from support.state_driver import OK, StateDriver


def test_an_attribute_that_becomes_another_is_noted():
    robot = StateDriver().robot
    for mark, of, name, value in (
        (Mark.CONFIG, robot, "declared", not robot.declared),
        (Mark.DOWNTIME, robot, "maintenance", True),
        (Mark.DOWNTIME, robot, "planned", frozenset({PlannedBy("inspection", "", inf)})),
        (Mark.RECEIPT, robot.network, "uplink_up", False),
    ):
        before = robot.marks.count
        setattr(of, name, getattr(of, name))
        assert robot.marks.count == before
        setattr(of, name, value)
        assert robot.marks.last(mark) == robot.marks.count == before + 1


def test_time_changes_a_robot_only_while_it_is_received():
    driver = StateDriver(stale_after=5.0)
    assert driver.robot.next_tick == inf
    assert driver.raw(Status(OK, "Motor")).robot.next_tick == 5.0
    assert not driver.at(6).robot.up
    assert driver.robot.next_tick > driver.now.mono


def test_each_mark_is_another():
    marks = {value for name, value in vars(Mark).items() if name.isupper()}
    assert marks == set(range(MARKS))
