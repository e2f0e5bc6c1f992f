"""What a robot can no longer do, by the tasks of fleet.yml: in faults, snapshot and page."""

from __future__ import annotations

import pytest

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.robots.work import work
from ros_diagnostics_exporter.web.pages import robot_page
from support.state_driver import ERROR, OK, STALE, WARN, StateDriver

SETTLED = 40.0
PROFILES = """
fleet: f
profiles:
  base:
    tasks: {drive: [Motor, Laser], lift: Lift, sing: Speaker}
  amr:
    extends: base
    tasks: {charge: [Battery], sing: null}
    components:
      - {match: Lift, planned_stale: true}
      - {match: Laser 2, unless: {component: Motor, level: OK}}
    values: [{component: Battery, key: Charge, thresholds: {low: {warning: 20, critical: 10}}}]
robots: [{name: r, topic: /r/diagnostics, source: raw, profile: amr}]
"""
FINE = (
    *(Status(OK, name) for name in ("Motor", "Laser 1", "Laser 2", "Lift")),
    Status(OK, "Battery", "", "", (("Charge", "80"),)),
)


@pytest.fixture
def driver(tmp_path):
    (tmp_path / "fleet.yml").write_text(PROFILES)
    driver = StateDriver(fleet=load(tmp_path / "fleet.yml"))
    driver.raw_every(1, SETTLED, *FINE)
    return driver


def publish(driver: StateDriver, *changed: Status) -> None:
    names = {each.name for each in changed}
    statuses = (*(each for each in FINE if each.name not in names), *changed)
    driver.raw_every(1, driver.now.mono + 12, *statuses)


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ((), "can still drive and lift and charge"),
        ((Status(WARN, "Motor"),), "can still drive and lift and charge"),
        ((Status(ERROR, "Motor"),), "cannot drive but can still lift and charge"),
        ((Status(STALE, "Motor"),), "cannot drive but can still lift and charge"),
        ((Status(STALE, "Lift"),), "can still drive and lift and charge"),  # as planned
        ((Status(ERROR, "Laser 2"),), "can still drive and lift and charge"),  # excused
        (
            (Status(ERROR, "Lift"), Status(ERROR, "Laser 1")),
            "cannot drive or lift but can still charge",
        ),
        (
            tuple(Status(ERROR, each.name) for each in FINE),
            "cannot drive or lift or charge",
        ),
    ],
)
def test_a_task_needs_all_its_components(driver, changed, expected):
    publish(driver, *changed)
    assert work(driver.robot) == expected


def test_a_fault_has_it_and_it_stays_as_it_was(driver):
    publish(driver, Status(ERROR, "Motor", "Hot"))
    first = ("Hot", "cannot drive but can still lift and charge")
    assert [(each.evidence, each.work) for each in driver.state.faults()] == [first]
    publish(driver, Status(ERROR, "Motor", "Hot"), Status(ERROR, "Lift", "Stuck"))
    assert sorted((each.evidence, each.work) for each in driver.state.faults()) == [
        first,
        ("Stuck;\nalso faulty: Motor CRITICAL", "cannot drive or lift but can still charge"),
    ]
    shown = driver.samples()["fault_info"]
    assert {dict(labels)["work"] for labels in shown} == {
        each.work for each in driver.state.faults()
    }


@pytest.mark.parametrize(
    ("charge", "begin"),
    [("15", "can still drive and lift and charge"), ("5", "cannot charge but can still drive")],
)
def test_a_value_that_is_critical_takes_the_task_of_its_component(driver, charge, begin):
    publish(driver, Status(OK, "Battery", "", "", (("Charge", charge),)))
    worst = max(driver.state.faults(), key=lambda fault: fault.identity.state == "critical")
    assert worst.work.startswith(begin)


def test_nothing_is_said_of_a_silent_robot(driver):
    driver.at(driver.now.mono + 60)
    assert [each.evidence for each in driver.state.faults()] == ["nobody publishes on its topics"]
    assert [each.work for each in driver.state.faults()] == [""]
    assert work(driver.robot) == ""


def test_nothing_is_said_where_no_tasks_are_named():
    driver = StateDriver()
    driver.raw_every(1, SETTLED, Status(ERROR, "Motor", "Hot"))
    assert [each.evidence for each in driver.state.faults()] == ["Hot"]
    assert fleet_snapshot(driver.state, driver.now)["robots"][0]["work"] == ""


def test_the_page_of_a_robot_shows_it(driver):
    publish(driver, Status(ERROR, "Motor", "Hot"))
    page = robot_page(fleet_snapshot(driver.state, driver.now), "r", [])
    assert page is not None
    assert "<dt>Work</dt><dd>cannot drive but can still lift and charge</dd>" in page
