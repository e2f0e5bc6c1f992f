"""The families of faults: what a scrape shows of what is confirmed."""

from __future__ import annotations

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Robot, Source
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics import fault_text
from ros_diagnostics_exporter.model import Status
from support.state_driver import ERROR, OK, WALL, WARN, StateDriver

MOTOR, HOT = Status(OK, "Motor"), Status(ERROR, "Motor", 'Hot "92"')
START, INFO = "fault_start_timestamp_seconds", "fault_info"


def driver_of(**labels: str) -> StateDriver:
    robot = Robot("r", topic_raw="/r/diagnostics", source=Source.RAW, labels=labels)
    return StateDriver(fleet=Fleet("f", (robot,)))


def in_fault(**labels: str) -> StateDriver:
    driver = driver_of(**labels)
    driver.raw_every(1, 20, MOTOR)
    driver.raw_every(1, 40, HOT)
    return driver


def test_a_fault_is_there_from_its_confirmation_to_its_end():
    driver = driver_of()
    driver.raw_every(1, 20, MOTOR)
    driver.raw_every(1, 29, HOT)
    assert START not in driver.samples()
    driver.raw_every(1, 32, HOT)
    identity = {"fleet": "f", "scope": "component", "state": "critical", "robot": "r"}
    identity["component"] = "Motor"
    assert driver.samples()[START] == {tuple(sorted(identity.items())): WALL + 20}
    evidence = identity | {"evidence": 'Hot "92"'}
    assert driver.samples()[INFO] == {tuple(sorted(evidence.items())): 1}

    driver.raw(MOTOR)
    assert not {START, INFO} & driver.samples().keys()


def test_a_fault_keeps_the_robots_labels_of_when_it_began_and_its_identity():
    driver = in_fault(site="hall", team="blue", check="mine")
    (labels,) = driver.samples()[START]
    assert {"site": "hall", "team": "blue"}.items() <= dict(labels).items()
    assert "check" not in dict(labels)
    (labels,) = driver.samples()[INFO]
    assert dict(labels)["site"] == "hall"
    assert set(dict(labels)) <= set(metrics.FAULT_INFO.labels)

    robot = Robot("r", topic_raw="/r/diagnostics", source=Source.RAW, labels={"team": "red"})
    driver.state.configure(Fleet("f", (robot,)), driver.now)
    assert driver.sample(START, team="blue") == WALL + 20
    driver.raw(MOTOR)
    driver.raw_every(1, driver.now.mono + 12, HOT)
    assert driver.sample(START, team="red") is not None


def test_a_fleet_of_another_name_has_its_faults_under_it():
    driver = in_fault()
    assert driver.sample(START, fleet="f") == WALL + 20
    driver.state.configure(Fleet("g", driver.state.fleet.robots), driver.now)
    assert driver.sample(START, fleet="g") == WALL + 20
    assert driver.sample(START, fleet="f") is None


def test_a_fault_that_lasts_is_rendered_once(monkeypatch):
    driver = in_fault()
    first = driver.exposition.render()
    monkeypatch.setattr(fault_text, "_lines", None)
    assert driver.exposition.render() == first


@pytest.mark.parametrize(("level", "shown"), [(OK, None), (WARN, 1), (ERROR, 2), (3, 3)])
def test_the_level_of_a_problem_is_there_while_there_is_one(level, shown):
    driver = driver_of()
    driver.raw(MOTOR._replace(level=level))
    assert driver.sample("component_problem_level", component="Motor") == shown
    assert driver.sample("component_level", component="Motor") == level
