"""What the API shows of the state, and in which words."""

import re
from dataclasses import replace

import pytest

from ros_diagnostics_exporter.api.snapshot import (
    Care,
    faults,
    fleet_snapshot,
    queries,
    robot_snapshot,
)
from ros_diagnostics_exporter.config.fleet import (
    Check,
    ComponentRule,
    Fleet,
    Profile,
    Query,
    Robot,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.model import Array, Downtime, Status, Topic
from ros_diagnostics_exporter.notifications import key_of
from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_exporter.silences import Acknowledgement, identity_of
from ros_diagnostics_exporter.sources.prometheus import Outcome
from support.state_driver import ERROR, OK, STALE, WALL, StateDriver, tree

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
    short = {"check": "motors", "patterns": ["Motor"], "found": 1, "expected": 2}
    assert robot(driver)["short_checks"] == [short]
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
    driver = StateDriver().raw(Status(OK, "Arm", values=REPEATED))

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


def test_a_number_is_that_of_the_text_beside_it():
    """A STALE status is not read: it may have other texts than the one that was."""
    driver = StateDriver().raw(Status(OK, "Arm", values=(("Error", "1"),)))
    driver.raw(Status(STALE, "Arm", values=(("Error", "2"),)))

    (arm,) = robot(driver)["components"]
    assert [(each["value"], each["number"]) for each in arm["values"]] == [("2", None)]


HOT = Status(ERROR, "Motor", "Hot")


def test_a_problem_is_soft_until_it_is_confirmed_and_keeps_its_since():
    driver = StateDriver().raw_every(1, 40, Status(OK, "Motor"))
    driver.raw_every(1, 45, HOT)
    (soft,) = robot(driver)["problems"]
    assert soft["confirmed"] is soft["suppressed"] is soft["suppressed_by"] is None
    assert (soft["scope"], soft["state"], soft["severity"]) == ("component", "critical", "critical")
    assert (soft["component"], soft["since"], soft["due"]) == ("Motor", WALL + 40, WALL + 50)
    assert faults(driver.state, driver.now)["faults"] == []

    driver.raw_every(1, 60, HOT)
    (hard,) = robot(driver)["problems"]
    assert (hard["since"], hard["confirmed"]) == (WALL + 40, WALL + 50)
    assert hard["evidence"] == "Hot"
    assert driver.sample("fault_start_timestamp_seconds", state="critical") == hard["since"]
    (fault,) = faults(driver.state, driver.now)["faults"]
    same = fault.keys() & hard.keys()
    assert {key: fault[key] for key in same} == {key: hard[key] for key in same}


def test_a_fault_has_who_acknowledged_it_and_the_next_one_has_not():
    driver = StateDriver().raw_every(1, 60, HOT)
    (fault,) = faults(driver.state, driver.now)["faults"]
    named = identity_of({**fault, "fleet": "f"})
    of_this = Acknowledgement(named, fault["since"], "ann", "spare part", WALL + 55, WALL + 99)
    of_last = of_this._replace(since=fault["since"] - 3600, author="bob")
    care = Care(None, [of_this, of_last])

    (robot_row,) = fleet_snapshot(driver.state, driver.now, care)["robots"]
    (problem,) = robot_row["problems"]

    taken = {"author": "ann", "comment": "spare part", "at": WALL + 55, "until": WALL + 99}
    assert problem["acknowledged"] == taken
    assert faults(driver.state, driver.now, care)["faults"][0]["acknowledged"] == taken
    assert robot(driver)["problems"][0]["acknowledged"] is None


def test_a_silent_robot_has_the_problem_since_its_last_message():
    driver = StateDriver().raw_every(1, 40, Status(OK, "Motor"))
    driver.at(100)
    (silent,) = (each for each in robot(driver)["problems"] if each["scope"] == "robot")
    assert (silent["state"], silent["since"]) == ("silent", robot(driver)["last_message"])
    assert silent["confirmed"] is not None


def test_a_problem_of_many_robots_is_the_fleets():
    made = [
        Robot(f"r{n}", topic_raw=f"/r{n}/diagnostics", source=Source.RAW, labels={"site": "hall"})
        for n in range(6)
    ]
    driver = StateDriver(fleet=Fleet("f", tuple(made)))
    for second in range(60):
        for each in made:
            if second < 40:
                driver.receive(each.topic_raw, Status(OK, "Motor"))
        driver.at(second + 1)
    fleet = fleet_snapshot(driver.state, driver.now)
    assert [(each["scope"], each["site"]) for each in fleet["problems"]] == [("site", "hall")]
    shown = [each for each_robot in fleet["robots"] for each in each_robot["problems"]]
    assert {(each["state"], each["suppressed"]) for each in shown} == {("silent", "site")}
    assert {(each["suppressed_by"]["scope"], each["suppressed_by"]["site"]) for each in shown} == {
        ("site", "hall")
    }
    (fault,) = faults(driver.state, driver.now)["faults"]
    assert (fault["scope"], fault["site"], fault["robot"]) == ("site", "hall", "")


def test_a_value_has_its_thresholds_and_a_problem_beyond_them():
    low = Threshold("low", "critical", 10.0)
    rule = ValueRule(key=Pattern("Voltage"), thresholds=(low,))
    driver = StateDriver(values=(rule,))
    driver.raw(Status(OK, "Battery", values=(("Voltage", "9 V"), ("Cells", "7"))))
    shown = robot(driver)
    voltage, cells = shown["components"][0]["values"]
    assert voltage["thresholds"] == [{"bound": "low", "severity": "critical", "value": 10.0}]
    assert "thresholds" not in cells
    (beyond,) = shown["problems"]
    assert (beyond["scope"], beyond["key"], beyond["bound"]) == ("value", "Voltage", "low")


@pytest.mark.parametrize(("text", "has_any"), [("n/a", True), ("12.1", True), ("[1, 2]", False)])
def test_a_text_that_is_no_number_has_the_thresholds_that_it_is_not_judged_by(text, has_any):
    """Of a list each number has its own."""
    rule = ValueRule(key=Pattern("Voltage"), thresholds=(Threshold("low", "critical", 10.0),))
    driver = StateDriver(values=(rule,)).raw(Status(OK, "Battery", values=(("Voltage", text),)))
    (voltage,) = robot(driver)["components"][0]["values"]
    assert ("thresholds" in voltage) is has_any


def test_a_robot_is_shown_with_its_config_and_all_that_was_received():
    made = Robot(
        "r",
        domain_id=7,
        namespace="/r",
        topic_agg="/r/diagnostics_agg",
        source=Source.AGG,
        address="10.0.0.1",
        labels={"site": "hall"},
    )
    driver = StateDriver(fleet=Fleet("f", (made,)))
    shown = robot(driver)
    assert (shown["up"], shown["last_message"], shown["components"]) == (False, None, [])
    driver.state.receive(
        Topic(7, "/r/diagnostics_agg"), Array(0.0, tree(Motor=[HOT]), 9), driver.now
    )

    (hot,) = (shown := robot(driver)).pop("components")
    assert len(shown.pop("problems")) == 1
    assert shown == {
        "robot": "r",
        "up": True,
        "silent_reason": None,
        "last_message": WALL,
        "labels": {"site": "hall"},
        "address": "10.0.0.1",
        "links": {},
        "domain_id": 7,
        "namespace": "/r",
        "topic": "/r/diagnostics_agg",
        "profile": "default",
        "maintenance": False,
        "maintenance_until": None,
        "capabilities_text": "",
        "downtimes": [],
        "downtimes_ahead": [],
        "capabilities": [],
        "short_checks": [],
        "groups": [{"group": "/Motor", "level": "OK", "message": "OK"}],
    }
    assert hot == {
        "component": "Motor",
        "group": "/Motor",
        "hardware_id": "",
        "level": "ERROR",
        "reported_level": "ERROR",
        "level_before_stale": None,
        "state": "CRITICAL",
        "planned_stale": False,
        "suppressed_because": "",
        "message": "Hot",
        "level_since": WALL,
        "changes": 0,
        "flap_ratio": 0.0625,
        "values": [],
    }


def times(begin: float, end: float) -> dict[str, float]:
    return {"from": WALL + begin, "until": WALL + end}


def test_a_robot_has_the_downtimes_that_hold_and_who_was_notified_of_its_fault():
    driver = StateDriver().raw_every(1, 60, HOT)
    (fault,) = faults(driver.state, driver.now)["faults"]
    planned = [
        Downtime("r", "Lidar", WALL, WALL + 99, "ann", "lens"),
        Downtime("r", "", WALL + 60, WALL + 80, "bob", "service"),
        Downtime("r", "", WALL + 90, WALL + 95, "bob", "later"),
    ]
    driver.state.plan(planned, driver.now)
    driver.at(61)
    notified = {key_of({**fault, "fleet": "f"}): {"email": WALL + 55}}
    care = Care(notified, (), lambda found, since: (found, since) == (fault["fault"], WALL))

    shown = robot_snapshot(driver.state, "r", driver.now, care)

    assert (shown["maintenance"], shown["maintenance_until"]) == (True, WALL + 80)
    assert shown["downtimes"] == [
        {"component": "", **times(60, 80), "author": "bob", "comment": "service"},
        {"component": "Lidar", **times(0, 99), "author": "ann", "comment": "lens"},
    ]
    assert shown["downtimes_ahead"] == [
        {"component": "", **times(90, 95), "author": "bob", "comment": "later"}
    ]
    (problem,) = shown["problems"]
    assert problem["notified"] == {"email": WALL + 55}
    assert problem["recording"] == f"/api/v1/faults/{fault['fault']}/recording.mcap"
    assert fault["recording"] is None
    with pytest.raises(LookupError):
        robot_snapshot(driver.state, "nobody", driver.now, care)


def test_a_component_that_never_changed_does_not_flap():
    driver = StateDriver().raw(Status(OK, "Motor"))
    (motor,) = robot(driver)["components"]
    assert (motor["state"], motor["flap_ratio"], motor["changes"]) == ("OK", 0.0, 0)
    assert motor["reported_level"] == "OK"


def test_infinity_is_no_number_of_json():
    driver = StateDriver()
    driver.raw(Status(OK, "Arm", values=(("a", "inf"), ("b", "-inf"), ("c", "nan"), ("d", "0"))))
    (arm,) = robot(driver)["components"]
    assert [each["number"] for each in arm["values"]] == [None, None, None, 0.0]


def test_a_query_says_how_it_was_answered():
    query = Query("node_load1", "load")
    assert queries([Outcome(query, "", rows=2, skipped=1)]) == [
        {"name": "Host/load", "expr": "node_load1", "rows": 2, "skipped": 1, "error": ""}
    ]


def test_a_robot_has_its_links_beside_those_of_its_profile():
    profile = Profile(links={"manual": "https://w/amr", "camera": "http://{address}:8080/"})
    settings = Robot("r", namespace="/r", profile=profile, links={"manual": "https://w/{robot}"})
    known = replace(settings.reading(Source.RAW), address="fe80::1")
    found = robot(StateDriver(fleet=Fleet("f", (known,))))

    assert found["links"] == {"manual": "https://w/r", "camera": "http://[fe80::1]:8080/"}
