"""What the API shows of the state, and in which words."""

from __future__ import annotations

import re

import pytest

from ros_diagnostics_exporter.cli.check_nagios import check
from ros_diagnostics_exporter.config.fleet import Check, ComponentRule
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.state.snapshot import fleet_snapshot
from support.state_driver import ERROR, OK, STALE, StateDriver

PENDANT = ComponentRule(re.compile("Pendant"), planned_stale=True)


def robot(driver: StateDriver) -> dict:
    (shown,) = fleet_snapshot(driver.state, driver.now)["robots"]
    return shown


@pytest.mark.parametrize(
    ("stale_is_critical", "states"),
    [
        (False, {"Arm": "STALE", "Motor": "CRITICAL", "Pendant": "STALE"}),
        (True, {"Arm": "CRITICAL", "Motor": "CRITICAL", "Pendant": "STALE"}),
    ],
)
def test_a_state_is_what_the_rules_make_of_the_level(stale_is_critical, states):
    driver = StateDriver(stale_is_critical=stale_is_critical, components=(PENDANT,))
    driver.raw(Status(STALE, "Arm"), Status(STALE, "Pendant"), Status(ERROR, "Motor"))
    driver.at(1)
    driver.raw(Status(STALE, "Motor"))

    shown = robot(driver)["components"]
    assert {each["component"]: each["state"] for each in shown} == states
    assert {each["component"] for each in shown if each["planned_stale"]} == {"Pendant"}


def test_a_check_is_short_until_it_finds_what_is_expected():
    motors = Check("motors", (re.compile("Motor"),), expect=2)
    driver = StateDriver(checks=(Check("all"), motors))
    assert robot(driver)["short_checks"] == []  # nothing is expected of a robot that is silent
    driver.raw(Status(OK, "Motor 1"))
    assert robot(driver)["short_checks"] == [{"check": "motors", "found": 1, "expected": 2}]
    driver.raw(Status(ERROR, "Motor 2"))
    assert robot(driver)["short_checks"] == []


REPEATED = (
    ("Error", "1"),
    ("Error: ", "2 V"),
    ("Error", "none"),
    ("Error", "[3, 4]"),
    ("a: ", "5"),
)


def test_each_repeated_key_has_its_own_number_as_it_is_exported():
    driver = StateDriver()
    driver.raw(Status(OK, "Arm", values=REPEATED))

    (arm,) = robot(driver)["components"]
    assert [(each["key"], each["number"], each["unit"]) for each in arm["values"]] == [
        ("Error", 1.0, ""),
        ("Error#2", 2.0, "V"),
        ("Error", None, ""),
        ("Error", None, ""),
        ("a: ", 5.0, ""),
    ]
    exported = {
        dict(each)["key"]: value for each, value in driver.samples()["component_value"].items()
    }
    assert exported == {"Error": 1, "Error#2": 2, "Error[0]": 3, "Error[1]": 4, "a": 5}


def test_performance_data_have_each_repeated_key_with_its_own_number():
    driver = StateDriver()
    driver.raw(Status(OK, "Arm", values=REPEATED))

    _code, line = check(fleet_snapshot(driver.state, driver.now), "r", "")
    assert (
        line.partition(" | ")[2]
        .split("=0;;;0 ")[-1]
        .endswith("'Arm Error'=1 'Arm Error#2 [V]'=2 'Arm a: '=5")
    )


def test_a_number_is_that_of_the_text_beside_it():
    """A STALE status is not read: it may have other texts than the one that was."""
    driver = StateDriver()
    driver.raw(Status(OK, "Arm", values=(("Error", "1"),)))
    driver.raw(Status(STALE, "Arm", values=(("Error", "2"),)))

    (arm,) = robot(driver)["components"]
    assert [(each["value"], each["number"]) for each in arm["values"]] == [("2", None)]
