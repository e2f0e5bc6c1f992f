"""When what is absent is forgotten, and what a person takes out."""

import re

import pytest

from ros_diagnostics_exporter.config.fleet import (
    ComponentRule,
    Discovery,
    Fleet,
    Profile,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.faults.model import State
from ros_diagnostics_exporter.model import Endpoint
from support.state_driver import ERROR, HOT, LASER, MOTOR, OK, STALE, StateDriver, tree


def test_absence_never_ends_a_fault_but_what_was_ok_is_forgotten():
    driver = StateDriver(forget_after=100.0, stale_after=5.0).raw_every(1, 5, HOT, LASER)
    driver.at(200)

    assert [each.name for each in driver.robot.components] == ["Motor 1"]


RAW = "/r/diagnostics"
LOW = ValueRule(thresholds=(Threshold("low", "critical", 10.0),))


def discovered(**profile) -> StateDriver:
    """One robot "r", found by its topic."""
    found = Discovery(
        re.compile(r"/(?P<robot>[^/]+)/diagnostics"),
        "/{robot}/diagnostics",
        source=Source.RAW,
        profile=Profile(forget_after=100.0, stale_after=5.0, **profile),
    )
    driver = StateDriver(fleet=Fleet("f", discoveries=(found,)))
    driver.state.update_graph(0, {RAW: Endpoint(1)}, driver.now)
    return driver


STALE_IS_OK = {"components": (ComponentRule(re.compile(""), levels={STALE: OK}),)}
ERROR_IS_OK = {"components": (ComponentRule(re.compile(""), levels={ERROR: OK}),)}
PLANNED = {"components": (ComponentRule(re.compile("Motor"), planned_stale=True),)}
LEFT = {  # the last status of a discovered robot's motor, its profile; whether the motor stays
    "error": (HOT, {}, True),
    "stale": (MOTOR._replace(level=STALE), {}, True),
    "stale counts as ok": (HOT, STALE_IS_OK, True),
    "value": (MOTOR._replace(values=(("Volt", "9"),)), {"values": (LOW,)}, True),
    "ok": (MOTOR, {}, False),
    "error counts as ok": (HOT, ERROR_IS_OK, False),
    "value above the threshold": (
        MOTOR._replace(values=(("Volt", "11"),)),
        {"values": (LOW,)},
        False,
    ),
    "planned stale": (MOTOR._replace(level=STALE), PLANNED, False),
}


@pytest.mark.parametrize(("status", "rules", "stays"), LEFT.values(), ids=LEFT)
def test_a_discovered_robot_stays_until_a_person_takes_it_out_with_what_was_not_ok(
    status, rules, stays
):
    driver = discovered(**rules).raw_every(1, 5, status, LASER)
    assert driver.component("Motor 1").was_ok is not stays
    driver.state.update_graph(0, {}, driver.now)
    for seconds in (1_000, 1_500):
        assert [each.name for each in driver.at(seconds).robot.components] == ["Motor 1"] * stays
        assert State.SILENT in {each.identity.state for each in driver.state.faults()}

    driver.state.forget("r", None, driver.now)
    assert not driver.state.robots
    assert {end.reason for end in driver.state.served()[1]} == {"removed"}


def test_what_the_network_keeps_from_us_is_not_forgotten():
    driver = discovered().raw(MOTOR)
    driver.state.update_graph(0, {RAW: Endpoint(0, wrong_type="std_msgs/msg/String")}, driver.now)
    assert driver.at(1_000).robot.silent_reason == "wrong_type"


@pytest.mark.parametrize("publishers", [1, 0])
def test_a_newcomer_that_was_received_for_a_moment_is_a_fault_while_its_publisher_is_there(
    publishers,
):
    driver = discovered().raw(MOTOR)
    driver.robot.is_newcomer = True
    driver.state.update_graph(0, {RAW: Endpoint(publishers)}, driver.now)
    silent = {("robot", "silent", "r")} if publishers else set()
    assert driver.at(700).fault_names() == silent
    assert bool(driver.state.robots) is bool(publishers)


def test_a_discovered_robot_that_never_publishes_is_forgotten_when_its_publisher_is_long_gone():
    driver = discovered()
    assert driver.at(500).robot.silent_reason == "mute"
    driver.state.update_graph(0, {}, driver.now)
    assert driver.at(599).robot.silent_reason == "never_seen"
    assert not driver.at(602).state.robots


def test_forget_takes_out_what_a_person_names():
    driver = StateDriver().raw(HOT, LASER)

    assert driver.state.forget("r", "Motor 1", driver.now) == 1
    for name, component in (("r", "no such"), ("no such", "Laser 1")):
        with pytest.raises(LookupError, match="no such"):
            driver.state.forget(name, component, driver.now)
    assert [each.name for each in driver.robot.components] == ["Laser 1"]


def test_what_a_person_forgets_is_known_again_with_the_next_array():
    driver = StateDriver(Source.AGG)
    array = tree(Parts=[HOT, LASER])
    driver.agg(*array)
    driver.state.forget("r", "Motor 1", driver.now)
    assert driver.agg(*array).level("Motor 1") == ERROR
