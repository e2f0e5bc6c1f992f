"""A robot that boots is no robot that fails: what is wrong from its first message on has time."""

from dataclasses import replace

import pytest

from ros_diagnostics_exporter.config.conditions import Condition
from ros_diagnostics_exporter.config.fleet import (
    Check,
    ComponentRule,
    Fleet,
    Profile,
    Robot,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.regex import Pattern
from support.state_driver import ERROR, OK, SETTLED, STALE, WARN, StateDriver, tree

BLIND, FINE, MOTOR = Status(ERROR, "Lidar"), Status(OK, "Lidar"), Status(OK, "Motor")
CRITICAL = ("component", "critical", "r", "Lidar")
LOW = ValueRule(key=Pattern("charge"), thresholds=(Threshold("low", "critical", 10.0),))
TOO_LOW = ("value", "critical", "r", "Battery", "charge", "low")


def booted(*statuses: Status, **profile) -> StateDriver:
    """A robot with a boot_grace of two minutes that is back after a silence, with these."""
    driver = StateDriver(boot_grace=120.0, **profile).raw_every(1, SETTLED, FINE, MOTOR)
    assert driver.at(SETTLED + 60).fault_names() == {("robot", "silent", "r")}
    driver.raw_every(1, SETTLED + 61, *statuses)
    return driver


def test_drivers_that_report_error_until_they_are_up_are_no_fault():
    driver = booted(BLIND, MOTOR)
    assert driver.raw_every(1, SETTLED + 170, BLIND, MOTOR).fault_names() == set()
    assert driver.raw_every(1, SETTLED + 300, FINE, MOTOR).fault_names() == set()


def test_what_is_still_wrong_after_it_is_a_fault():
    driver = booted(BLIND, MOTOR)
    assert driver.raw_every(1, SETTLED + 185, BLIND, MOTOR).fault_names() == {CRITICAL}


def test_what_was_ok_and_then_fails_has_no_grace():
    driver = booted(FINE, MOTOR)
    assert driver.raw_every(1, SETTLED + 75, BLIND, MOTOR).fault_names() == {CRITICAL}


def test_a_value_that_is_low_from_the_first_message_on_has_it_too():
    low = battery("5")
    driver = booted(low, values=(LOW,))
    assert TOO_LOW not in driver.raw_every(1, SETTLED + 170, low).fault_names()
    assert TOO_LOW in driver.raw_every(1, SETTLED + 190, low).fault_names()


def battery(charge: str, level: int = OK) -> Status:
    return Status(level, "Battery", values=(("charge", charge),))


def test_a_value_that_was_low_before_the_silence_has_it_too():
    driver = StateDriver(boot_grace=120.0, values=(LOW,)).raw_every(1, SETTLED, battery("50"))
    driver.raw_every(1, SETTLED + 3, battery("5"))
    assert driver.at(SETTLED + 60).raw_every(1, SETTLED + 170, battery("5")).fault_names() == set()
    assert driver.raw_every(1, SETTLED + 190, battery("5")).fault_names() == {TOO_LOW}


def test_a_value_that_is_well_first_has_none_whatever_the_level():
    driver = booted(battery("50", WARN), values=(LOW,))
    assert driver.raw_every(1, SETTLED + 80, battery("5", WARN)).fault_names() == {TOO_LOW}


def test_what_was_ok_in_between_has_no_grace():
    driver = booted(BLIND).raw_every(1, SETTLED + 65, FINE)
    assert driver.raw_every(1, SETTLED + 80, BLIND).fault_names() == {CRITICAL}


def test_it_goes_on_where_a_condition_is_not_known_with_the_first_message():
    mode = Status(OK, "Mode", values=(("mode", "auto"),))
    when = Condition(component=(Pattern("Mode"),), key=(Pattern("mode"),), texts=(Pattern("auto"),))
    rule = ComponentRule(pattern=Pattern("Lidar"), when=(when,))
    driver = StateDriver(boot_grace=120.0, components=(rule,)).raw_every(1, SETTLED, FINE, mode)
    driver.at(SETTLED + 60)
    driver.raw_every(1, SETTLED + 63, BLIND)
    assert driver.raw_every(1, SETTLED + 170, BLIND, mode).fault_names() == set()
    assert driver.raw_every(1, SETTLED + 185, BLIND, mode).fault_names() == {CRITICAL}


@pytest.mark.parametrize("source", [Source.RAW, Source.AGG])
def test_what_is_stale_from_the_first_message_on_has_it_too(source):
    """A driver that is not up yet publishes nothing, or its aggregator says STALE of it."""
    motor, lidar = MOTOR, FINE
    driver = StateDriver(source, boot_grace=120.0)
    stale = {("component", "stale", "r", *(["/Parts"] if source is Source.AGG else []), "Lidar")}

    def go(until: float, *statuses: Status) -> None:
        if source is Source.RAW:
            driver.raw_every(1, until, *(each for each in statuses if each.level != STALE))
        else:
            driver.agg_every(1, until, *tree(Parts=statuses))

    go(SETTLED, motor, lidar)
    driver.at(SETTLED + 60)
    go(SETTLED + 170, motor, lidar._replace(level=STALE))
    assert driver.fault_names() == set()
    go(SETTLED + 185, motor, lidar._replace(level=STALE))
    assert driver.fault_names() == stale


def test_many_components_of_a_robot_that_boots_are_no_fault():
    parts = [Status(OK, f"part {number}") for number in range(20)]
    broken = [each._replace(level=ERROR) for each in parts[:12]] + parts[12:]
    driver = StateDriver(boot_grace=120.0).raw_every(1, SETTLED, *parts)
    assert driver.at(SETTLED + 60).raw_every(1, SETTLED + 178, *broken).fault_names() == set()
    driver.raw_every(1, SETTLED + 200, *broken)
    assert driver.fault_names() == {("robot", "many", "r", "critical")}


def test_many_robots_that_boot_together_have_no_common_fault():
    names = [f"r{number}" for number in range(6)]
    robots = (
        Robot(
            name,
            topic_raw=f"/{name}/diagnostics",
            source=Source.RAW,
            profile=Profile(boot_grace=120.0),
        )
        for name in names
    )
    driver = StateDriver(fleet=Fleet("f", tuple(robots)))

    def go(until: float, level: int) -> None:
        for _ in driver.seconds(until - driver.now.mono):
            for name in names:
                driver.receive(f"/{name}/diagnostics", Status(level, "Lidar"))

    go(SETTLED, OK)
    driver.at(SETTLED + 60)
    go(SETTLED + 178, ERROR)
    assert driver.fault_names() == set()
    go(SETTLED + 200, ERROR)
    assert driver.fault_names() == {("common", "critical", "Lidar")}


def test_a_restart_of_the_exporter_is_no_boot_of_the_robot(tmp_path):
    driver = StateDriver(boot_grace=120.0).raw_every(1, SETTLED, FINE)
    again = driver.raw_every(1, SETTLED + 5, BLIND).again(tmp_path / "state")
    assert again.raw_every(1, 15, BLIND).fault_names() == {CRITICAL}


def test_it_goes_on_after_a_restart_of_the_exporter(tmp_path):
    statuses = BLIND, MOTOR, battery("5")
    driver = booted(*statuses, values=(LOW,)).raw_every(1, SETTLED + 80, *statuses)
    again = driver.again(tmp_path / "state")  # 20 s of it are over, and 5 without an exporter
    assert again.raw_every(1, 90, *statuses).fault_names() == set()
    assert again.raw_every(1, 100, *statuses).fault_names() == {CRITICAL, TOO_LOW}


def test_what_was_there_when_the_exporter_began_to_listen_has_not_booted():
    driver = StateDriver(boot_grace=120.0)  # it knows nothing of before
    assert driver.graph("a").raw_every(1, 50, BLIND).fault_names() == {CRITICAL}


def test_a_robot_that_comes_after_the_exporter_boots():
    driver = StateDriver(boot_grace=120.0).at(SETTLED)
    assert driver.raw_every(1, SETTLED + 110, BLIND).fault_names() == set()
    assert driver.raw_every(1, SETTLED + 130, BLIND).fault_names() == {CRITICAL}


def test_no_robot_boots_because_its_domain_can_be_joined_at_last():
    driver = StateDriver(boot_grace=120.0)
    driver.graph()
    driver.state.domain_failed(0, "no interface", driver.now)
    driver.at(600)
    driver.state.domain_joined(0)
    assert driver.graph("a").raw_every(1, 690, BLIND).fault_names() == {CRITICAL}


def test_a_value_whose_condition_is_not_known_with_the_first_message_has_it_too():
    mode = Status(OK, "Mode", values=(("mode", "auto"),))
    when = Condition(component=(Pattern("Mode"),), key=(Pattern("mode"),), texts=(Pattern("auto"),))
    rule = replace(LOW, when=(when,))
    driver = booted(battery("5"), values=(rule,)).raw_every(1, SETTLED + 63, battery("5"))
    assert TOO_LOW not in driver.raw_every(1, SETTLED + 170, battery("5"), mode).fault_names()
    assert TOO_LOW in driver.raw_every(1, SETTLED + 190, battery("5"), mode).fault_names()


def test_what_reports_only_changes_has_it_with_what_it_says_first_after_the_silence():
    """That it was OK before is nothing that it said since."""
    rule = ComponentRule(pattern=Pattern("Lidar"), reports="on_change")
    driver = booted(MOTOR, components=(rule,)).raw_every(1, SETTLED + 70, MOTOR)
    assert driver.raw(BLIND).raw_every(1, SETTLED + 170, MOTOR).fault_names() == set()
    assert driver.raw_every(1, SETTLED + 190, MOTOR).fault_names() == {CRITICAL}


def test_no_robot_boots_because_a_reload_has_it():
    driver = StateDriver(boot_grace=120.0)
    fleet = driver.state.fleet
    driver.configure(robots=())
    driver.at(600)
    driver.configure(fleet)
    assert driver.raw_every(1, 650, BLIND).fault_names() == {CRITICAL}


def test_a_check_that_finds_too_little_from_the_first_message_on_has_it_too(tmp_path):
    """Drivers come up one after another, and a capability may rest on that."""
    motors = Check("motors", (Pattern("Motor"),), expect=2)
    first, second = Status(OK, "Motor 1"), Status(OK, "Motor 2")
    too_few = {("check", "critical", "r", "motors")}
    for last, found in (((first, second), set()), ((first,), too_few)):
        driver = StateDriver(boot_grace=120.0, checks=(Check("all"), motors)).at(SETTLED)
        driver.raw_every(1, SETTLED + 50, first)
        again = driver.again(tmp_path / f"{len(last)}")  # 50 s of it are over, and 5 without one
        assert again.raw_every(1, 60, first).fault_names() == set()
        assert again.raw_every(1, 90, *last).fault_names() == found
