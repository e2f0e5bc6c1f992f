"""A robot that boots is no robot that fails: what is wrong from its first message on has time."""

from __future__ import annotations

from ros_diagnostics_exporter.config.fleet import Threshold, ValueRule
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.regex import Pattern
from support.state_driver import ERROR, OK, SETTLED, StateDriver

CRITICAL = ("component", "critical", "r", "Lidar")


def booted(*statuses: Status, **profile) -> StateDriver:
    """A robot with a boot_grace of two minutes that is back after a silence, with these."""
    driver = StateDriver(boot_grace=120.0, **profile)
    driver.raw_every(1, SETTLED, Status(OK, "Lidar"), Status(OK, "Motor"))
    driver.at(SETTLED + 60)
    assert driver.fault_names() == {("robot", "silent", "r")}
    driver.raw_every(1, SETTLED + 61, *statuses)
    return driver


def test_drivers_that_report_error_until_they_are_up_are_no_fault():
    driver = booted(Status(ERROR, "Lidar"), Status(OK, "Motor"))
    driver.raw_every(1, SETTLED + 170, Status(ERROR, "Lidar"), Status(OK, "Motor"))
    assert driver.fault_names() == set()
    driver.raw_every(1, SETTLED + 300, Status(OK, "Lidar"), Status(OK, "Motor"))
    assert driver.fault_names() == set()


def test_what_is_still_wrong_after_it_is_a_fault():
    driver = booted(Status(ERROR, "Lidar"), Status(OK, "Motor"))
    driver.raw_every(1, SETTLED + 185, Status(ERROR, "Lidar"), Status(OK, "Motor"))
    assert driver.fault_names() == {CRITICAL}


def test_what_was_ok_and_then_fails_has_no_grace():
    driver = booted(Status(OK, "Lidar"), Status(OK, "Motor"))
    driver.raw_every(1, SETTLED + 75, Status(ERROR, "Lidar"), Status(OK, "Motor"))
    assert driver.fault_names() == {CRITICAL}


def test_a_value_that_is_low_from_the_first_message_on_has_it_too():
    rule = ValueRule(key=Pattern("charge"), thresholds=(Threshold("low", "critical", 10.0),))
    low = Status(OK, "Battery", values=(("charge", "5"),))
    driver = booted(low, values=(rule,))
    driver.raw_every(1, SETTLED + 170, low)
    assert ("value", "critical", "r", "Battery", "charge", "low") not in driver.fault_names()
    driver.raw_every(1, SETTLED + 190, low)
    assert ("value", "critical", "r", "Battery", "charge", "low") in driver.fault_names()
