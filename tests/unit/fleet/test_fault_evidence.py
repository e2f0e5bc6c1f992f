"""The evidence of a fault as fields: of each kind of fault what it rests on, as JSON."""

import json
import re
from pathlib import Path

import jsonschema
import pytest
import yaml

from ros_diagnostics_exporter import web
from ros_diagnostics_exporter.api.snapshot import faults
from ros_diagnostics_exporter.config.fleet import (
    Check,
    ComponentRule,
    Fleet,
    Robot,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.faults.model import Row
from ros_diagnostics_exporter.model import Status
from support.configs import load_text
from support.state_driver import ERROR, OK, SETTLED, WALL, WARN, StateDriver

MOTOR, LASER = Status(OK, "Motor"), Status(OK, "Laser")
HOT = Status(
    ERROR, "Motor", "Hot", "m-1", (("Temperature", "91 C"), ("State", "on"), ("Load", "inf"))
)


def after(seconds: float, *statuses: Status, before=(MOTOR, LASER), **profile) -> StateDriver:
    """A robot that was well and then had these statuses for some seconds."""
    driver = StateDriver(**profile).raw_every(1, SETTLED, *before)
    driver.stand(seconds, *statuses)
    return driver


def evidence(driver: StateDriver) -> list[str]:
    """The first part of it as text, of each fault."""
    return [each.evidence.partition(";")[0] for each in driver.state.faults()]


def details(driver: StateDriver):
    """The fields of the faults that last, by state and component, as the API has them."""
    found = json.loads(json.dumps(faults(driver.state, driver.now), allow_nan=False))["faults"]
    for each in found:
        check(each["details"])
    return {(each["state"], each["component"]): each["details"] for each in found}


def check(fields):
    """Fail where fields are not as the API's description says, or are not in it."""
    document = yaml.safe_load((Path(web.__file__).parent / "openapi.yaml").read_text())
    schema = document["components"]["schemas"]["Details"]
    others = {f"more_{name}": {"type": "integer"} for name in schema["properties"]}
    strict = {**schema, "properties": schema["properties"] | others, "additionalProperties": False}
    jsonschema.validate(fields, {**strict, "components": document["components"]})


def test_of_a_component_level_message_values_neighbours_and_what_judged_it():
    rule = ComponentRule(re.compile("Motor"), confirm_after=5.0)
    driver = after(12, HOT, LASER._replace(level=WARN), components=(rule,))
    assert details(driver)["critical", "Motor"] == {
        "level": "ERROR",
        "level_since": WALL + SETTLED,
        "message": "Hot",
        "reports": True,
        "hardware_id": "m-1",
        "profile": "default",
        "confirm_after": 5.0,
        "values": [
            {"key": "Temperature", "text": "91 C", "number": 91.0, "unit": "degC"},
            {"key": "State", "text": "on", "number": 1.0, "unit": ""},
            {"key": "Load", "text": "inf", "number": None, "unit": ""},
        ],
        "also_faulty": [{"group": "", "component": "Laser", "level": "WARN"}],
    }
    assert details(driver)["warning", "Laser"]["also_faulty"] == [
        {"group": "", "component": "Motor", "level": "ERROR"}
    ]


def test_its_lines_name_neighbours_without_their_node_where_the_rest_is_unique():
    near = [Status(ERROR, name, "") for name in ("lidar:  Laser", "left: Motor", "right: Motor")]
    driver = after(12, HOT, *near, before=(MOTOR,))

    [began] = [
        each for each in driver.events if each.kind == "fault_began" and each.component == "Motor"
    ]
    also = ("Laser CRITICAL", "left: Motor CRITICAL", "right: Motor CRITICAL")
    assert began.message.endswith(f"also faulty: {', '.join(also)}")
    named = [each["component"] for each in began.details["also_faulty"]]
    assert named == ["lidar:  Laser", "left: Motor", "right: Motor"]


def test_of_a_component_that_is_silent_that_its_message_is_old():
    found = details(after(130, LASER, before=(MOTOR._replace(message="fine"), LASER)))
    fields = found["stale", "Motor"]
    assert (fields["level"], fields["reports"], fields["message"]) == ("STALE", False, "fine")


@pytest.mark.parametrize(
    ("threshold", "beyond"), [(Threshold("low", "critical", 95.0), "low"),
                              (Threshold("high", "warning", 90.0), "high")]
)  # fmt: skip
def test_of_a_value_the_number_its_unit_and_the_threshold(threshold, beyond):
    rule = ValueRule(key=re.compile("Temperature"), thresholds=(threshold,))
    cool = HOT._replace(level=OK, values=(("Temperature", "91 C"),))
    driver = after(12, cool, values=(rule,))
    side = "below" if beyond == "low" else "above"
    assert evidence(driver) == [f"91 degC, {side} the threshold of {threshold.value:g} degC"]
    (fields,) = details(driver).values()
    assert fields["value"] == {
        "key": "Temperature",
        "text": "91",
        "number": 91.0,
        "unit": "degC",
        "threshold": threshold.value,
        "beyond": beyond,
    }


def test_of_a_value_that_falls_the_threshold_that_it_falls_to():
    rule = ValueRule(key=re.compile("Charge"), thresholds=(Threshold("low", "critical", 10.0),))
    driver = StateDriver(values=(rule,))
    for minute in range(26):
        status = MOTOR._replace(values=(("Charge", f"{60 - minute} %"),))
        driver.raw_every(5, driver.now.mono + 60, status)
    assert driver.fault_names() == {("value", "falling", "r", "Motor", "Charge", "low")}
    assert evidence(driver) == ["37 %, falling to the threshold of 10 %"]
    (fields,) = details(driver).values()
    assert (fields["value"]["beyond"], fields["value"]["threshold"]) == ("falling", 10.0)


def test_the_value_that_ended_a_fault_is_that_of_its_end():
    rule = ValueRule(key=re.compile("Charge"), thresholds=(Threshold("low", "critical", 10.0),))
    values = ("Charge", "5 %"), ("Load", "7")
    driver = after(12, MOTOR._replace(values=values), values=(rule,))
    driver.raw(MOTOR._replace(values=(("Charge", "80 %"), ("Load", "7"))))
    assert [end.message for end in driver.state.served()[1]] == ["80 %"]


@pytest.mark.parametrize(
    ("message", "said"), [("OK", "OK"), ("running", "OK: running"), ("", "OK")]
)
def test_the_message_that_ended_a_fault_says_nothing_twice(message, said):
    driver = after(12, MOTOR._replace(level=ERROR)).raw(MOTOR._replace(level=OK, message=message))
    assert [end.message for end in driver.state.served()[1]] == [said]


def test_of_a_check_how_many_were_found():
    motors = Check("motors", (re.compile("Motor"),), expect=2)
    driver = after(12, MOTOR, checks=(motors,))
    assert details(driver) == {("critical", ""): {"found": 1, "expected": 2}}
    assert evidence(driver) == ["1 of 2 components report"]


def test_of_many_components_which_and_how_many_more():
    parts = tuple(Status(OK, f"Part {number}") for number in range(10))
    driver = after(12, *(each._replace(level=ERROR) for each in parts), before=parts)
    fields = details(driver)["many", ""]
    assert [each["component"] for each in fields["components"]] == [
        f"Part {number}" for number in range(5)
    ]
    assert fields["more_components"] == 5


def test_of_many_components_that_flap_that_they_do():
    parts = tuple(Status(OK, f"Part {number}") for number in range(8))
    driver = after(1, *parts, before=parts)
    for _change in range(8):
        driver.raw_every(1, driver.now.mono + 4, *(each._replace(level=ERROR) for each in parts))
        driver.raw_every(1, driver.now.mono + 4, *parts)
    named = ", ".join(f"Part {number} FLAPPING" for number in range(5))
    assert evidence(driver) == [f"8 components: {named} and 3 more"]
    assert all(each["flaps"] for each in details(driver)["many", ""]["components"])


def test_of_a_silent_robot_why_and_when_it_was_last_received():
    driver = after(1, MOTOR)
    last = driver.state.robots["r"].last_wall
    driver.wait(60)
    found = {"silent_reason": "publisher_gone", "last_message": last}
    assert details(driver) == {("silent", ""): found}
    assert evidence(driver) == ["nobody publishes on its topics"]


def test_of_a_site_its_robots_but_those_that_were_never_received():
    sites = {"q": "yard", "never": "hall", **{f"r{number}": "hall" for number in range(6)}}
    robots = tuple(
        Robot(name, topic_raw=f"/{name}/d", source=Source.RAW, labels={"site": site})
        for name, site in sites.items()
    )
    driver = StateDriver(fleet=Fleet("f", robots))
    for second in range(int(SETTLED)):
        driver.at(second)
        for robot in robots:
            if robot.name != "never":
                driver.receive(robot.topic_raw, MOTOR)
    driver.at(SETTLED + 30)
    assert driver.fault_names() == {("site", "silent", "hall"), ("robot", "silent", "q")}
    (fault,) = (each for each in driver.state.faults() if each.identity.site)
    assert fault.details == {"robots": ["r0", "r1", "r2", "r3", "r4"], "more_robots": 1}
    assert fault.evidence == "6 robots: r0, r1, r2, r3, r4 and 1 more"


@pytest.mark.parametrize(
    ("texts", "evidence"),
    [
        (("no pose",) * 6, "no pose;\n6 robots: r0, r1, r2, r3, r4 and 1 more"),
        (("", *("no pose",) * 3, "lost", "lost"), "no pose (3 of 5);\n6 robots: r0, r1, r2,"),
    ],
)
def test_of_many_robots_what_most_of_them_say(texts, evidence):
    robots = tuple(Robot(f"r{n}", topic_raw=f"/r{n}/d", source=Source.RAW) for n in range(6))
    driver = StateDriver(fleet=Fleet("f", robots))
    for second in range(int(SETTLED) + 30):
        driver.at(second)
        for robot, text in zip(robots, texts, strict=True):
            status = MOTOR if second < SETTLED else MOTOR._replace(level=ERROR, message=text)
            driver.receive(robot.topic_raw, status)
    (fault,) = driver.state.faults()
    assert fault.evidence.startswith(evidence)
    check(details(driver)["critical", "Motor"])


def test_of_a_clock_by_how_much_it_differs():
    driver = after(1, MOTOR, before=(MOTOR,))
    for _ in range(65):
        driver.wait(1)
        driver.raw(MOTOR, stamp=driver.now.wall - 90)
    assert driver.fault_names() == {("robot", "clock", "r")}
    assert details(driver)["clock", ""] == {"clock_offset": 90.0}
    assert evidence(driver) == ["its clock is 90 s behind the exporter's"]
    for _ in range(3):
        driver.wait(1)
        driver.raw(MOTOR, stamp=driver.now.wall)
    assert driver.fault_names() == set()


def test_of_a_capability_the_parts_that_it_lacks(tmp_path):
    (tmp_path / "fleet.yml").write_text(
        "fleet: f\nprofiles: {default: {capabilities: {driving: [Motor, Laser]}}}\n"
        "robots: [{name: r, topic: /r/diagnostics, source: raw}]\n"
    )
    driver = StateDriver(fleet=load(tmp_path / "fleet.yml")).raw_every(1, SETTLED, MOTOR, LASER)
    driver.raw_every(1, SETTLED + 12, HOT, LASER)
    assert details(driver)["lost", ""] == {
        "parts": [{"component": "Motor", "level": "ERROR", "message": "Hot", "state": "lost"}]
    }


def test_of_a_capability_that_a_part_flaps(tmp_path):
    text = """
fleet: f
profiles: {default: {capabilities: {driving: [Motor]}}}
robots: [{name: r, topic: /r/diagnostics, source: raw}]
"""
    driver = StateDriver(fleet=load_text(tmp_path, text)).raw_every(1, SETTLED, MOTOR)
    for _change in range(5):
        for level in (ERROR, OK):
            driver.raw(Status(level, "Motor", "Turns")).wait(2)
    assert evidence(driver) == ["Motor FLAPPING: Turns"]
    assert details(driver)["lost", ""]["parts"][0]["flaps"]


def test_of_a_capability_the_value_that_is_beyond_its_threshold(tmp_path):
    text = """
fleet: f
profiles:
  default:
    values: [{component: Battery, key: Charge, thresholds: {low: {warning: 20, critical: 10}}}]
    capabilities: {driving: [{component: Battery, key: Charge}]}
robots: [{name: r, topic: /r/diagnostics, source: raw}]
"""
    low, full = (Status(OK, "Battery", "fine", values=(("Charge", each),)) for each in ("5", "80"))
    driver = StateDriver(fleet=load_text(tmp_path, text)).raw_every(1, SETTLED, full)
    (fault,) = driver.raw_every(1, SETTLED + 12, low).state.faults()
    assert fault.evidence == "Battery: Charge: 5, below the threshold of 10"


def test_the_fields_are_those_of_the_begin_also_after_a_restart_and_in_its_event():
    driver = after(12, HOT, before=(MOTOR,))
    before = details(driver)
    driver.stand(5, HOT._replace(message="hotter", values=()))
    assert details(driver) == before
    (began,) = [each for each in driver.events if each.kind == "fault_began"]
    assert began.details == before["critical", "Motor"]

    last = after(12, HOT, before=(MOTOR,))
    assert [each.details for each in last.raw(MOTOR).events if each.kind == "fault_ended"] == [None]

    again = StateDriver(fleet=driver.state.fleet)
    again.now = driver.now
    again.state.restore({"r": driver.state.robots["r"].persist(driver.now)}, again.now)
    rows = json.loads(json.dumps(driver.fault_rows()))
    (fields,) = [data for name, _of, data in rows if name == "problem"]
    again.restore_faults([Row(name, tuple(of), data) for name, of, data in rows])
    assert fields["fault"]["details"] == before["critical", "Motor"]
    assert details(again) == before


def test_the_fields_are_bounded_whatever_a_robot_sends():
    values = tuple((f"key {number}" * 500, "\x1b" * 5_000) for number in range(100))
    driver = after(12, HOT._replace(message="\n" * 50_000, values=values))
    (fault,) = driver.state.faults()
    text = json.dumps(fault.details)
    assert len(text) < 15_000
    assert fault.details["more_values"] == 95
    assert "\\u001b" not in text
    assert len(fault.evidence) <= 640
    assert all(each.isprintable() for each in fault.evidence.split("\n"))
